"""What the instruments see of a displaced, tilted rotor: exact geometry, without any expansion in small quantities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .rotor import Components

Array = NDArray[np.float64]
BALL = 0.0127  # m, radius of the ball that the two styli of the LVDT touch


def rotate(x: Array, y: Array, vectors: Array) -> Array:
    """(n, 3) `vectors` turned by the rotation vector (x, y, 0), each (n,): Rodrigues' formula."""
    angle = np.hypot(x, y)
    sinc = np.sinc(angle / np.pi)
    versed = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    vx, vy, vz = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    along = versed * (x * vx + y * vy)
    kept = 1.0 - versed * angle**2
    return np.stack(
        [
            kept * vx + sinc * y * vz + along * x,
            kept * vy - sinc * x * vz + along * y,
            kept * vz + sinc * (x * vy - y * vx),
        ],
        axis=-1,
    )


def turned(theta: Array, vector: Sequence[float]) -> tuple[Array, Array]:
    """Components x and y, each (n,), of a rotor vector [x, y] in the frame of the base."""
    cos, sin = np.cos(theta), np.sin(theta)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]


def head_reading(pose: Components, azimuth: float, encoder: Mapping[str, Any]) -> Array:
    """(n,) angle that a head reads.

    The head's line of sight leads through the origin of the base at its azimuth. It cuts the ring, a cylinder with
    lines along its axis, that sits eccentrically on the rotor. All vectors are in the frame of the base turned back
    by the tilt.
    """
    ex, ey = turned(pose.theta, encoder.get("eccentricity", (0.0, 0.0)))
    centre = rotate(-pose.eac, -pose.ebc, np.stack([pose.exc, pose.eyc, pose.ezc], axis=-1))
    sight = rotate(-pose.eac, -pose.ebc, np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    ax, ay = sight[:, 0], sight[:, 1]
    bx, by = centre[:, 0] + ex, centre[:, 1] + ey
    # |s a - b| = radius, the cut on the head's side
    square, mixed = ax * ax + ay * ay, ax * bx + ay * by
    s = (mixed + np.sqrt(mixed**2 - square * (bx * bx + by * by - encoder["disc_radius"] ** 2))) / square
    qx, qy = s * ax - bx, s * ay - by
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    lead = np.arctan2(cos * qy - sin * qx, cos * qx + sin * qy)  # of the line read, before the head's azimuth
    error = _graduation(azimuth + lead - pose.theta, encoder.get("graduation", []))
    return np.asarray(pose.theta - lead + error, float)


def _graduation(psi: Array, rows: Sequence[Mapping[str, Any]]) -> Array:
    """(n,) error of the graduation at the angle `psi` on the ring."""
    error = np.zeros(len(psi))
    for row in rows:
        error += row["cos"] * np.cos(row["order"] * psi) + row["sin"] * np.sin(row["order"] * psi)
    return error


def autocollimator_reading(pose: Components, mirror: Mapping[str, Any]) -> Array:
    """(n, 2) tilt_x, tilt_y: half the place of the image of a ray that the mirror reflects."""
    tx, ty = turned(pose.theta, mirror.get("tilt", (0.0, 0.0)))
    ones = np.zeros((len(pose.theta), 3))
    ones[:, 2] = 1.0
    fx, fy = _flatness(pose.theta, mirror.get("flatness", []))
    # The mirror's tilt turns with the rotor: exp(Rz m) = Rz exp(m) Rz^-1, and Rz^-1 leaves the normal as it is.
    normal = rotate(pose.eac, pose.ebc, rotate(fx, fy, rotate(tx, ty, ones)))
    # The ray comes along -z; reflected it is -z + 2 n_z n.
    ray = 2.0 * normal[:, 2:] * normal
    depth = ray[:, 2] - 1.0
    return np.stack([-0.5 * ray[:, 1] / depth, 0.5 * ray[:, 0] / depth], axis=-1)


def _flatness(theta: Array, rows: Sequence[Mapping[str, Any]]) -> tuple[Array, Array]:
    """Slope of the mirror's surface as rotation vector components x and y, each (n,)."""
    slope = np.zeros((2, len(theta)))
    for row in rows:
        cos, sin = np.cos(row["order"] * theta), np.sin(row["order"] * theta)
        slope[0] += row["x"][0] * cos + row["x"][1] * sin
        slope[1] += row["y"][0] * cos + row["y"][1] * sin
    return slope[0], slope[1]


def lvdt_reading(pose: Components, lvdt: Mapping[str, Any]) -> Array:
    """(n, 2) radial_x, radial_y: two styli, along x and y at the stated height, touch a ball on the rotor."""
    height = float(lvdt["height"])
    ax, ay = turned(pose.theta, lvdt.get("artefact_eccentricity", (0.0, 0.0)))
    arm = rotate(pose.eac, pose.ebc, np.stack([ax, ay, np.full(len(ax), height)], axis=-1))
    x, y, z = pose.exc + arm[:, 0], pose.eyc + arm[:, 1], pose.ezc + arm[:, 2] - height
    # sqrt(BALL² - w) - BALL without cancellation
    return np.stack([x - _sag(y * y + z * z), y - _sag(x * x + z * z)], axis=-1)


def _sag(square: Array) -> Array:
    """How much less far a ball reaches, a distance aside of its centre whose square is given."""
    return square / (BALL + np.sqrt(BALL**2 - square))
