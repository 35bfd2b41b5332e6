"""From when to when a stream has samples, where it is silent, and what it lacks beside the others of a recording.

Everything that reads a recording says it by these: replay, diagnosis and recovery.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

_LEAP = 1.5
"""Periods between two samples from which one is missing: nearer to two than to one."""

_REGULAR = 0.9
"""Share of the distances of samples that must lie within half of the usual one for a stream to have a rate."""

_FEWEST = 10
"""Distances from which a rate can be told."""

_INSIDE = 0.02
"""Share of a block's samples that must be missing before a block counts as torn: clocks of drivers drift less."""

_LATE_BEGIN, _EARLY_END, _SHARE = 5.0, 1.0, 0.1
"""How much later than the first a stream begins, and earlier than the last ends, without a remark: nodes take up to 4 s
to find one another and end within a second; in short recordings a tenth of the time."""


@dataclass(frozen=True)
class Coverage:
    """When samples of one stream are there; times are timestamps (ns).

    Attributes:
        samples: how many.
        first_ns: time of the first.
        last_ns: time of the last.
        period_ns: usual distance of two; 0 where they have no rate of their own.
        interval_ns: usual distance of two messages: with less, nobody knows better when the stream began.
        silences: (k, 2) of each stretch in which samples are missing, the last before and the first after.
        missing: (k,) how many in each, by the stream's own period.
        overlapping: messages that begin before the one before has ended, as where two publish.
    """

    samples: int
    first_ns: int
    last_ns: int
    period_ns: float
    interval_ns: float
    silences: NDArray[np.int64]
    missing: NDArray[np.int64]
    overlapping: int

    @property
    def lost(self) -> int:
        """Samples missing in all."""
        return int(self.missing.sum())


def _numbers() -> array[int]:
    """Whole numbers of 64 bits: a recording of hours has millions."""
    return array("q")


@dataclass
class MessageSpans:
    """First and last sample and number of samples of each message of a stream, as they come."""

    first_ns: array[int] = field(default_factory=_numbers)
    last_ns: array[int] = field(default_factory=_numbers)
    samples: array[int] = field(default_factory=_numbers)

    def add_block(self, block: SampleBlock) -> None:
        """Take note of a sample block; of one without samples there is nothing to note."""
        if len(block.rows):
            first, last = block.rows[[0, -1], 0]
            self._add(block.stamp_ns + round(first * NANOSECONDS), block.stamp_ns + round(last * NANOSECONDS), block)

    def add_stamp(self, stamp_ns: int) -> None:
        """Take note of a message that is one sample."""
        self._add(stamp_ns, stamp_ns, None)

    def _add(self, first_ns: int, last_ns: int, block: SampleBlock | None) -> None:
        self.first_ns.append(first_ns)
        self.last_ns.append(last_ns)
        self.samples.append(1 if block is None else len(block.rows))

    def coverage(self) -> Coverage | None:
        """What the messages cover; None where there are none."""
        if not self.first_ns:
            return None
        return cover(*(np.array(each, np.int64) for each in (self.first_ns, self.last_ns, self.samples)))


def cover(first_ns: NDArray[np.int64], last_ns: NDArray[np.int64], samples: NDArray[np.int64]) -> Coverage:
    """Coverage of a stream by (m,) messages in any order: time of first and last sample (ns), number of samples."""
    order = np.lexsort((last_ns, first_ns))
    first, last, count = first_ns[order], np.maximum(first_ns, last_ns)[order], samples[order]
    reached = np.maximum.accumulate(last)
    steps = first[1:] - reached[:-1]
    period = _period(first, last, count)
    missing = np.zeros(len(steps), np.int64)
    if period > 0:
        missing = np.where(steps > _LEAP * period, np.rint(steps / period) - 1, 0).astype(np.int64)
        torn = np.rint((last - first) / period).astype(np.int64) + 1 - count
        torn = np.where(torn > np.maximum(_INSIDE * count, 0.5), torn, 0)
    else:
        torn = np.zeros(len(first), np.int64)
    between, inside = np.flatnonzero(missing > 0), np.flatnonzero(torn > 0)
    silences = np.concatenate(
        [np.stack([reached[between], first[between + 1]], 1), np.stack([first[inside], last[inside]], 1)]
    )
    lacking = np.concatenate([missing[between], torn[inside]])
    by_time = np.argsort(silences[:, 0], kind="stable")
    return Coverage(
        int(count.sum()),
        int(first[0]),
        int(reached[-1]),
        period,
        float(np.median(np.diff(first))) if len(first) > 1 else 0.0,
        silences[by_time],
        lacking[by_time],
        int(np.count_nonzero(steps < 0)),
    )


def _period(first: NDArray[np.int64], last: NDArray[np.int64], count: NDArray[np.int64]) -> float:
    """Usual distance of two samples, ns; 0 where most are far from it or there are too few to tell."""
    several = count > 1
    inside = (last - first)[several] / (count[several] - 1)
    single = not several.any()
    distances = np.diff(first).astype(np.float64) if single else inside
    distances = distances[distances > 0]
    if len(distances) < (_FEWEST if single else 1):
        return 0.0
    usual = float(np.median(distances))
    regular = np.abs(distances - usual) <= 0.5 * usual
    return usual if regular.mean() >= _REGULAR else 0.0


def coverage_remarks(streams: Mapping[str, Coverage], since_ns: int | None = None) -> tuple[str, ...]:
    """What the streams of one recording lack, by their own rates and beside one another; nothing where all is well.

    Args:
        streams: by the name that a reader knows.
        since_ns: timestamp (ns) from which times are told; by default the first sample of all.
    """
    if not streams:
        return ()
    begin = min(each.first_ns for each in streams.values())
    end = max(each.last_ns for each in streams.values())
    origin = begin if since_ns is None else since_ns
    said: dict[str, list[str]] = {}
    for name, stream in streams.items():
        for text in _remarks(stream, begin, end, origin):
            said.setdefault(text, []).append(name)
    return tuple(f"{', '.join(names)}: {text}" for text, names in said.items())


def _remarks(stream: Coverage, begin: int, end: int, origin: int) -> Iterable[str]:
    least = 2 * stream.interval_ns / NANOSECONDS
    span = (end - begin) / NANOSECONDS
    late, early = (stream.first_ns - begin) / NANOSECONDS, (end - stream.last_ns) / NANOSECONDS
    if late > max(least, min(_LATE_BEGIN, _SHARE * span)):
        yield f"no sample in the first {late:.1f} s of {span:.1f} s"
    if early > max(least, min(_EARLY_END, _SHARE * span)):
        yield f"no sample in the last {early:.1f} s of {span:.1f} s"
    if stream.lost:
        longest = int(np.argmax(stream.silences[:, 1] - stream.silences[:, 0]))
        since, until = (stream.silences[longest] - origin) / NANOSECONDS
        share = 100 * stream.lost / (stream.samples + stream.lost)
        count = len(stream.missing)
        where = f"{count} silence{'s' if count > 1 else ''}, the longest of {until - since:.3f} s at {since:.3f} s"
        yield f"{stream.lost} samples ({share:.2g} %) are missing in {where}"
    if stream.overlapping:
        yield f"{stream.overlapping} messages begin before the one before has ended; does one publish alone?"


def absence_remarks(expected: Sequence[str], present: Iterable[str]) -> tuple[str, ...]:
    """A remark that names the streams of which there is nothing at all, where there are some."""
    there = set(present)
    absent = [name for name in expected if name not in there]
    return (f"no sample at all of {', '.join(absent)}",) if absent else ()
