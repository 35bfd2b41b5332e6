"""Values of a stream at given times: a local fit where samples are dense, cubic interpolation where they are sparse.

Each stream has a clock of its own. Ticks are the middles of equal cells of time. In a cell with many samples the value
is that of a quadratic fitted to them, which averages their noise; otherwise a cubic through the two samples before and
the two after, which holds under acceleration where a straight line errs. Either way the value is a weighted sum of
samples, and `gain` is the sum of the squared weights: the variance of the value over that of a sample.

All operations work element by element, so a tick's value has the same bits whatever other ticks are computed with it.
Where there is the library of `kernel`, it computes, the same bits again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask, Times
from rotary_error_monitor.signals.kernel import Grid, chosen_kernel

FEWEST_TO_FIT = 8
"""Samples in a cell from which the fit is used; below it the interpolation has no more noise."""

GUARD = 0.1
"""Last part of a cell that the fit leaves out: a sample in it shows that the rest is complete."""

MARGIN = 0.25
"""How far, in cells, the first and last sample may lie inside the fitted part: one sample may be missing at each end of
the fewest."""


@dataclass(frozen=True)
class Resampled:
    """Values at m ticks.

    Attributes:
        values: (m, k); zero where not valid.
        gain: (m,) variance of a value over that of one sample.
        travel: (m, k) how far the signal moves over the samples that were used.
        bend: (m, k) third difference of the samples of an interpolation, with its sign, zero for a fit: what it cannot
            follow grows with it.
        valid: (m,) whether the samples around the tick allow a value.
    """

    values: Array
    gain: Array
    travel: Array
    bend: Array
    valid: Mask

    @staticmethod
    def nothing(count: int, size: int) -> Resampled:
        """Of so many ticks none is valid."""
        values, travel, bend = (np.zeros((count, size)) for _ in range(3))
        return Resampled(values, np.ones(count), travel, bend, np.zeros(count, np.bool_))

    def at(self, chosen: NDArray[np.int64]) -> Resampled:
        """The same at some of the ticks."""
        return Resampled(
            self.values[chosen], self.gain[chosen], self.travel[chosen], self.bend[chosen], self.valid[chosen]
        )

    def replaced(self, chosen: Mask, part: Resampled) -> Resampled:
        """The same with those of `part` at the chosen (m,) ticks."""
        values, gain, travel, bend = (each.copy() for each in (self.values, self.gain, self.travel, self.bend))
        return _merged(Resampled(values, gain, travel, bend, self.valid.copy()), part, chosen)


def around(times_ns: Times, ticks: Times) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(m,) places of the first and the last of the four samples around each tick, of two samples or more.

    They are the same live and in a replay, where what is known of a stream by its latest block is not.
    """
    last = np.clip(np.searchsorted(times_ns, ticks) + 1, 1, len(times_ns) - 1)
    return np.maximum(last - 3, 0), last


def rate_around(times_ns: Times, ticks: Times) -> Array:
    """(m,) samples per s around each tick; 0 where there are fewer than two."""
    if len(times_ns) < 2:
        return np.zeros(len(ticks))
    first, last = around(times_ns, ticks)
    return np.asarray((last - first) * 1e9 / (times_ns[last] - times_ns[first]))


def tick_times(first: int, count: int, period_ns: int) -> NDArray[np.int64]:
    """(count,) timestamps (ns) of the ticks `first`, `first + 1`, …: the middles of cells of `period_ns`."""
    return np.arange(first, first + count, dtype=np.int64) * period_ns + period_ns // 2


def count_decided(times_ns: NDArray[np.int64], first: int, count: int, period_ns: int) -> int:
    """How many of the ticks `first`, `first + 1`, … of so many have all the samples that they will ever need."""
    if len(times_ns) == 0 or count <= 0:
        return 0
    kernel = chosen_kernel()
    found = None if kernel is None else kernel.decided(_grid(period_ns), times_ns, first, count)
    return _count_decided(times_ns, tick_times(first, count, period_ns), period_ns) if found is None else found


def _count_decided(times_ns: NDArray[np.int64], ticks_ns: NDArray[np.int64], period_ns: int) -> int:
    start, stop = _cells(times_ns, ticks_ns, period_ns)
    complete = times_ns[-1] >= _fit_end(ticks_ns, period_ns)
    dense = stop - start >= FEWEST_TO_FIT
    # two samples after the tick, as the interpolation takes: one that stands exactly at it is none of them
    sparse = ticks_ns < times_ns[-2] if len(times_ns) > 1 else np.zeros(len(ticks_ns), np.bool_)
    undecided = ~(complete & (dense | sparse))
    return int(np.argmax(undecided)) if undecided.any() else len(ticks_ns)


