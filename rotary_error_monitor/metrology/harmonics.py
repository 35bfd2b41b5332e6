"""Sums of harmonics over a rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import AngularHarmonic, PlanarHarmonic


def planar_sum(harmonics: tuple[PlanarHarmonic, ...], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) sum of plane harmonics at rotations `theta` (n,) rad."""
    total = np.zeros((len(theta), 2))
    for row in harmonics:
        cos, sin = np.cos(row.order * theta), np.sin(row.order * theta)
        total[:, 0] += row.x[0] * cos + row.x[1] * sin
        total[:, 1] += row.y[0] * cos + row.y[1] * sin
    return total


def angular_sum(harmonics: tuple[AngularHarmonic, ...], psi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of angular harmonics at ring positions `psi`, rad, of any shape."""
    total = np.zeros(psi.shape)
    for row in harmonics:
        total += row.cos * np.cos(row.order * psi) + row.sin * np.sin(row.order * psi)
    return total
