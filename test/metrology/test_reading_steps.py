"""Errors of readings in steps, against readings that are rounded by numpy; which step readings show."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.reading_steps import (
    repeated_errors,
    rounding_errors,
    rounding_variance,
    sawtooth,
    step_of,
)


@pytest.mark.parametrize("ratio", [0.2, 1.0, 2.0, 4.0, 100.0])
@pytest.mark.parametrize(("way", "column"), [(np.floor, 0), (np.trunc, 1), (np.rint, None)])
def test_mean_errors_are_those_of_readings_that_are_rounded_or_cut_off(ratio, way, column):
    """Of 20,000 readings at each of 41 values, within five standard deviations of their mean."""
    noise, values = 0.5, np.linspace(-3.0, 3.0, 41)
    step = ratio * noise
    rng = np.random.default_rng(round(10 * ratio))
    read = way((values + noise * rng.normal(size=(20_000, len(values)))) / step) * step
    expected = sawtooth(values, noise, step)
    if column is not None:
        expected = sawtooth(values - step / 2, noise, step) - rounding_errors(values, noise, step)[:, column]
    scatter = 5 * np.hypot(noise, step) / np.sqrt(len(read))
    assert np.abs(read.mean(axis=0) - values - expected).max() < scatter


@pytest.mark.parametrize("seed", range(5))
def test_without_noise_the_sawtooth_is_what_rounding_does(seed):
    rng = np.random.default_rng(seed)
    step, values = 10 ** rng.uniform(-9, 0), rng.normal(0, 10.0, 1000)
    found = sawtooth(step * values, 0.0, step)
    np.testing.assert_allclose(found, step * (np.rint(values) - values), atol=1e-12 * step)
    assert np.abs(sawtooth(step * values, 0.7 * step, step)).max() < 1e-4 * step, "noise breaks it up"


def test_without_noise_the_sides_are_those_of_the_values():
    found = rounding_errors(np.array([-2.0, 0.0, 3.0]), 0.0, 0.5)
    np.testing.assert_array_equal(found, [[0.25, -0.25], [0.25, 0.0], [0.25, 0.25]])


@pytest.mark.parametrize("seed", range(10))
def test_readings_within_a_step_share_their_error(seed):
    """A mean of readings that move by a tenth of a step to the next: its scatter by brute force, over 400 offsets."""
    rng, step, noise = np.random.default_rng(seed), 1.0, rng_noise(seed)
    path = 0.1 * np.arange(10)
    values = path + rng.uniform(0, 1, (4000, 1))
    errors = np.rint((values + noise * rng.normal(size=values.shape)) / step) * step - values
    repeated = repeated_errors(np.tile(path[0], 10), noise, step)
    still = np.rint((values[:, :1] + noise * rng.normal(size=values.shape)) / step) * step - values[:, :1]
    stated = (noise**2 + (1 + repeated[0]) * step**2 / 12) / 10
    assert np.var(still.mean(axis=1)) < 1.1 * stated, "at rest all ten are one"
    assert np.var(still.mean(axis=1)) > 0.5 * stated
    moving = (noise**2 + (1 + repeated_errors(path, noise, step).max()) * step**2 / 12) / 10
    assert np.var(errors.mean(axis=1)) < 1.1 * moving


def rng_noise(seed):
    """Noise in steps, from hardly any to so much that nothing is left of them."""
    return (0.02, 0.1, 0.2, 0.3, 0.6)[seed % 5]


def test_noise_above_the_steps_leaves_nothing_that_repeats():
    assert not repeated_errors(np.zeros(100_000), 1.0, 1.0).any()


@pytest.mark.parametrize("seed", range(20))
def test_the_step_of_readings_is_found_up_to_an_offset_and_a_gain(seed):
    rng = np.random.default_rng(seed)
    step, gain, zero = 10 ** rng.uniform(-9, 0), rng.uniform(-2, 2), rng.uniform(-5, 5)
    readings = np.rint(rng.normal(0, 10 ** rng.uniform(-0.3, 2.5), 2000)) * step
    assert step_of(readings) == pytest.approx(step, rel=1e-6)
    assert step_of(gain * readings + zero * step) == pytest.approx(abs(gain) * step, rel=1e-6)
    assert step_of(rng.normal(size=2000)) == 0.0
    assert step_of(np.repeat(rng.normal(size=500), 4)) == 0.0, "continuous ones that are sent several times"
    assert step_of(np.full(50, step)) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_what_a_fit_leaves_of_rounding_is_that_of_lines_that_are_rounded(seed):
    """A line at any place between two steps: 20,000 of them, at advances of any size and at fractions of a step."""
    rng = np.random.default_rng([seed, 20261129])
    count, degree = int(rng.integers(4, 10)), int(rng.integers(1, 3))
    columns = np.vander(np.arange(count) / count, degree + 1)
    kept = np.eye(count) - columns @ np.linalg.pinv(columns)
    step, noise = 10 ** rng.uniform(-6, 0), rng.choice([0.0, 0.1, 0.3])
    advances = np.concatenate([rng.uniform(0, 3, 4), rng.integers(1, 12, 4) / rng.integers(2, 6, 4), [1.0]])
    found = rounding_variance(step * advances, np.full(len(advances), step * noise), step, kept)
    for advance, each in zip(advances, found, strict=True):
        lines = rng.uniform(0, 1, (20_000, 1)) + advance * np.arange(count)
        left = np.rint(lines + noise * rng.normal(size=lines.shape)) @ kept
        square = (left**2).sum(axis=1) / np.trace(kept)
        scatter = 5 * square.std() / np.sqrt(len(square))
        assert abs(each / step**2 + noise**2 - square.mean()) < 0.03 / 12 + scatter
