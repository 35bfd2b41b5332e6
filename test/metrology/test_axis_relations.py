"""Relations of axes against closed forms, and their bounds against draws of what was measured."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import rice

from rotary_error_monitor.metrology.axis_fits import LineFit, estimate_squareness, fit_axis_average_line
from rotary_error_monitor.metrology.axis_relations import (
    concentricity,
    coplanarity,
    distance_alike,
    parallelism,
    perpendicularity,
    size_bounds,
    squareness,
)

Array = NDArray[np.float64]


def line(point: Array, direction: Array, shift: float = 0.0, tilt: float = 0.0) -> LineFit:
    """A line whose point and direction are known to `shift` m and `tilt` rad across it."""
    unit = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    across = np.eye(3) - np.outer(unit, unit)
    return LineFit(np.asarray(point, dtype=np.float64), unit, shift**2 * across, tilt**2 * across, 0.0)


TURNS = [Rotation.identity(), Rotation.from_rotvec([0.4, -0.8, 2.1])]


@pytest.mark.parametrize("turn", TURNS, ids=["straight", "turned"])
def test_closed_forms(turn: Rotation) -> None:
    """Lines with known tilts and places, wherever the tracker stands."""
    x = line(turn.apply([3, 0, 0]), turn.apply([1, 0, 0]), tilt=1e-6)
    y = line(turn.apply([0, 2, 0]), turn.apply([5.2e-5, 1, 0]), tilt=2e-6)
    c = line(turn.apply([0, 0, 4]), turn.apply([1.2e-5, -1.6e-5, 1]), shift=1e-6, tilt=1e-6)
    a = line(turn.apply([0.7, 2e-5, 0.1]), turn.apply([1, 0, 7e-5]), shift=2e-6)
    spindle = line(turn.apply([1.4e-5, 0, -0.35]), turn.apply([0, 0, -1]), shift=3e-6)
    found = squareness(y, x)
    assert found.value == pytest.approx(-5.2e-5, rel=1e-8)
    assert found.uncertainty == pytest.approx(math.hypot(1e-6, 2e-6), rel=1e-6)
    assert found.value == pytest.approx(estimate_squareness(y, x).angle, rel=1e-9)
    assert found.high - found.value == pytest.approx(1.959964 * found.uncertainty, rel=1e-6)
    assert perpendicularity(c, x, y).value == pytest.approx(2e-5, rel=1e-6)
    assert parallelism(spindle, c).value == pytest.approx(2e-5, rel=1e-6)
    # A runs along x at y = 20 µm; C leans to y = 4 * 16 µrad there, all in the plane across both.
    apart = coplanarity(a, c)
    normal = np.cross([1, 0, 7e-5], [1.2e-5, -1.6e-5, 1])
    expected = np.array([0.7, 2e-5, 0.1 - 4.0]) @ normal / np.linalg.norm(normal)
    assert apart.value == pytest.approx(expected, rel=1e-9)
    assert coplanarity(a, c, nominal=1e-5).value == pytest.approx(expected - 1e-5, rel=1e-9)
    # At the height of -0.35 m C has gone 4.35 m from its point, by its tilt.
    at = turn.apply([0, 0, -0.35])
    away = np.array([1.4e-5 + 4.35 * 1.2e-5, -4.35 * 1.6e-5])
    assert concentricity(spindle, c, at).value == pytest.approx(float(np.linalg.norm(away)), rel=1e-6)
    far = line(turn.apply([0.5, 0, -0.35]), turn.apply([0, 0, 1]), shift=3e-6)
    apart = distance_alike(far, c, at, nominal=0.5)
    assert apart.value == pytest.approx(math.hypot(0.5 + 4.35 * 1.2e-5, 4.35 * 1.6e-5) - 0.5, rel=1e-6)
    assert apart.uncertainty == pytest.approx(math.sqrt(3e-6**2 + 1e-6**2 + 4.35e-6**2), rel=1e-3)


def test_what_point_and_direction_have_in_common_counts() -> None:
    """Two rings 0.3 m apart: midway between them the axis is known better than at either, by the square root of 2."""
    rng = np.random.default_rng(3)
    turns = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    ring = 0.2 * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    covariances = np.tile((1e-6) ** 2 * np.eye(3), (24, 1, 1))
    rings = [ring + 1e-6 * rng.normal(size=ring.shape), ring + [0, 0, 0.3] + 1e-6 * rng.normal(size=ring.shape)]
    axis = fit_axis_average_line(rings, [covariances, covariances])
    spreads = [math.sqrt(np.trace(axis.moved_along(s).point_covariance) / 2) for s in (0.0, 0.15, 0.3)]
    # A circle's centre by n points: sigma times sqrt(2 / n) each way.
    alone = 1e-6 * math.sqrt(2 / 24)
    # Each ring's plane adds to the direction: the middle does not lose by it, the ends gain.
    assert spreads[1] == pytest.approx(alone / math.sqrt(2), rel=0.02)
    assert spreads[0] == pytest.approx(spreads[2], rel=0.02)
    assert alone / math.sqrt(2) < spreads[0] < alone
    back = axis.moved_along(0.3).moved_along(-0.3)
    np.testing.assert_allclose(back.point_covariance, axis.point_covariance, rtol=1e-6, atol=1e-20)


@pytest.mark.parametrize("ratio", [1.3, 2.0, 5.0, 15.0, 30.0])
def test_bounds_of_a_size_are_those_of_rice(ratio: float) -> None:
    """Alike in both directions, a measured size has Rice's distribution: both bounds by its own quantiles."""
    sigma = 2e-6
    low, high = size_bounds(np.array([0.6, 0.8]) * ratio * sigma, sigma**2 * np.eye(2))
    for bound, probability in ((low, 0.975), (high, 0.025)):
        if bound > 0:
            assert rice.cdf(ratio, bound / sigma) == pytest.approx(probability, abs=2e-3)
        else:
            assert rice.cdf(ratio, 0.0) <= probability


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.2, 1.0])
def test_a_size_below_that_of_noise_alone_has_the_upper_bound_of_its_median(ratio: float) -> None:
    """By Rayleigh's and Rice's distributions; the median is sqrt(2 ln 2), and no size is sure to be near zero."""
    sigma, median = 2e-6, math.sqrt(2 * math.log(2))
    low, high = size_bounds(np.array([0.6, 0.8]) * ratio * sigma, sigma**2 * np.eye(2))
    assert low == 0.0
    assert rice.cdf(median, high / sigma) == pytest.approx(0.025, abs=2e-3)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("ratio", [0.0, 0.3])
