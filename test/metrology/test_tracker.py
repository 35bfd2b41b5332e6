"""Tracker readings to points: by hand, and the covariance against simulated readings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.tracker import TrackerNoise, estimate_point_covariance, estimate_points


def test_points_by_hand() -> None:
    distance = np.array([2.0, 2.0, 1.0, 4.0])
    elevation = np.array([0.0, 0.0, math.pi / 2, math.pi / 6])
    azimuth = np.array([0.0, math.pi / 2, 1.0, math.pi])
    expected = [[2, 0, 0], [0, 2, 0], [0, 0, 1], [-4 * math.cos(math.pi / 6), 0, 2]]
    np.testing.assert_allclose(estimate_points(distance, elevation, azimuth), expected, atol=1e-15)


def test_covariance_against_simulated_readings() -> None:
    rng = np.random.default_rng(0)
    noise = TrackerNoise(distance=2e-6, distance_relative=0.5e-6, elevation=3e-6, azimuth=4e-6)
    reading = np.array([3.0, 0.4, -1.1])
    count = 200_000
    spread = np.array([math.hypot(2e-6, 1.5e-6), 3e-6, 4e-6])
    samples = reading + spread * rng.normal(size=(count, 3))
    points = estimate_points(*samples.T)
    covariance = estimate_point_covariance(*reading[:, None], noise)
    scale = np.sqrt(np.outer(np.diag(covariance[0]), np.diag(covariance[0])))
    np.testing.assert_allclose(np.cov(points.T) / scale, covariance[0] / scale, atol=0.02)


@pytest.mark.parametrize(
    ("reading", "message"),
    [
        (([1.0], [0.0], [0.0, 1.0]), "do not fit"),
        (([1.0, 0.0], [0.0, 0.0], [0.0, 0.0]), "distance of reading 1 is 0 m"),
        (([1.0], [45.0], [0.0]), "is it in degrees"),
        (([1.0], [math.nan], [0.0]), "elevation of reading 0 is not finite"),
    ],
)
def test_bad_readings_are_refused(reading: tuple[list[float], ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        estimate_points(*(np.array(values) for values in reading))
