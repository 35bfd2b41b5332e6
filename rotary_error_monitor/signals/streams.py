"""A stream of samples as it grows, block by block, and what is known of it by its stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.libraries import address
from rotary_error_monitor.signals.admission import Admission, SampleLimits
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.kernel import chosen_kernel
from rotary_error_monitor.units import TURN

DISTANCES = 5
"""Blocks of a single sample whose median distance is that of the samples: two of them may be losses or bursts."""

_BEGINNING = np.iinfo(np.int64).min // 2

_ROOM = 2
"""Times the samples that are in memory for which there is room: each is then moved about once, and no more is held than
while a copy is made."""


@dataclass(frozen=True)
class SampleGap:
    """A stretch without samples where some were expected, or what was before the first of all.

    Attributes:
        last_ns: timestamp (ns) of the last sample before.
        first_ns: timestamp (ns) of the first sample after.
        usable_ns: from when on the stream counts again, timestamp (ns).
        reach_ns: two samples' distance, ns: an interpolation takes as many to each side.
    """

    last_ns: int
    first_ns: int
    usable_ns: int
    reach_ns: int


class SampleStream:
    """The latest samples of one signal, in the order of their stamps.

    A stream that falls silent for `patience` is absent; when it comes back, it counts again `patience` after its first
    new sample. Both are judged by stamps, so a recording and a live run come to the same verdict.

    Attributes:
        patience_ns: how long a silence makes the stream absent, ns.
        admission: which samples are believed, and how many were not.
        block_duration_ns: time from first to last sample of the latest block.
        begin_ns: timestamp (ns) of the first sample of all; None before it, and where nobody waited for it any more.
        lost: gaps, counted in blocks of the size that came before.
    """

    def __init__(self, names: Sequence[str], patience_ns: int, limits: SampleLimits | None = None) -> None:
        self.names = tuple(names)
        self.admission = Admission(limits or SampleLimits())
        self.lost = 0
        self._gaps: list[SampleGap] = []
        self.block_duration_ns = 0
        self.begin_ns: int | None = None
        self.patience_ns = patience_ns
        self._expected_ns: int | None = None
        self._newest_ns: int | None = None
        self._all_times = np.empty(0, np.int64)
        self._all_values = np.empty((0, len(self.names)))
        self._times_at = self._values_at = 0
        self._keep(0, 0)
        self._spacing_ns = 0.0
        self._distances: deque[int] = deque(maxlen=DISTANCES)
        self._block_samples = 1

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """(n,) timestamps (ns) of the samples in memory, increasing."""
        return self._times

    @property
    def values(self) -> Array:
        """(n, k) samples in memory, columns as in `names`."""
        return self._values

    @property
    def newest_ns(self) -> int | None:
        """Timestamp (ns) of the latest sample; None before the first."""
        return self._newest_ns

    @property
    def rate(self) -> float:
        """Samples per second of the latest block, of single samples of the latest few; 0 before the second sample."""
        return 1e9 / self._spacing_ns if self._spacing_ns > 0 else 0.0

    @property
    def spacing_ns(self) -> float:
        """Distance of the samples, as `rate`, ns; 0 before the second sample."""
        return self._spacing_ns

    def push(self, block: SampleBlock, until_ns: int | None = None) -> int:
        """Take in a block; give the number of samples that were taken. `until_ns` is as in `Admission.admit`.

        Raises:
            InputError: the block lacks one of the fields.
        """
        newest = self.newest_ns
        if self._copies(block, until_ns):
            times = block.times_ns
        else:
            times, values = self.admission.admit(block.times_ns, block.columns(self.names), until_ns)
            if len(times) == 0:
                return 0
            self._append(times, values)
        count, first, last = len(times), int(times[0]), int(times[-1])
        self._newest_ns = last
        self._note_gap(newest, first)
        if count > 1:
            self._spacing_ns = (last - first) / (count - 1)
        elif newest is not None:  # of single samples a short distance or a loss is not how the stream is: the median is
            self._distances.append(first - newest)
            self._spacing_ns = median(self._distances)
        self._block_samples = count
        self.block_duration_ns = last - first
        return count

    def _copies(self, block: SampleBlock, until_ns: int | None) -> bool:
        """Whether the library took in a block, for all of its samples are beyond doubt."""
        kernel = chosen_kernel()
        count, width = len(block.rows), len(self.names)
        if kernel is None or count == 0 or block.names[1 : 1 + width] != self.names:
            return False
        self._make_room(count)
        end = self._end
        into = self._times_at + 8 * end, self._values_at + 8 * width * end
        if not self.admission.copies(kernel, block, until_ns, into, width):
            return False
        self._keep(self._begin, end + count)
        return True

    def turn_by(self, turns: int) -> None:
        """Take whole turns out of the readings (first column, rad), of those in memory and of all that come."""
        self.admission.turn_by(turns)
        self._move(len(self._times))
        self._values[:, 0] -= TURN * turns

    def clear(self) -> None:
        """Forget all samples, as before the first one; counts stay."""
        self.admission.forget()
        self._keep(self._end, self._end)
        self._newest_ns = None
        self._gaps.clear()
        self._distances.clear()
        self._expected_ns = self.begin_ns = None

    def trim(self, before_ns: int, margin: int = 3) -> None:
        """Forget samples stamped before `before_ns`, but the last `margin` of them."""
        first = int(self._times.searchsorted(before_ns)) - margin
        if first > 0:
            self._keep(self._begin + first, self._end)
            oldest = int(self._times[0])
            refusals = self.admission.refusals
            if len(refusals):
                self.admission.refusals = refusals[refusals >= oldest]
            self._gaps = [gap for gap in self._gaps if gap.usable_ns > oldest]

    def expect(self, from_ns: int) -> None:
        """Say from when on samples are expected: the time at which the first stream of all began."""
        self._expected_ns = from_ns

    def refused_between(self, begin_ns: int, end_ns: int) -> float:
        """Part of the samples from `begin_ns` to before `end_ns` that was refused, 0 to 1."""
        refusals = self.admission.refusals
        if len(refusals) == 0:
            return 0.0
        refused = int(((refusals >= begin_ns) & (refusals < end_ns)).sum())
        first, last = np.searchsorted(self._times, (begin_ns, end_ns)).tolist()
        return float(refused / max(refused + last - first, 1))

    def is_absent(self, watermark_ns: int) -> bool:
        """Whether nobody should wait for this stream when another has samples up to `watermark_ns`."""
        last = self._expected_ns if self.newest_ns is None else self.newest_ns
        return last is not None and watermark_ns - last > self.patience_ns

    @property
    def has_gaps(self) -> bool:
        """Whether samples were missing of late: without, all are whole that `is_whole` is asked for."""
        return bool(self._gaps)

    def is_whole(self, ticks_ns: NDArray[np.int64], period_ns: int, *, after_patience: bool = True) -> Mask:
        """(m,) whether every sample that a value at a tick rests on was there.

        A listener that missed a block may hold enough samples for a value, yet not the value of one that heard all.

        Args:
            ticks_ns: (m,) timestamps (ns).
            period_ns: distance of two ticks, ns.
            after_patience: a stream that comes back counts again only after the patience.
        """
        whole = np.ones(len(ticks_ns), np.bool_)
        for gap in self._gaps:
            reach = max(period_ns // 2, gap.reach_ns)  # a fit takes the samples of its cell
            until = gap.first_ns + reach
            if after_patience:
                until = max(until, gap.usable_ns)
            whole &= (ticks_ns + reach < gap.last_ns) | (ticks_ns >= until)
        return whole

    def _keep(self, begin: int, end: int) -> None:
        """Have the samples from `begin` to before `end` of all for which there is room in memory."""
        self._begin, self._end = begin, end
        self._times, self._values = self._all_times[begin:end], self._all_values[begin:end]

    def _append(self, times: NDArray[np.int64], values: Array) -> None:
        """Put samples behind those in memory, where nobody has looked yet: what was handed out stays as it was."""
        self._make_room(len(times))
        begin, end = self._end, self._end + len(times)
        self._all_times[begin:end], self._all_values[begin:end] = times, values
        self._keep(self._begin, end)

    def _make_room(self, count: int) -> None:
        if self._end + count > len(self._all_times):
            self._move(_ROOM * (len(self._times) + count))

    def _move(self, room: int) -> None:
        """Move the samples in memory to a new place that has room for so many."""
        count, times, values = len(self._times), self._times, self._values
        self._all_times, self._all_values = np.empty(room, np.int64), np.empty((room, len(self.names)))
        self._all_times[:count], self._all_values[:count] = times, values
        self._times_at, self._values_at = address(self._all_times), address(self._all_values)
        self._keep(0, count)

    def _note_gap(self, newest: int | None, first: int) -> None:
        last, since = (newest, newest) if newest is not None else (_BEGINNING, self._expected_ns)
        is_long = since is not None and first - since > self.patience_ns
        lost = newest is not None and self._spacing_ns > 0 and first - newest > 2.5 * self._spacing_ns
        if lost:
            self.lost += max(1, round(((first - last) / self._spacing_ns - 1) / self._block_samples))
        if newest is None and not is_long:
            self.begin_ns = first
        if lost or is_long or newest is None:
            usable = first + self.patience_ns if is_long else first
            self._gaps.append(SampleGap(last, first, usable, round(2 * self._spacing_ns)))


def after_pause(streams: Iterable[SampleStream], tick: int, limit: int, period_ns: int, joined_ns: int) -> int:
    """The next tick from `tick` on, before `limit`, near which there are samples; without any `limit`.

    Args:
        streams: of which there may be samples.
        tick: number of a tick.
        limit: of another one.
        period_ns: distance of two ticks, ns.
        joined_ns: how far apart samples may be that are joined, ns.
    """
    begin_ns, nearest = tick * period_ns, limit
    reach = joined_ns // period_ns + 1
    for stream in streams if tick < limit else ():  # live there is none behind it
        times = stream.times_ns
        place = int(np.searchsorted(times, begin_ns - joined_ns))
        if place < len(times):
            nearest = min(nearest, int(times[place]) // period_ns - reach)
    return max(tick, nearest)