def test_bounds_of_a_size_of_next_to_nothing(ratio: float, seed: int) -> None:
    """Only lower bounds can miss: 2.5 % of 1000, which chance makes 1 to 4.5 %; the found size is within its bounds."""
    rng = np.random.default_rng([seed, 7])
    truth, covariance = np.array([ratio, 0.0]), np.diag([1.0, 0.7])
    missed = 0
    for measured in rng.multivariate_normal(truth, covariance, 1000):
        low, high = size_bounds(measured, covariance)
        missed += not low <= ratio <= high
        assert low <= np.linalg.norm(measured) <= high
    assert 0.01 < missed / 1000 < 0.045


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("ratio", [1.0, 3.0, 10.0])
def test_bounds_of_a_size_hold_the_truth(ratio: float, seed: int) -> None:
    """1000 draws with a covariance that is no circle: at least 95 % but for chance, and not much more.

    By chance the rate scatters by 0.7 %. A direction that the likeliest one misses makes the bounds wider, up to 99 %.
    """
    rng = np.random.default_rng([seed, int(ratio)])
    turn = Rotation.from_rotvec([0, 0, rng.uniform(0, math.pi)]).as_matrix()[:2, :2]
    covariance = turn @ np.diag([1.0, 0.4]) ** 2 @ turn.T
    direction = rng.uniform(0, 2 * math.pi)
    truth = ratio * np.array([math.cos(direction), math.sin(direction)])
    held = 0
    for measured in rng.multivariate_normal(truth, covariance, 1000):
        low, high = size_bounds(measured, covariance)
        held += low <= ratio <= high
    assert 0.93 < held / 1000 < 0.995


def test_a_size_that_is_known_exactly_has_its_bounds_there() -> None:
    assert size_bounds(np.array([3e-6, 4e-6]), np.zeros((2, 2))) == pytest.approx((5e-6, 5e-6))
