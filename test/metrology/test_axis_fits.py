"""Fits against made points: exact without noise, and errors as large as their covariance says with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.axis_fits import (
    LineFit,
    estimate_location_errors,
    estimate_squareness,
    fit_axis_average_line,
    fit_line_in_space,
)

Array = NDArray[np.float64]
TILT = Rotation.from_euler("xyz", [0.3, -0.4, 0.9]).as_matrix()
ORIGIN = np.array([2.0, -1.0, 0.5])


def noise(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Noise of different size in each direction, and its covariances."""
    lower = TILT.T @ np.diag([1e-6, 3e-6, 8e-6])
    return rng.normal(size=(count, 3)) @ lower.T, np.broadcast_to(lower @ lower.T, (count, 3, 3))


def ring(angles: Array, radius: float, height: float) -> Array:
    local = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full_like(angles, height)], axis=1)
    return ORIGIN + local @ TILT.T


def test_exact_points_give_exact_fits() -> None:
    line = fit_line_in_space(ORIGIN + np.linspace(-1, 2, 9)[:, None] * TILT[:, 0])
    np.testing.assert_allclose(line.direction, TILT[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.cross(line.point - ORIGIN, TILT[:, 0]), 0, atol=1e-12)
    back = fit_line_in_space(ORIGIN + np.linspace(2, -1, 9)[:, None] * TILT[:, 0])
    np.testing.assert_allclose(back.direction, -TILT[:, 0], atol=1e-12)

    axis = fit_axis_average_line([ring(np.linspace(0, 2, 12), 0.3, 0.1)])
    np.testing.assert_allclose(axis.direction, TILT[:, 2], atol=1e-9)
    np.testing.assert_allclose(np.cross(axis.point - ORIGIN, TILT[:, 2]), 0, atol=1e-9)


def test_turning_the_other_way_turns_the_axis() -> None:
    axis = fit_axis_average_line([ring(-np.linspace(0, 5, 12), 0.3, 0.0)])
    np.testing.assert_allclose(axis.direction, -TILT[:, 2], atol=1e-9)


def normalised(error: Array, covariance: Array) -> float:
    """Square of the error over its covariance, on the two or three dimensions that the covariance has."""
    return float(error @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ error)


def test_line_errors_are_what_the_covariance_says() -> None:
    rng = np.random.default_rng(1)
    along = np.linspace(-1, 2, 15)
    squares = []
    for _ in range(300):
        added, covariances = noise(rng, 15)
        line = fit_line_in_space(ORIGIN + along[:, None] * TILT[:, 0] + added, covariances)
        squares.append(normalised(line.direction - TILT[:, 0], line.direction_covariance))
    # Chi-square with two degrees of freedom: mean 2; the mean of 300 scatters by 2 / sqrt(300).
    assert np.mean(squares) == pytest.approx(2, abs=0.4)


def test_axis_average_line_errors_are_what_the_covariance_says() -> None:
    rng = np.random.default_rng(2)
    angles = np.linspace(0, 2 * math.pi, 13)[:-1]
    directions, points, single = [], [], []
    for _ in range(200):
        tracks, weights = [], []
        for radius, height in ((0.4, 0.0), (0.25, 0.6)):
            added, covariances = noise(rng, 12)
            tracks.append(ring(angles, radius, height) + added)
            weights.append(covariances)
        line = fit_axis_average_line(tracks, weights)
        directions.append(normalised(line.direction - TILT[:, 2], line.direction_covariance))
        away = line.point - ORIGIN
        away = away - (away @ TILT[:, 2]) * TILT[:, 2]
        points.append(normalised(away, line.point_covariance))
        one = fit_axis_average_line(tracks[:1], weights[:1])
        single.append(np.trace(one.direction_covariance) / np.trace(line.direction_covariance))
    assert np.mean(directions) == pytest.approx(2, abs=0.5)
    assert np.mean(points) == pytest.approx(2, abs=0.5)
    assert min(single) > 1


def test_scatter_without_covariances_gives_them() -> None:
    rng = np.random.default_rng(3)
    points = ORIGIN + np.linspace(0, 1, 400)[:, None] * TILT[:, 0] + 5e-6 * rng.normal(size=(400, 3))
    line = fit_line_in_space(points)
    # Variance of a slope: s² / sum of squared lever arms, in each of two directions.
    expected = 2 * (5e-6) ** 2 / (400 * (1 / 12))
    assert np.trace(line.direction_covariance) == pytest.approx(expected, rel=0.15)
    assert line.scatter == pytest.approx(5e-6 * math.sqrt(2), rel=0.1)


def line_along(direction: Array, point: Array | None = None, spread: float = 0.0) -> LineFit:
    unit = direction / np.linalg.norm(direction)
    across = spread**2 * (np.eye(3) - np.outer(unit, unit))
    return LineFit(np.zeros(3) if point is None else point, unit, across, across, 0.0)


def test_squareness_sign_and_uncertainty() -> None:
    x = line_along(np.array([1.0, 0.0, 0.0]), spread=2e-6)
    # 89.998 degrees between X and Y, as in Pan et al. 2013, Section 6: the angle is smaller than 90 degrees.
    angle = math.radians(89.998)
    y = line_along(np.array([math.cos(angle), math.sin(angle), 0.0]), spread=3e-6)
    squareness = estimate_squareness(x, y)
    assert squareness.angle == pytest.approx(-34.907e-6, rel=1e-4)
    assert squareness.uncertainty == pytest.approx(math.hypot(2e-6, 3e-6), rel=1e-6)


def test_location_errors_of_a_c_axis() -> None:
    a0c, b0c = 20e-6, -30e-6
    direction = Rotation.from_rotvec([a0c, b0c, 0.0]).as_matrix() @ np.array([0.0, 0.0, 1.0])
    # The line passes 12 µm and -7 µm beside the nominal point, and is told at a point half a metre below.
    point = np.array([12e-6, -7e-6, 0.0]) - 0.5 * direction + np.array([0.1, 0.2, 0.3])
    errors = estimate_location_errors(
        line_along(direction, point, spread=1e-6), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0])
    )
    np.testing.assert_allclose(errors.shift, [12e-6, -7e-6, 0.0], atol=1e-12)
    np.testing.assert_allclose(errors.rotation, [a0c, b0c, 0.0], atol=1e-12)
    np.testing.assert_allclose(errors.shift_uncertainty, [math.sqrt(1.25) * 1e-6] * 2 + [0.0], rtol=1e-4, atol=1e-10)
    np.testing.assert_allclose(errors.rotation_uncertainty, [1e-6, 1e-6, 0.0], rtol=1e-4, atol=1e-10)
    other = line_along(-direction, point)
    np.testing.assert_allclose(
        estimate_location_errors(other, np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0])).rotation,
        errors.rotation,
        atol=1e-15,
    )


def test_bad_points_are_refused() -> None:
    straight = np.linspace(0, 1, 6)[:, None] * np.array([[1.0, 2.0, 3.0]])
    with pytest.raises(InputError, match="needs at least 3"):
        fit_line_in_space(np.zeros((2, 3)))
    with pytest.raises(InputError, match="coincide"):
        fit_line_in_space(np.ones((5, 3)))
    with pytest.raises(InputError, match="on one line"):
        fit_axis_average_line([straight])
    with pytest.raises(InputError, match=r"expected \(n, 3\)"):
        fit_axis_average_line([np.zeros((5, 2))])
    with pytest.raises(InputError, match="covariances of shape"):
        fit_axis_average_line([ring(np.arange(5.0), 1, 0)], [np.zeros((4, 3, 3))])
    with pytest.raises(InputError, match="point 2 is not finite"):
        bad = ring(np.arange(5.0), 1, 0)
        bad[2, 1] = math.nan
        fit_axis_average_line([bad])
    with pytest.raises(InputError, match="no track"):
        fit_axis_average_line([])
    with pytest.raises(InputError, match="another axis"):
        estimate_location_errors(line_along(np.array([1.0, 0, 1.0])), np.zeros(3), np.array([0.0, 0.0, 1.0]))
