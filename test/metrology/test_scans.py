"""A common spline through scans: the same as by dense least squares, in a part of the time."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import BSpline

from rotary_error_monitor.metrology.repeated_runs import Run, combine_runs
from rotary_error_monitor.metrology.scans import DEGREE, fit_scans


def scans_of(seed: int, count: int, samples: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Scans over 1 m, each of a height and of positions of its own."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        x = (np.arange(samples) + rng.uniform(0.1, 0.9, samples)) / samples
        found.append((x, 3e-6 * np.sin(9 * x) + 5e-6 * rng.normal() + 5e-8 * rng.normal(size=samples)))
    return found


def dense(scans, breaks):
    """Values, weights and residual by the textbook: the design written out, its pseudoinverse."""
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    x, y = (np.concatenate(each) for each in zip(*scans, strict=True))
    columns = [BSpline.design_matrix(x, knots, DEGREE).toarray()]
    edges = np.cumsum([0, *(len(one) for one, _ in scans)])
    for low, high in pairwise(edges[1:]):
        column = np.zeros((len(x), 1))
        column[low:high] = 1
        columns.append(column)
    design = np.hstack(columns)
    inverse = np.linalg.pinv(design)
    rows = np.hstack([BSpline.design_matrix(breaks, knots, DEGREE).toarray(), np.zeros((len(breaks), len(scans) - 1))])
    freedom = len(x) - np.linalg.matrix_rank(design)
    return rows @ inverse @ y, ((rows @ inverse) ** 2).sum(axis=1), y - design @ (inverse @ y), freedom


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("count", "nodes"), [(1, 21), (2, 40), (5, 101)])
def test_it_is_the_least_squares_solution(seed, count, nodes):
    scans, breaks = scans_of(seed, count, 120), np.linspace(0.0, 1.0, nodes)
    found = fit_scans(scans, breaks)
    values, weights, residual, freedom = dense(scans, breaks)
    np.testing.assert_allclose(found.values, values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-6)
    np.testing.assert_allclose(found.residual, residual, rtol=0, atol=1e-12)
    assert found.freedom == freedom


@pytest.mark.parametrize("seed", range(6))
def test_where_samples_do_not_tell_all_coefficients_the_smallest_are_taken(seed):
    """Two samples between neighbouring nodes of a part, one in the rest: fewer samples than coefficients."""
    rng = np.random.default_rng(seed)
    breaks = np.linspace(0.0, 1.0, 11)
    x = np.sort(np.concatenate([(breaks[:-1] + breaks[1:]) / 2, rng.uniform(0.0, 0.1, 1)]))
    scans = [(x, rng.normal(size=x.size))]
    found = fit_scans(scans, breaks)
    values, _, residual, freedom = dense(scans, breaks)
    np.testing.assert_allclose(found.values, values, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.residual, residual, rtol=0, atol=1e-8)
    assert found.freedom == freedom == 0


def test_scans_of_a_metre_take_no_time():
    """Five of 1,000 samples: dense least squares takes three seconds."""
    scans, breaks = scans_of(0, 5, 1000), np.linspace(0.0, 1.0, 1000)
    begin = time.process_time()
    fit_scans(scans, breaks)
    assert time.process_time() - begin < 1.0


@pytest.mark.parametrize("seed", range(20))
def test_ends_that_only_some_runs_reach_do_not_stand_off(seed):
    """Five runs each way that begin anywhere within a step: at an end a direction may have no sample near."""
    rng = np.random.default_rng([seed, 3])
    runs = []
    for number in range(10):
        way, phase = (-1 if number % 2 else 1), rng.uniform(0.0, 0.99)
        gone = (np.arange(440) + phase) * 1e-3
        x = gone if way > 0 else 0.44 - gone
        y = 3e-6 * np.cos(7 * x) + 1e-6 * rng.normal() + 35e-9 * rng.normal(size=x.size)
        runs.append(Run(x, y, way))
    found = combine_runs(runs, noise=35e-9)
    assert not found.stops
    assert found.positions[0] < 2e-3
    assert found.positions[-1] > 0.438
    error = found.mean - 3e-6 * np.cos(7 * found.positions)
    error -= np.median(error)
    # a mean is as sure as one reading at least: of 40 ends none is off by more than four times its noise
    assert np.abs(error[[0, -1]]).max() < 0.14e-6
    assert found.uncertainty is not None
    np.testing.assert_array_less(np.abs(error), 6 * found.uncertainty)
