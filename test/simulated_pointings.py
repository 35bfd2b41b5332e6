"""A two-axis mount of exact geometry, and the pointing file that it would write.

It shares no formula with twin and diagnosis: rotations are multiplied by scipy, in a frame of its own (x to the equator
in the south, y east, z to the pole).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

LATITUDE = float(np.radians(39.0 + 25 / 3600))
SIDEREAL_DAY = 86164.0905

USUAL_GEOMETRY = (0.09, -0.02, 0.004, -0.006, 0.003, -0.005)
"""Both indices, orthogonality, collimation, tilt of the hour axis about x and y, rad."""


@dataclass(frozen=True)
class MountPose:
    """Where the mount stands: vectors (n, 3) in this module's frame, time (n,) s, readings (n, 2) rad."""

    polar: Array
    declination: Array
    tube: Array
    up: Array
    time: Array
    readings: Array


Turn = Callable[[MountPose], Array]
"""What a fault does: a rotation vector (n, 3) of the tube, rad."""


@dataclass(frozen=True)
class Pointings:
    """Stars (n, 2) at hour angle and declination, readings (n, 2) and sidereal time (n,), all rad."""

    stars: Array
    readings: Array
    sidereal: Array


def simulate_pointings(
    seed: int,
    count: int = 160,
    geometry: tuple[float, ...] = USUAL_GEOMETRY,
    turn: Turn | None = None,
    noise: float = 5e-5,
    kept: float = 0.0,
) -> Pointings:
    """The stars that a mount with this geometry and fault finds at random readings, on both sides of the pier.

    Of the noise of a pointing the next one has the part `kept`.
    """
    rng = np.random.default_rng(seed)
    index_h, index_d, orthogonality, collimation, tilt_x, tilt_y = geometry
    other = rng.random(count) < 0.5
    hour, declination = rng.uniform(-1.45, 1.45, count), rng.uniform(-0.25, 1.35, count)
    readings = np.column_stack([np.where(other, hour + np.pi, hour), np.where(other, np.pi - declination, declination)])
    readings -= [index_h, index_d]
    sidereal = np.sort(rng.uniform(4.0, 5.2, count))
    tilt = Rotation.from_rotvec([tilt_x, tilt_y, 0])
    about_pole = Rotation.from_rotvec(np.outer(readings[:, 0] + index_h, [0, 0, -1]))
    on_hour_axis = tilt * about_pole * Rotation.from_rotvec([orthogonality, 0, 0])
    about_declination = Rotation.from_rotvec(np.outer(readings[:, 1] + index_d, [0, -1, 0]))
    pose = MountPose(
        polar=np.tile(tilt.apply([0, 0, 1]), (count, 1)),
        declination=on_hour_axis.apply([0, -1, 0]),
        tube=(on_hour_axis * about_declination).apply([np.cos(collimation), np.sin(collimation), 0]),
        up=np.tile([np.cos(LATITUDE), 0, np.sin(LATITUDE)], (count, 1)),
        time=(sidereal - sidereal.mean()) * SIDEREAL_DAY / (2 * np.pi),
        readings=readings,
    )
    tube = pose.tube if turn is None else Rotation.from_rotvec(turn(pose)).apply(pose.tube)
    stars = np.column_stack([np.arctan2(-tube[:, 1], tube[:, 0]), np.arcsin(tube[:, 2])])
    stars[:, 0] += noise * _following(rng.normal(size=count), kept) / np.cos(stars[:, 1])
    stars[:, 1] += noise * _following(rng.normal(size=count), kept)
    return Pointings(stars, readings, sidereal)


def _following(noise: Array, kept: float) -> Array:
    """Noise (n,) of the same variance of which each has a part of the one before."""
    for i in range(1, len(noise) if kept else 0):
        noise[i] = kept * noise[i - 1] + np.sqrt(1 - kept**2) * noise[i]
    return noise


def pointing_file(pointings: Pointings, pressure: float = 0.0) -> str:
    """Content of a pointing file; there is no refraction without pressure (hPa)."""
    lines = ["!made by the plant", "Mount", ":NODA", ":EQUAT"]
    lines.append(f"+39 00 25 2026 1 1 10.00 {pressure:.2f} 200.00 0.50 0.5500 0.0065")
    for (hour, declination), (read_h, read_d), time in zip(
        pointings.stars, pointings.readings, pointings.sidereal, strict=True
    ):
        star, mount = _hours(time - hour), _hours(time - read_h)
        minutes = time * 720 / np.pi
        clock = f"{int(minutes // 60):02d} {minutes % 60:08.5f}"
        wrapped = float(np.mod(read_d + np.pi, 2 * np.pi) - np.pi)
        lines.append(f"{star} {_degrees(declination)} {mount} {_degrees(wrapped)} {clock}")
    return "\n".join(lines) + "\n"


def _hours(angle: float) -> str:
    total = float(np.mod(angle, 2 * np.pi)) * 43200 / np.pi
    return f"{int(total // 3600):02d} {int(total % 3600 // 60):02d} {total % 60:08.5f}"


def _degrees(angle: float) -> str:
    total = abs(angle) * 648000 / np.pi
    return f"{'-' if angle < 0 else '+'}{int(total // 3600):02d} {int(total % 3600 // 60):02d} {total % 60:08.5f}"
