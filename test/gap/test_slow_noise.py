"""Slow noise of an instrument is learnt as noise; what a fault could be is not."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.known_effects import KnownEffect
from rotary_error_monitor.gap.slow_evidence import ExplainingColumns, WhiteData
from rotary_error_monitor.gap.slow_noise import cosines, in_all, learn_slow_noise

POSES = 100
PASSED = (np.arange(POSES) + 0.5) / POSES


def learnt_from(white, others):
    """Root mean square of what is learnt; 0 for none."""
    columns = np.split(others, others.shape[1], axis=1)
    found = learn_slow_noise(white, np.ones((3, POSES)), PASSED, np.zeros((3 * POSES, 0)), [columns])
    return 0.0 if found is None else float(np.sqrt(np.mean(np.sum(np.square(cosines(PASSED) * found), axis=1))))


def learnt(seed, drifting):
    draw = np.random.default_rng(seed)
    return learnt_from(draw.normal(size=(3, POSES)) + drifting(draw), draw.normal(size=(3 * POSES, 30)))


def walk(draw):
    steps = draw.normal(size=(3, POSES))
    return 3.0 * np.cumsum(steps, axis=1) / np.sqrt(POSES)


def step(draw):
    return np.where(np.arange(POSES) >= draw.integers(20, 80), 3.0, 0.0) * draw.choice([-1.0, 1.0], (3, 1))


def test_white_noise_is_hardly_ever_slow():
    """Either is as likely beforehand, and what is learnt by chance is small."""
    sizes = np.array([learnt(seed, lambda draw: 0.0) for seed in range(100)])
    assert np.count_nonzero(sizes) <= 5
    assert sizes.max() < 0.5


def test_a_random_walk_is_learnt_with_its_size():
    sizes = np.array([learnt(seed, walk) for seed in range(40)])
    assert np.mean(sizes > 0) >= 0.9
    assert 0.5 < np.median(sizes) / (3.0 / np.sqrt(2)) < 2.0


@pytest.mark.parametrize(("times", "least", "most"), [(0.5, 0.75, 1.0), (3.0, 0.0, 0.1)])
def test_what_is_far_louder_than_the_noise_is_none(times, least, most):
    """A course of six times the stated noise is something the twin does not know; some walks happen to be small."""
    found = np.array([learnt(seed, lambda draw: times * walk(draw)) for seed in range(40)])
    assert least <= np.mean(found > 0) <= most, found


@pytest.mark.parametrize(("size", "least", "most"), [(3.0, 0.9, 1.0), (12.0, 0.0, 0.05)])
def test_a_steady_drift_is_as_large_as_it_is_seen(size, least, most):
    """From end to end. One of twelve times the noise is a walk of two on average, and was noise: no gap."""

    def drift(draw):
        way = draw.normal(size=(3, 1))
        return size * way / np.sqrt(np.mean(np.square(way))) * (PASSED - 0.5)

    assert least <= np.mean([learnt(seed, drift) > 0 for seed in range(40)]) <= most


def test_a_step_is_a_fault_and_no_noise():
    assert sum(learnt(seed, step) > 0 for seed in range(40)) <= 2


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_what_a_machine_may_do_is_no_noise(size):
    found = 0
    for seed in range(40):
        slow = np.tile(np.linspace(-1.0, 1.0, POSES), 3)[:, None]
        white = np.random.default_rng(seed).normal(size=3 * POSES) + size * slow[:, 0]
        found += learnt_from(white.reshape(3, POSES), slow) > 0
    assert found <= 2


@pytest.mark.parametrize("left", [0.1, 0.3])
def test_a_fault_that_departs_from_what_is_known_is_no_noise(left):
    """It leaves a part that is as slow as noise, and that the fault may do as it departs."""
    found = 0
    waves = in_all(np.sqrt(2) * np.cos(np.pi * PASSED[:, None] * np.arange(2, 14)), np.ones((3, POSES)))
    for seed in range(40):
        draw = np.random.default_rng(seed)
        slow = np.tile(np.linspace(-1.0, 1.0, POSES), 3)[:, None]
        departing = left * waves @ draw.normal(size=waves.shape[1]) / np.sqrt(12)
        white = draw.normal(size=(3, POSES)) + 10.0 * (slow[:, 0] + departing).reshape(3, POSES)
        fault = KnownEffect(slow, lambda size: (0.1 * size[0] * waves, ["course"] * waves.shape[1]), 0.0)
        arguments = white, np.ones((3, POSES)), PASSED, np.zeros((3 * POSES, 0)), [[slow]], [fault]
        found += learn_slow_noise(*arguments) is not None
    assert found <= 2


@pytest.mark.parametrize("left", [0.1, 0.3])
def test_noise_takes_no_part_of_a_fault_beside_it(left):
    """A line of ten, and a walk that no fault explains: noise is as large as the walk, and no larger for the line."""
    ratios = []
    for seed in range(40):
        draw = np.random.default_rng(seed)
        slow = np.tile(np.linspace(-1.0, 1.0, POSES), 3)[:, None]
        beside = 10.0 * left * walk(draw) / 3.0
        white = draw.normal(size=(3, POSES)) + 10.0 * slow[:, 0].reshape(3, POSES) + beside
        ratios.append(learnt_from(white, slow) / np.sqrt(np.mean(np.square(beside))))
    assert np.mean(ratios) < 1.3
    assert max(ratios) < 2.5


@pytest.mark.parametrize("seed", range(40))
def test_a_sum_of_other_columns_counts_for_nothing(seed):
    """However loud the data are: from about 30 standard deviations on the matrix was singular for one seed in ten."""
    draw, count = np.random.default_rng(seed), 400
    apart = draw.normal(size=(count, 2))
    columns = np.column_stack([apart, apart @ draw.normal(size=2)])[:, None]
    rows = draw.normal(size=count) + 10.0 ** draw.uniform(0, 8) * apart[:, 0]
    data = WhiteData(rows, np.ones(count), np.zeros((count, 0)))
    both, without = (ExplainingColumns.of(data, each, count).alone for each in (columns, columns[:, :, :2]))
    assert both == pytest.approx(without, rel=1e-9, abs=0.5)  # one of three columns has a prior of its own width
