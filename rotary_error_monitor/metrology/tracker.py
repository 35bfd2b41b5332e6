"""Laser tracker: spherical readings with their covariance to points (Pan et al. 2013, Equation 16)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError


@dataclass(frozen=True)
class TrackerNoise:
    """Standard uncertainties of a reading, uncorrelated.

    Attributes:
        distance: m, the part that does not depend on the distance.
        distance_relative: the part proportional to the distance, m per m.
        elevation, azimuth: rad.
    """

    distance: float
    distance_relative: float
    elevation: float
    azimuth: float


def estimate_points(distance: Array, elevation: Array, azimuth: Array) -> Array:
    """(n, 3) points in the tracker's frame, m, from distance ρ (m), elevation α and azimuth β (rad), each (n,).

    x = ρ cos α cos β, y = ρ cos α sin β, z = ρ sin α.

    Raises:
        InputError: shapes differ, a number is not finite, a distance is not positive or an elevation beyond ±90°.
    """
    if not distance.shape == elevation.shape == azimuth.shape or distance.ndim != 1:
        raise InputError(f"shapes {distance.shape}, {elevation.shape}, {azimuth.shape} of tracker readings do not fit")
    for name, values in (("distance", distance), ("elevation", elevation), ("azimuth", azimuth)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} of reading {int(np.argmin(np.isfinite(values)))} is not finite")
    if np.any(distance <= 0):
        at = int(np.argmin(distance))
        raise InputError(f"distance of reading {at} is {distance[at]:g} m; it must be above 0")
    if np.any(np.abs(elevation) > np.pi / 2):
        at = int(np.argmax(np.abs(elevation)))
        raise InputError(f"elevation of reading {at} is {elevation[at]:g} rad, beyond ±90°; is it in degrees?")
    level = distance * np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


def estimate_readings(points: Array) -> tuple[Array, Array, Array]:
    """Distance (m), elevation and azimuth (rad), each (n,), of points (n, 3) in the tracker's frame, m."""
    level = np.hypot(points[:, 0], points[:, 1])
    azimuth, elevation = np.arctan2(points[:, 1], points[:, 0]), np.arctan2(points[:, 2], level)
    return np.hypot(level, points[:, 2]), elevation, azimuth


def estimate_point_covariance(distance: Array, elevation: Array, azimuth: Array, noise: TrackerNoise) -> Array:
    """(n, 3, 3) covariance of the points of `estimate_points`, m², by propagation of the readings' uncertainties."""
    sin_e, cos_e, sin_a, cos_a = np.sin(elevation), np.cos(elevation), np.sin(azimuth), np.cos(azimuth)
    zero = np.zeros_like(distance)
    jacobian = np.stack(
        [
            np.stack([cos_e * cos_a, -distance * sin_e * cos_a, -distance * cos_e * sin_a], axis=1),
            np.stack([cos_e * sin_a, -distance * sin_e * sin_a, distance * cos_e * cos_a], axis=1),
            np.stack([sin_e, distance * cos_e, zero], axis=1),
        ],
        axis=1,
    )
    variance = np.stack(
        [
            noise.distance**2 + (noise.distance_relative * distance) ** 2,
            zero + noise.elevation**2,
            zero + noise.azimuth**2,
        ],
        axis=1,
    )
    return np.asarray((jacobian * variance[:, None, :]) @ np.swapaxes(jacobian, 1, 2), dtype=np.float64)