def resample(times_ns: Times, values: Array, ticks_ns: Times, period_ns: int, max_gap_ns: int) -> Resampled:
    """One signal, values (n, k) sampled at `times_ns` (n,), given at the ticks `ticks_ns` (m,); see `resample_all`."""
    return resample_all([(times_ns, values)], ticks_ns, period_ns, max_gap_ns)[0]


def resample_all(
    signals: Sequence[tuple[NDArray[np.int64], Array]], ticks_ns: Times, period_ns: int, max_gap_ns: int
) -> list[Resampled]:
    """Each signal, values (n, k) sampled at times (n,), given at the ticks `ticks_ns` (m,).

    Not valid is a tick whose neighbours are missing: more than `max_gap_ns` apart, or so unevenly spaced that a sample
    is missing between them. Many signals at once cost little more than one.
    """
    kernel = chosen_kernel()
    found = None if kernel is None else kernel.resample(_grid(period_ns, max_gap_ns), signals, ticks_ns)
    if found is not None:
        return [Resampled(*each) for each in found]
    return _resample_all(signals, ticks_ns, period_ns, max_gap_ns)


def _resample_all(
    signals: Sequence[tuple[NDArray[np.int64], Array]],
    ticks_ns: NDArray[np.int64],
    period_ns: int,
    max_gap_ns: int,
) -> list[Resampled]:
    results: list[Resampled | None] = [None] * len(signals)
    dense: list[tuple[int, Mask, _Cells]] = []
    for i, (times, values) in enumerate(signals):
        start, stop = _cells(times, ticks_ns, period_ns)
        fits = stop - start >= FEWEST_TO_FIT
        if fits.all():
            dense.append((i, fits, _Cells(times, values, ticks_ns, start, stop)))
            continue
        sparse = _interpolate(times, values, ticks_ns[~fits], max_gap_ns)
        results[i] = sparse if not fits.any() else _spread(sparse, ~fits)
        if fits.any():
            dense.append((i, fits, _Cells(times, values, ticks_ns[fits], start[fits], stop[fits])))
    for (i, fits, _), part in zip(dense, _fit([cells for _, _, cells in dense], period_ns), strict=True):
        results[i] = part if results[i] is None else _merged(results[i], part, fits)
    return [result for result in results if result is not None]


@dataclass(frozen=True)
class _Cells:
    """A signal and which of its samples, [start, stop), belong to which tick."""

    times: Times
    values: Array
    ticks: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    @property
    def near(self) -> slice:
        """Samples from the first to the last that belongs to a tick."""
        return slice(int(self.start[0]), int(self.stop[-1])) if len(self.start) else slice(0, 0)


def _spread(part: Resampled, chosen: Mask) -> Resampled:
    """A result for all ticks of which only the chosen ones are filled."""
    return _merged(Resampled.nothing(len(chosen), part.values.shape[1]), part, chosen)


def _merged(whole: Resampled | None, part: Resampled, chosen: Mask) -> Resampled:
    assert whole is not None
    whole.values[chosen], whole.gain[chosen] = part.values, part.gain
    whole.travel[chosen], whole.bend[chosen] = part.travel, part.bend
    whole.valid[chosen] = part.valid
    return whole


def _fit_end(ticks_ns: NDArray[np.int64], period_ns: int) -> NDArray[np.int64]:
    return ticks_ns - period_ns // 2 + _fitted(period_ns)


def _fitted(period_ns: int) -> int:
    """The part of a cell that is fitted, ns."""
    return round(period_ns * (1 - GUARD))


@lru_cache(maxsize=64)
def _grid(period_ns: int, max_gap_ns: int = 0) -> Grid:
    return Grid(period_ns, _fitted(period_ns), FEWEST_TO_FIT, max_gap_ns, MARGIN * period_ns)


