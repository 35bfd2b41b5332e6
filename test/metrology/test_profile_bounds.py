"""Bounds of a range and of a largest difference, in closed form where one mode alone is uncertain."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.profile_comparison import compare_profiles
from rotary_error_monitor.metrology.profile_range import range_bounds
from rotary_error_monitor.metrology.splicing import SplicedProfile

Array = NDArray[np.float64]
X = np.linspace(0.0, 0.8, 401)


def level(y: Array) -> Array:
    return np.asarray(y - np.polyval(np.polyfit(X, y, 1), X))


def profile(y: Array, covariance: Array) -> SplicedProfile:
    return SplicedProfile(X, X, y, covariance, np.zeros(1), np.zeros(1), (), ())


BOW = level((X - 0.4) ** 2)


@pytest.mark.parametrize("size", [2e-8, 5e-8, 1e-7])
def test_an_uncertain_size_of_a_bow(size: float) -> None:
    """Height a of a bow known to `size`: its range is as uncertain as that, and not biased."""
    shape = BOW / np.ptp(BOW)
    low, high = range_bounds(5e-6 * shape, size**2 * np.outer(shape, shape))
    # quantiles of 2000 draws scatter by 4 % of a standard deviation at each end
    assert low == pytest.approx(5e-6 - 1.96 * size, abs=0.2 * size)
    assert high == pytest.approx(5e-6 + 1.96 * size, abs=0.2 * size)


def test_a_further_uncertainty_adds_as_squares() -> None:
    shape = BOW / np.ptp(BOW)
    low, high = range_bounds(5e-6 * shape, (3e-8) ** 2 * np.outer(shape, shape), 4e-8)
    assert high - low == pytest.approx(2 * 1.96 * 5e-8, rel=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_noise_that_makes_a_range_larger_is_taken_off(seed: int) -> None:
    """Independent noise of 0.1 µm on a bow of 5 µm makes its range 0.3 µm larger, the middle of the interval not."""
    rng = np.random.default_rng(seed)
    truth = 5e-6 * BOW / np.ptp(BOW)
    found = level(truth + 1e-7 * rng.normal(size=X.size))
    low, high = range_bounds(found, 1e-14 * np.eye(X.size))
    assert np.ptp(found) > 5.15e-6
    assert abs((low + high) / 2 - 5e-6) < 0.2e-6


@pytest.mark.parametrize("size", [1e-8, 1e-7])
def test_the_largest_difference_of_one_uncertain_mode(size: float) -> None:
    """A difference a times a wave with a normal: 95 % stay below 1.96 standard deviations of its largest value."""
    wave = level(np.sin(9 * X))
    spread = size**2 * np.outer(wave, wave)
    curve = 5e-6 * BOW
    same = compare_profiles(profile(curve, spread), profile(curve + 3e-5 * X - 1e-6, np.zeros((401, 401))))
    points = np.interp(same.positions, X, wave)
    points = points - np.polyval(np.polyfit(same.positions, points, 1), same.positions)
    assert same.largest < 1e-15
    assert same.probability == 1.0
    assert same.bound == pytest.approx(1.96 * size * np.abs(points).max(), rel=0.06)
    off = compare_profiles(profile(curve + 2.58 * size * wave, spread), profile(curve, np.zeros((401, 401))))
    assert off.largest == pytest.approx(2.58 * size * np.abs(points).max(), rel=0.01)
    assert off.probability == pytest.approx(0.01, abs=0.006)
    np.testing.assert_allclose(off.uncertainty, size * np.abs(points), atol=0.03 * size)
    both = compare_profiles(profile(curve, spread), profile(curve, spread))
    assert both.bound == pytest.approx(np.sqrt(2) * same.bound, rel=0.06)


def test_profiles_elsewhere_are_refused() -> None:
    here = profile(BOW, np.eye(401) * 1e-16)
    there = SplicedProfile(X + 0.5, X, BOW, np.eye(401) * 1e-16, np.zeros(1), np.zeros(1), (), ())
    with pytest.raises(InputError, match=r"0.3 m in common, of 0.8 m; at least half is needed"):
        compare_profiles(here, there)
