"""Sums of harmonics over a rotation."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import AngularHarmonic, PlanarHarmonic

_AT_ONCE = 1 << 10
"""Products of harmonics and rotations up to which all are computed at once: a loop costs by the operation, above that
an operation costs by the number."""


def planar_sum(harmonics: tuple[PlanarHarmonic, ...], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) sum of plane harmonics at rotations `theta` (n,) rad; the same bits for each however many there are."""
    total = np.zeros((len(theta), 2))
    if 0 < len(harmonics) * len(theta) <= _AT_ONCE:
        orders, by_cos, by_sin = _columns(harmonics)
        angles = orders * theta
        waves = by_cos * np.cos(angles)[:, None] + by_sin * np.sin(angles)[:, None]
        for wave in waves:  # one after another, as below
            total += wave.T
        return total
    for row in harmonics:
        cos, sin = np.cos(row.order * theta), np.sin(row.order * theta)
        total[:, 0] += row.x[0] * cos + row.x[1] * sin
        total[:, 1] += row.y[0] * cos + row.y[1] * sin
    return total


@lru_cache(maxsize=64)
def _columns(
    harmonics: tuple[PlanarHarmonic, ...],
) -> tuple[NDArray[np.float64] | NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Orders (h, 1), and what cosine and sine of each are multiplied by, (h, 2, 1)."""
    weights = np.array([[row.x, row.y] for row in harmonics])[..., None]
    return np.array([[row.order] for row in harmonics]), weights[:, :, 0], weights[:, :, 1]


def angular_sum(harmonics: tuple[AngularHarmonic, ...], psi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of angular harmonics at ring positions `psi`, rad, of any shape."""
    total = np.zeros(psi.shape)
    for row in harmonics:
        total += row.cos * np.cos(row.order * psi) + row.sin * np.sin(row.order * psi)
    return total
