"""Points of a surface that are measured more than once, against plain sums over them."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from metrology.simulated_surfaces import KINDS, SIZES, held

from rotary_error_monitor.metrology.repeated_points import combine_repeated


@pytest.mark.parametrize("seed", range(20))
def test_means_counts_and_scatter_are_those_of_each_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = np.stack([axis.ravel() for axis in np.meshgrid(np.linspace(-1.4, 0, 7), np.linspace(0, 0.5, 5))], axis=1)
    place = rng.permutation(np.repeat(np.arange(35), rng.integers(0, 4, 35)))
    heights = rng.normal(size=place.size)
    readings = defaultdict(list)
    for at, height in zip(place.tolist(), heights.tolist(), strict=True):
        readings[at].append(height)
    found = combine_repeated(*(grid[place] + rng.uniform(-4e-7, 4e-7, (place.size, 2)) * 0.1).T, heights)
    assert found.counts.tolist() == [len(each) for each in readings.values()], "in the order in which they come first"
    np.testing.assert_allclose(found.heights, [np.mean(each) for each in readings.values()], atol=1e-12)
    np.testing.assert_allclose(np.stack([found.first, found.second], axis=1), grid[list(readings)], atol=1e-7)
    freedom = sum(len(each) - 1 for each in readings.values())
    squares = sum(len(each) * np.var(each) for each in readings.values())
    assert found.freedom == freedom and found.repeated == sum(len(each) > 1 for each in readings.values())
    assert found.scatter == pytest.approx(np.sqrt(squares / max(freedom, 1)))
    assert found.noise_of_means(2.0) == pytest.approx(
        2 * np.sqrt(np.mean([1 / len(each) for each in readings.values()]))
    )


def test_a_surface_without_repeats_stays_as_it_is() -> None:
    first, second, heights = np.random.default_rng(0).normal(size=(3, 50))
    found = combine_repeated(first, second, heights)
    for given, kept in ((first, found.first), (second, found.second), (heights, found.heights)):
        np.testing.assert_array_equal(kept, given)
    assert (found.repeated, found.freedom, found.scatter, found.p_value(1e-9)) == (0, 0, 0.0, 1.0)


def test_p_values_of_the_true_noise_are_even() -> None:
    """Kolmogorov's distance of 400 from a uniform distribution: above 0.1 once in two thousand."""
    rng, at = np.random.default_rng(3), np.repeat(np.arange(10.0), 3)
    values = np.sort([combine_repeated(at, at, 1e-7 * rng.normal(size=30)).p_value(1e-7) for _ in range(400)])
    assert np.abs(values - np.linspace(0, 1, 400)).max() < 0.1


@pytest.mark.parametrize("kind", KINDS[:3])
def test_noise_by_repeats_gives_intervals_that_hold_the_true_flatness(kind: str) -> None:
    """Of 40 at 95 %, 33 or more but for one of 4000, with two readings at each point."""
    found = held(kind, *SIZES[2], 40, readings=2)
    assert found["held"] >= 33 / 40 and found["none"] <= 0.25 and found["width"] < 5.5 / np.sqrt(2)
