"""Sums of harmonics over a rotation."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.metrology.kernel import Waves, chosen_kernel

_AT_ONCE = 1 << 10
"""Products of harmonics and rotations up to which all are computed at once: a loop costs by the operation, above that
an operation costs by the number."""


def planar_sum(harmonics: tuple[PlanarHarmonic, ...], theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) sum of plane harmonics at rotations `theta` (n,) rad; the same bits for each however many there are."""
    total = np.zeros((len(theta), 2))
    if not harmonics:
        return total
    if len(harmonics) * len(theta) <= _AT_ONCE:
        orders, by_cos, by_sin, packed = _columns(harmonics)
        angles, kernel = orders * theta, chosen_kernel()
        if kernel is not None:
            return kernel.wave_sum(packed, angles)
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
) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.float64], Waves]:
    """Orders (h, 1), what cosine and sine of each are multiplied by, (h, 2, 1), and all of it for the library."""
    weights = np.array([[row.x, row.y] for row in harmonics])[..., None]
    orders, (by_cos, by_sin) = [row.order for row in harmonics], (weights[:, :, i] for i in range(2))
    return np.array(orders)[:, None], by_cos, by_sin, Waves(orders, by_cos[..., 0], by_sin[..., 0])


def angular_sum(harmonics: tuple[AngularHarmonic, ...], psi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of angular harmonics at ring positions `psi`, rad, of any shape."""
    kernel = chosen_kernel()
    if kernel is not None and 0 < len(harmonics) * psi.size <= _AT_ONCE:
        packed = _waves(harmonics)
        return kernel.wave_sum(packed, packed.orders * psi.ravel()).reshape(psi.shape)
    total = np.zeros(psi.shape)
    for row in harmonics:
        total += row.cos * np.cos(row.order * psi) + row.sin * np.sin(row.order * psi)
    return total


@lru_cache(maxsize=64)
def _waves(harmonics: tuple[AngularHarmonic, ...]) -> Waves:
    return Waves([row.order for row in harmonics], [row.cos for row in harmonics], [row.sin for row in harmonics])
