"""What a replay gives tick by tick, kept as it comes: error motion, tool offsets, corrections, live decisions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Times
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion, error_motion_from_block
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.corrections import Correction
from rotary_error_monitor.signals.blocks import TIME_COLUMN, SampleBlock
from rotary_error_monitor.signals.rows import Keep, Rows, parts_of, place_of

T = TypeVar("T")

_NEAR = 8192
"""Ticks whose decisions are in memory at once: those of two chunks of the estimator."""


class BlockRows:
    """Samples of blocks that have the same columns, one behind another.

    Attributes:
        names: of the columns, those of the first block.
        times: (n,) timestamps (ns).
    """

    def __init__(self, keep: Keep, names: Sequence[str] = ()) -> None:
        """Nothing yet; `names` are the columns where no block will come."""
        self._keep = keep
        self._values: Rows | None = None
        self.names = (TIME_COLUMN, *names)
        self.times: Rows = keep((), np.int64)

    def __len__(self) -> int:
        return len(self.times)

    def append(self, block: SampleBlock) -> None:
        """Take the samples of a block."""
        if self._values is None:
            self.names = block.names
            self._values = self._keep((len(block.names),), np.float64)
        self.times.append(block.times_ns)
        self._values.append(block.rows)

    def part(self, first: int, last: int) -> tuple[Times, SampleBlock]:
        """Times of some samples, and a block that holds the samples' fields; its own times mean nothing."""
        rows = np.empty((0, len(self.names))) if self._values is None else self._values.read(first, last)
        return self.times.read(first, last), SampleBlock(0, self.names, rows)


class MotionRows:
    """Error motion, one behind another, kept as the columns that it has on the wire: these hold all of it.

    Attributes:
        times: (n,) timestamps (ns).
        theta: (n,) rotation, rad, by itself, for who looks at the course alone.
    """

    def __init__(self, keep: Keep, columns: Sequence[str]) -> None:
        """Nothing yet; `columns` are those that the wire contract names after `t`."""
        self._columns = tuple(columns)
        self._rows = BlockRows(keep, self._columns)
        self.times = self._rows.times
        self.theta: Rows = keep((), np.float64)

    def __len__(self) -> int:
        return len(self.times)

    def append(self, motion: ErrorMotion) -> None:
        """Take error motion at one time at least."""
        self._rows.append(block_from_error_motion(motion, self._columns))
        self.theta.append(motion.theta)

    def part(self, first: int, last: int) -> ErrorMotion:
        """Error motion from one time to before another."""
        times, block = self._rows.part(first, last)
        return replace(error_motion_from_block(block), times_ns=times)


class CorrectionRows:
    """Corrections, as the arrays that are written of them.

    Attributes:
        stamp_ns: (n,) timestamps (ns).
        values: (n, axes) correction of each axis, m or rad.
        remaining_ns: (m,) timestamps (ns) of those that say what remains.
        remaining: (m, 6) of the tool offset, m and rad.
    """

    def __init__(self, keep: Keep) -> None:
        self._keep = keep
        self.stamp_ns: Rows = keep((), np.int64)
        self.values: Rows = keep((), np.float64)
        self.remaining_ns: Rows = keep((), np.int64)
        self.remaining: Rows = keep((6,), np.float64)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def extend(self, corrections: Sequence[Correction]) -> None:
        """Take corrections."""
        if not corrections:
            return
        if not len(self):
            self.values = self._keep(corrections[0].values.shape, np.float64)
        self.stamp_ns.append(np.array([each.stamp_ns for each in corrections], np.int64))
        self.values.append(np.array([each.values for each in corrections]))
        reports = [(each.stamp_ns, each.report.remaining) for each in corrections if each.report is not None]
        if reports:
            self.remaining_ns.append(np.array([stamp for stamp, _ in reports], np.int64))
            self.remaining.append(np.array([remaining for _, remaining in reports]))


class ByTick(Mapping[int, T], Generic[T]):
    """What a live run said of each of its ticks, by the tick's timestamp (ns); the last word counts.

    It is asked for one tick after another, so that of many only those about the last one are in memory.
    """

    def __init__(self, keep: Keep, width: int, make: Callable[[int, Sequence[float]], T]) -> None:
        """Nothing yet.

        Args:
            keep: where it is kept.
            width: numbers that are said of a tick.
            make: what they mean, from the tick (ns) and the numbers.
        """
        self._make = make
        self.ticks: Rows = keep((), np.int64)
        self._said: Rows = keep((width,), np.float64)
        self._newest = np.iinfo(np.int64).min
        self._again: dict[int, T] = {}
        self._extra = 0
        self._near: dict[int, T] = {}
        self._span = (0, 0)

    def add(self, ticks: Times, said: NDArray[np.float64]) -> None:
        """Take what is said (m, width) of ticks (m,)."""
        before = np.maximum.accumulate(np.concatenate([[self._newest], ticks]))[:-1]
        later = ticks > before
        for tick, row in zip(ticks[~later].tolist(), said[~later].tolist(), strict=True):
            self._extra += tick not in self._again and not self._is_kept(tick)
            self._again[tick] = self._make(tick, row)
        self.ticks.append(ticks[later])
        self._said.append(said[later])
        self._newest = max(self._newest, int(ticks.max(initial=self._newest)))
        self._span = (0, 0)

    def sorted_parts(self) -> Iterator[Times]:
        """All ticks (ns) in ascending order, part after part."""
        again = np.array(sorted(tick for tick in self._again if not self._is_kept(tick)), np.int64)
        for first, last in parts_of(0, len(self.ticks)):
            part = self.ticks.read(first, last)
            count = len(again) if last == len(self.ticks) else int(np.searchsorted(again, part[-1]))
            yield np.sort(np.concatenate([part, again[:count]]))
            again = again[count:]

    def __len__(self) -> int:
        return len(self.ticks) + self._extra

    def __iter__(self) -> Iterator[int]:
        for part in self.sorted_parts():
            yield from part.tolist()

    def __getitem__(self, tick: int) -> T:
        if self._again and tick in self._again:
            return self._again[tick]
        if not self._span[0] <= tick < self._span[1]:
            self._go_to(tick)
        return self._near[tick]

    def _is_kept(self, tick: int) -> bool:
        place = place_of(self.ticks, tick)
        return place < len(self.ticks) and int(self.ticks.read(place, place + 1)[0]) == tick

    def _go_to(self, tick: int) -> None:
        """Bring what is said from a tick on into memory."""
        first, count = place_of(self.ticks, tick), len(self.ticks)
        last = min(first + _NEAR, count)
        ticks, rows = self.ticks.read(first, last).tolist(), self._said.read(first, last).tolist()
        self._near = {each: self._make(each, row) for each, row in zip(ticks, rows, strict=True)}
        end = int(self.ticks.read(last, last + 1)[0]) if last < count else np.iinfo(np.int64).max
        self._span = (tick, int(end))
