"""Values of a stream at given times: a local fit where samples are dense, cubic interpolation where they are sparse.

Each stream has a clock of its own. Ticks are the middles of equal cells of time. In a cell with many samples the value
is that of a quadratic fitted to them, which averages their noise; otherwise a cubic through the two samples before and
the two after, which holds under acceleration where a straight line errs. Either way the value is a weighted sum of
samples, and `gain` is the sum of the squared weights: the variance of the value over that of a sample.

All operations work element by element, so a tick's value has the same bits whatever other ticks are computed with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FEWEST_TO_FIT = 8
"""Samples in a cell from which the fit is used; below it the interpolation has no more noise."""

GUARD = 0.1
"""Last part of a cell that the fit leaves out: a sample in it shows that the rest is complete."""

MARGIN = 0.15
"""How far, in cells, the first and last sample may lie inside the fitted part."""


@dataclass(frozen=True)
class Resampled:
    """Values at m ticks.

    Attributes:
        values: (m, k); zero where not valid.
        gain: (m,) variance of a value over that of one sample.
        travel: (m, k) how far the signal moves over the samples that were used.
        valid: (m,) whether the samples around the tick allow a value.
    """

    values: NDArray[np.float64]
    gain: NDArray[np.float64]
    travel: NDArray[np.float64]
    valid: NDArray[np.bool_]


def tick_times(first: int, count: int, period_ns: int) -> NDArray[np.int64]:
    """(count,) timestamps (ns) of the ticks `first`, `first + 1`, …: the middles of cells of `period_ns`."""
    return np.arange(first, first + count, dtype=np.int64) * period_ns + period_ns // 2


def count_decided(times_ns: NDArray[np.int64], ticks_ns: NDArray[np.int64], period_ns: int) -> int:
    """How many of the leading `ticks_ns` have all the samples that they will ever need."""
    if len(times_ns) == 0 or len(ticks_ns) == 0:
        return 0
    start, stop = _cells(times_ns, ticks_ns, period_ns)
    complete = times_ns[-1] >= _fit_end(ticks_ns, period_ns)
    dense = stop - start >= FEWEST_TO_FIT
    sparse = ticks_ns <= times_ns[-2] if len(times_ns) > 1 else np.zeros(len(ticks_ns), np.bool_)
    undecided = ~(complete & (dense | sparse))
    return int(np.argmax(undecided)) if undecided.any() else len(ticks_ns)


def resample(
    times_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    ticks_ns: NDArray[np.int64],
    period_ns: int,
    max_gap_ns: int,
) -> Resampled:
    """Values (n, k) sampled at `times_ns` (n,), given at the ticks `ticks_ns` (m,).

    Not valid is a tick whose neighbours are missing: more than `max_gap_ns` apart, or so unevenly spaced that a sample
    is missing between them.
    """
    start, stop = _cells(times_ns, ticks_ns, period_ns)
    dense = stop - start >= FEWEST_TO_FIT
    if dense.all():
        return _fit(times_ns, values, ticks_ns, start, stop, period_ns)
    sparse = _interpolate(times_ns, values, ticks_ns[~dense], max_gap_ns)
    if not dense.any():
        return sparse
    fitted = _fit(times_ns, values, ticks_ns[dense], start[dense], stop[dense], period_ns)
    m, k = len(ticks_ns), values.shape[1]
    result = Resampled(np.empty((m, k)), np.empty(m), np.empty((m, k)), np.empty(m, np.bool_))
    for chosen, part in ((dense, fitted), (~dense, sparse)):
        result.values[chosen], result.gain[chosen] = part.values, part.gain
        result.travel[chosen], result.valid[chosen] = part.travel, part.valid
    return result


def _fit_end(ticks_ns: NDArray[np.int64], period_ns: int) -> NDArray[np.int64]:
    return ticks_ns - period_ns // 2 + round(period_ns * (1 - GUARD))


def _cells(
    times_ns: NDArray[np.int64], ticks_ns: NDArray[np.int64], period_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    start = np.searchsorted(times_ns, ticks_ns - period_ns // 2)
    stop = np.searchsorted(times_ns, _fit_end(ticks_ns, period_ns))
    return start, stop


def _interpolate(
    times_ns: NDArray[np.int64], values: NDArray[np.float64], ticks_ns: NDArray[np.int64], max_gap_ns: int
) -> Resampled:
    """Cubic through the four samples around each tick (Lagrange's form)."""
    m, k = len(ticks_ns), values.shape[1]
    if len(times_ns) < 4:
        return Resampled(np.zeros((m, k)), np.ones(m), np.zeros((m, k)), np.zeros(m, np.bool_))
    after = np.searchsorted(times_ns, ticks_ns, side="right")
    inside = (after >= 2) & (after + 1 < len(times_ns))
    first = np.clip(after - 2, 0, len(times_ns) - 4)
    u = [(times_ns[first + i] - ticks_ns) * 1e-9 for i in range(4)]
    middle, before, behind = u[2] - u[1], u[1] - u[0], u[3] - u[2]
    even = (middle <= 3 * np.minimum(before, behind)) & (np.maximum(before, behind) <= 3 * middle)
    valid = inside & even & (np.maximum(np.maximum(before, behind), middle) <= max_gap_ns * 1e-9)
    samples = [values[first + i] for i in range(4)]
    total, gain = np.zeros((m, k)), np.zeros(m)
    for i in range(4):
        weight = np.ones(m)
        for j in range(4):
            if j != i:
                weight = weight * (u[j] / (u[j] - u[i]))
        # relative to one sample, so that a large unwrapped angle loses no digits
        total = total + weight[:, None] * (samples[i] - samples[1])
        gain = gain + weight * weight
    result = np.where(valid[:, None], samples[1] + total, 0.0)
    return Resampled(result, gain, np.abs(samples[3] - samples[0]), valid)


def _fit(
    times_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    ticks_ns: NDArray[np.int64],
    start: NDArray[np.int64],
    stop: NDArray[np.int64],
    period_ns: int,
) -> Resampled:
    """Quadratic by least squares in each cell [start, stop), taken at its tick."""
    sizes = stop - start
    cell = np.repeat(np.arange(len(ticks_ns)), sizes)
    index = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes) + np.repeat(start, sizes)
    u = (times_ns[index] - ticks_ns[cell]) / period_ns
    u2 = u * u
    # bincount adds in the order of the samples: the same bits in any batch
    s0, s1, s2, s3, s4 = (_sums(cell, w, len(ticks_ns)) for w in (np.ones(len(u)), u, u2, u2 * u, u2 * u2))
    c0, c1, c2 = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
    determinant = s0 * c0 + s1 * c1 + s2 * c2
    reference = values[start]
    fitted = np.empty((len(ticks_ns), values.shape[1]))
    for column in range(values.shape[1]):
        y = values[index, column] - reference[cell, column]
        t0, t1, t2 = (_sums(cell, w, len(ticks_ns)) for w in (y, u * y, u2 * y))
        fitted[:, column] = reference[:, column] + (c0 * t0 + c1 * t1 + c2 * t2) / determinant
    begin = ticks_ns - period_ns // 2
    margin = MARGIN * period_ns
    covered = (times_ns[start] - begin <= margin) & (_fit_end(ticks_ns, period_ns) - times_ns[stop - 1] <= margin)
    travel = np.abs(values[stop - 1] - values[start])
    return Resampled(np.where(covered[:, None], fitted, 0.0), c0 / determinant, travel, covered)


def _sums(cell: NDArray[np.int64], weights: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    return np.asarray(np.bincount(cell, weights, count), np.float64)
