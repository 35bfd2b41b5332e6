"""The compiled form of what is done with each block and at each tick, where it was built; numpy computes the same bits.

At 50,000 samples a second a block of a stream has a few hundred numbers, and numpy takes longer to be called than to
compute. `compiled/kernel.c` does the operations of `blocks`, `admission` and `resampling` on the same numbers in the
same order, in a call for each block and one for the values of all streams at the ticks.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_double, c_int64, c_size_t, c_void_p
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.libraries import INTEGERS, REALS, address, is_plain, kernel_of

_NO_TIME = -(2**63)
"""What the library says where a time is not finite."""

Signal = tuple[NDArray[np.int64], NDArray[np.float64]]
Columns = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]
"""Value, gain, travel, bend and whether valid: what `Resampled` holds, in its order."""


class Limits(ctypes.Structure):
    """`limits` of compiled/kernel.c; where the tail is, is told anew for each call, so that a stream may be pickled."""

    _fields_ = (
        *((name, c_double) for name in ("largest", "speed", "jitter", "largest_bend", "taken_out", "last")),
        *((name, c_int64) for name in ("since", "until", "is_first")),
        ("tail", c_size_t),
    )


class Grid(ctypes.Structure):
    """`grid` of compiled/kernel.c."""

    _fields_ = (*((name, c_int64) for name in ("period", "fitted", "fewest", "max_gap")), ("margin", c_double))


_ROOM = Path(__file__).parent


class SignalKernel:
    """The library, called with the package's own arrays."""

    def __init__(self, library: ctypes.CDLL) -> None:
        """Kernel of a library that was built of these sources."""
        self._times, self._admit = library.rem_times, library.rem_admit
        self._decided, self._resample = library.rem_decided, library.rem_resample
        self._times.argtypes = [c_void_p, c_int64, c_int64, c_int64, c_void_p]
        self._admit.argtypes = [c_void_p, c_void_p, c_int64, c_void_p, c_int64, c_int64, c_void_p, c_void_p]
        self._decided.argtypes = [c_void_p, c_void_p, c_int64, c_int64, c_int64]
        self._resample.argtypes = [c_void_p, c_void_p, c_int64, c_void_p, c_int64]
        self._times.restype = self._admit.restype = self._decided.restype = c_int64
        self._resample.restype = None

    def times(self, rows: NDArray[np.float64], stamp_ns: int) -> tuple[NDArray[np.int64], int] | None:
        """(n,) timestamps (ns) of samples whose rows begin with seconds after the stamp, and the largest of them.

        None where a time is not finite or as far off as no stamp of ROS reaches (2^31 s), or the rows do not lie as the
        library takes them.
        """
        count = len(rows)
        if count == 0 or not is_plain(rows, REALS):
            return None
        times = np.empty(count, np.int64)
        newest = self._times(address(rows), count, rows.shape[1], stamp_ns, address(times))
        return None if newest == _NO_TIME else (times, newest)

    def admit(
        self, limits: Limits, rows: NDArray[np.float64], times: NDArray[np.int64], into: tuple[int, int], width: int
    ) -> bool:
        """Whether all samples are beyond doubt; they then are where `into` says, addresses for times and values.

        Args:
            limits: of the stream, and what is known of the samples before.
            rows: time, values and whatever else of at least one sample.
            times: (n,) timestamps (ns).
            into: where there is room for them.
            width: number of values of a sample.
        """
        count, columns = rows.shape
        if columns <= width or not is_plain(rows, REALS) or not is_plain(times, INTEGERS):
            return False
        at = ctypes.addressof(limits), address(rows), columns, address(times)
        return bool(self._admit(*at, count, width, *into))

    def decided(self, grid: Grid, times: NDArray[np.int64], first: int, count: int) -> int | None:
        """What `count_decided` counts, of a sample at least; None where times do not lie as the library takes them."""
        if not is_plain(times, INTEGERS):
            return None
        found: int = self._decided(ctypes.addressof(grid), address(times), len(times), first, count)
        return found

    def resample(self, grid: Grid, signals: Sequence[Signal], ticks: NDArray[np.int64]) -> list[Columns] | None:
        """What `resample_all` gives; None where arrays do not lie as the library takes them."""
        if not is_plain(ticks, INTEGERS) or not all(
            is_plain(times, INTEGERS) and is_plain(values, REALS) and values.ndim == 2 for times, values in signals
        ):
            return None
        m = len(ticks)
        # one array for all: an array costs more than what is computed for it
        found = np.empty(sum(3 * values.shape[1] + 1 for _, values in signals) * m)
        valid = np.empty((len(signals), m), np.bool_)
        begin, valid_at = address(found), address(valid)
        at, described, results = 0, [], []
        for i, (times, values) in enumerate(signals):
            k = values.shape[1]
            size = m * k
            ends = at + size, at + size + m, at + 2 * size + m, at + 3 * size + m
            described += [address(times), address(values), len(times), k]
            described += [begin + 8 * place for place in (at, *ends[:3])]
            described.append(valid_at + i * m)
            results.append(
                (
                    found[at : ends[0]].reshape(m, k),
                    found[ends[0] : ends[1]],
                    found[ends[1] : ends[2]].reshape(m, k),
                    found[ends[2] : ends[3]].reshape(m, k),
                    valid[i],
                )
            )
            at = ends[3]
        table = (c_int64 * len(described))(*described)  # `signal` of kernel.c has nothing but numbers of this size
        self._resample(ctypes.addressof(grid), ctypes.addressof(table), len(signals), address(ticks), m)
        return results


@cache
def chosen_kernel() -> SignalKernel | None:
    """The compiled kernel, see `kernel_of`; None where numpy computes."""
    return kernel_of(_ROOM, SignalKernel)
