"""The compiled form of what heads show at the ticks, where it was built; numpy computes the same bits.

A block of 5 ms has five ticks, for which numpy takes longer to be called than to compute. `compiled/kernel.c` does the
operations of `encoder_heads` and `error_motion` on the same numbers in the same order.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_double, c_int64, c_void_p
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.libraries import REALS, address, is_plain, kernel_of

MOST_HEADS = 7  # as in compiled/kernel.c


class LayoutStructure(ctypes.Structure):
    """`layout` of compiled/kernel.c."""

    _fields_ = (
        ("heads", c_int64),
        ("redundancy", c_int64),
        ("sum", c_double),
        *((name, c_void_p) for name in ("weights", "products", "parity", "projector", "view")),
    )


class Steps(NamedTuple):
    """Noise and rounding of an instrument as `reading_variance` has them: variance of the noise, step, its square, and
    the part of the rounding that noise does not break up.
    """

    noise: float
    resolution: float
    square: float
    unbroken: float


class PackedLayout:
    """Heads as the library takes them, and the arrays that it points to."""

    def __init__(self, redundancy: int, *, sees_less: bool, arrays: Sequence[Array]) -> None:
        """Weights, products, parity, projector and view of a layout; `sees_less` where heads see less than a centre."""
        self._kept = [np.ascontiguousarray(array, np.float64) for array in arrays]
        weights = self._kept[0]
        places = [address(array) for array in self._kept]
        self.layout = LayoutStructure(weights.shape[1], redundancy, float(weights[0].sum()), *places)
        self.heads, self.redundancy, self.sees_less = weights.shape[1], redundancy, sees_less


class Waves:
    """Orders (k, 1) of some waves, and what cosine and sine of each are multiplied by, (k, columns)."""

    def __init__(self, orders: Sequence[float], by_cos: ArrayLike, by_sin: ArrayLike) -> None:
        """Waves of such orders; of a single column its factors may be (k,)."""
        self.orders = np.array(orders)[:, None]
        self.by_cos, self.by_sin = (np.array(each, np.float64).reshape(len(orders), -1) for each in (by_cos, by_sin))
        self.cos_at, self.sin_at = address(self.by_cos), address(self.by_sin)


_ROOM = Path(__file__).parent


class MetrologyKernel:
    """The library, called with the package's own arrays."""

    def __init__(self, library: ctypes.CDLL) -> None:
        """Kernel of a library that was built of these sources."""
        self._ring_pose, self._reading_variance = library.rem_ring_pose, library.rem_reading_variance
        self._ring_pose.argtypes = [c_void_p, c_void_p, c_void_p, c_int64, c_void_p]
        self._reading_variance.argtypes = [*[c_double] * 4, c_void_p, c_int64, c_void_p, c_int64, c_int64, c_void_p]
        self._ring_pose.restype = self._reading_variance.restype = None
        self._wave_sum = library.rem_wave_sum
        self._wave_sum.argtypes = [c_void_p, c_void_p, c_int64, c_int64, c_void_p, c_void_p, c_int64, c_void_p]
        self._wave_sum.restype = None

    def ring_pose(
        self, packed: PackedLayout, readings: Array, variances: Array
    ) -> tuple[Array, Array, Array, Array, Array, Array | None] | None:
        """Of readings (m, h); None where arrays do not lie as the library takes them.

        Rotation (m,), displacement over the radius before the tangent (2, m), covariance (m, 3, 3), parity (m, r),
        disagreement (m,), and what is seen of the displacement (2, m) where that is less than all.
        """
        m, h, r = len(readings), packed.heads, packed.redundancy
        shape = (m, h)
        if readings.shape != shape or variances.shape != shape:
            return None
        if not (is_plain(readings, REALS) and is_plain(variances, REALS)):
            return None
        found = np.empty((15 + r) * m)
        begin, ends = address(found), (m, 3 * m, 12 * m, 13 * m, (13 + r) * m)
        at = [begin + 8 * end for end in ends]
        to = (c_int64 * 6)(begin, at[0], at[1], at[3], at[2], at[4] if packed.sees_less else 0)  # `pose`
        self._ring_pose(ctypes.addressof(packed.layout), address(readings), address(variances), m, ctypes.addressof(to))
        return (
            found[:m],
            found[m : ends[1]].reshape(2, m),
            found[ends[1] : ends[2]].reshape(m, 3, 3),
            found[ends[3] : ends[4]].reshape(m, r),
            found[ends[2] : ends[3]],
            found[ends[4] :].reshape(2, m) if packed.sees_less else None,
        )

    def reading_variance(self, steps: Steps, gain: Array, travel: Array) -> Array | None:
        """(m, k) as the function of this name, of gains (m, k) or (m, 1); None where arrays do not lie so."""
        if travel.ndim != 2 or gain.shape not in (travel.shape, (len(travel), 1)):
            return None
        if not (is_plain(gain, REALS) and is_plain(travel, REALS)):
            return None
        variance = np.empty(travel.shape)
        self._reading_variance(*steps, address(gain), gain.shape[1], address(travel), *travel.shape, address(variance))
        return variance

    def wave_sum(self, waves: Waves, angles: Array) -> Array:
        """(n, columns) sums of k waves at `angles` (k, n) in one piece, each already multiplied by its order."""
        cosines, sines = np.cos(angles), np.sin(angles)
        n, (k, columns) = angles.shape[1], waves.by_cos.shape
        sums = np.empty((n, columns))
        self._wave_sum(waves.cos_at, waves.sin_at, k, columns, address(cosines), address(sines), n, address(sums))
        return sums


@cache
def chosen_kernel() -> MetrologyKernel | None:
    """The compiled kernel, see `kernel_of`; None where numpy computes."""
    return kernel_of(_ROOM, MetrologyKernel)