def _cells(times_ns: Times, ticks_ns: Times, period_ns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    start = np.searchsorted(times_ns, ticks_ns - period_ns // 2)
    stop = np.searchsorted(times_ns, _fit_end(ticks_ns, period_ns))
    return start, stop


def _interpolate(times_ns: Times, values: Array, ticks_ns: Times, max_gap_ns: int) -> Resampled:
    """Cubic through the four samples around each tick (Lagrange's form)."""
    m, k = len(ticks_ns), values.shape[1]
    if len(times_ns) < 4:
        return Resampled.nothing(m, k)
    after = np.searchsorted(times_ns, ticks_ns, side="right")
    inside = (after >= 2) & (after + 1 < len(times_ns))
    first = np.clip(after - 2, 0, len(times_ns) - 4)
    valid = inside & _are_near([times_ns[first + i + 1] - times_ns[first + i] for i in range(3)], max_gap_ns)
    u = [(times_ns[first + i] - ticks_ns) * 1e-9 for i in range(4)]
    middle, before, behind = u[2] - u[1], u[1] - u[0], u[3] - u[2]
    samples = [values[first + i] for i in range(4)]
    total, gain = np.zeros((m, k)), np.zeros(m)
    for i in range(4):
        weight = np.ones(m)
        for j in range(4):
            if j != i:
                weight = weight * (u[j] / (u[j] - u[i]))
        total = total + weight[:, None] * (samples[i] - samples[1])
        gain = gain + weight * weight
    result = np.where(valid[:, None], samples[1] + total, 0.0)
    return Resampled(result, gain, np.abs(samples[3] - samples[0]), _bend(samples, before, middle, behind), valid)


def _are_near(distances: Sequence[Times], max_gap_ns: int) -> Mask:
    """Whether four samples are near to one another, and evenly enough, by their three distances (ns).

    In whole numbers: of distances that are the limit itself, rounding would let through some ticks and not others.
    """
    before, middle, behind = distances
    even = (middle <= 3 * np.minimum(before, behind)) & (np.maximum(before, behind) <= 3 * middle)
    return np.asarray(even & (np.maximum(np.maximum(before, behind), middle) <= max_gap_ns))


def _bend(samples: Sequence[Array], before: Array, middle: Array, behind: Array) -> Array:
    """(m, k) third difference of four samples, of which a cubic misses as much if they are evenly spaced.

    It is made of their divided differences: that of the samples as they are would be as large as the signal moves in
    what their distances differ by. Between the middle ones a cubic misses the product of the distances to all four.
    """
    speeds = [
        (end - begin) / passed[:, None]
        for begin, end, passed in zip(samples[:-1], samples[1:], (before, middle, behind), strict=True)
    ]
    first = (speeds[1] - speeds[0]) / (before + middle)[:, None]
    second = (speeds[2] - speeds[1]) / (middle + behind)[:, None]
    square = 2 / 3 * middle * np.sqrt((0.5 * middle + before) * (0.5 * middle + behind))  # of the even distance
    return np.asarray((second - first) * (6 * square * np.sqrt(square) / (before + middle + behind))[:, None])


def _fit(signals: list[_Cells], period_ns: int) -> list[Resampled]:
    """Quadratic by least squares in each cell of each signal, taken at its tick."""
    if not signals:
        return []
    columns = [(cells, cells.near, k) for cells in signals for k in range(cells.values.shape[1])]
    times = np.concatenate([cells.times[near] for cells, near, _ in columns])
    values = np.concatenate([cells.values[near, k] for cells, near, k in columns])
    ticks = np.concatenate([cells.ticks for cells, _, _ in columns])
    total = len(ticks)
    # where the part of each column begins among all of them, less where it begins among its own samples
    shifts = np.cumsum([0, *(near.stop - near.start for _, near, _ in columns[:-1])])
    shifts -= [near.start for _, near, _ in columns]
    start = np.concatenate([cells.start + shift for (cells, _, _), shift in zip(columns, shifts, strict=True)])
    sizes = np.concatenate([cells.stop - cells.start for cells, _, _ in columns])
    begin = np.cumsum(sizes) - sizes
    cell = np.repeat(np.arange(total), sizes)
    picked = np.arange(len(cell)) + (start - begin)[cell]
    u = (times[picked] - ticks[cell]) / period_ns
    y = values[picked]
    first = times[start] - ticks
    reference = y[begin]  # relative to one sample, so that a large unwrapped angle loses no digits
    y = y - reference[cell]
    u2 = u * u
    # bincount adds in the order of the samples: the same bits in any batch
    s1, s2, s3, s4, t0, t1, t2 = (np.bincount(cell, w, total) for w in (u, u2, u2 * u, u2 * u2, y, u * y, u2 * y))
    c0, c1, c2 = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
    determinant = sizes * c0 + s1 * c1 + s2 * c2
    fitted = reference + (c0 * t0 + c1 * t1 + c2 * t2) / determinant
    gain = c0 / determinant
    last = begin + sizes - 1
    margin = MARGIN * period_ns
    fit_end = _fitted(period_ns) - period_ns // 2
    covered = (first + period_ns // 2 <= margin) & (fit_end - u[last] * period_ns <= margin)
    travel = np.abs(y[last])
    fitted = np.where(covered, fitted, 0.0)
    results, at = [], 0
    for cells in signals:
        m, k = len(cells.ticks), cells.values.shape[1]
        part = slice(at, at + m * k)
        at += m * k
        results.append(
            Resampled(
                fitted[part].reshape(k, m).T.copy(),
                gain[part][:m].copy(),
                travel[part].reshape(k, m).T.copy(),
                np.zeros((m, k)),
                covered[part][:m].copy(),
            )
        )
    return results
