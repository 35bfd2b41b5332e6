"""When the messages of a bag are: the time of its streams, and what tells the order of stamps while it is read."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.recorded_files import RawMessage
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.arrival import AHEAD_NS
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.signals.stretches import PAUSE_NS, longest_stretch

GROUP = 256
"""Messages of which the earliest stamp is kept: as many wait beside those that are out of order."""


@dataclass(frozen=True)
class Order:
    """What a first pass through some topics of a bag finds.

    Attributes:
        count: messages.
        earliest: (g,) earliest stamp (ns) of the messages from each `GROUP` of them on.
        span_ns: first and last time (ns) of the recording that they make; None without a message.
        behind_ns: by how much the clock of the recording was behind the stamps of most samples, ns.
        timely: whether most were recorded when they came.
    """

    count: int
    earliest: NDArray[np.int64]
    span_ns: tuple[int, int] | None
    behind_ns: int
    timely: bool


class Ordering:
    """Takes note of messages in the order of their recording."""

    def __init__(self, names: Sequence[str]) -> None:
        """Of these topics."""
        self._places = {name: place for place, name in enumerate(sorted(names))}
        self._count = 0
        self._groups = array("q")
        self._pieces = {name: _Pieces() for name in names}
        self._ahead, self._others_ahead = array("q"), array("q")

    def note(self, message: RawMessage, stamp_ns: int, decoder: BlockDecoder | None) -> None:
        """Take note of a message; `decoder` is that of its topic, where it carries blocks."""
        if self._count % GROUP == 0:
            self._groups.append(stamp_ns)
        elif stamp_ns < self._groups[-1]:
            self._groups[-1] = stamp_ns
        self._count += 1
        last = stamp_ns
        for first, last in _pieces(stamp_ns, decoder, message.data):
            self._pieces[message.topic].add(first, last)
        (self._others_ahead if decoder is None else self._ahead).append(last - message.log_time_ns)

    def result(self) -> Order:
        """What was found."""
        apart = np.frombuffer(self._ahead or self._others_ahead or array("q", [0]), np.int64)
        typical = int(np.median(apart))
        timely = bool(np.median(np.abs(apart - typical)) <= AHEAD_NS)
        earliest = np.minimum.accumulate(np.array(self._groups, np.int64)[::-1])[::-1]
        return Order(self._count, earliest, self._span(), max(0, typical), timely)

    def _span(self) -> tuple[int, int] | None:
        rows = [(*piece, self._places[name]) for name, each in self._pieces.items() for piece in each.all]
        if not rows:
            return None
        first, last, count, place = np.array(rows, np.int64).T
        return longest_stretch(first, last, place, counts=count)


class _Pieces:
    """When a stream has samples: pieces with longer pauses between them than a recording has, as they come."""

    def __init__(self) -> None:
        self.all: list[tuple[int, int, int]] = []  # first and last time (ns), and how many messages made it

    def add(self, first: int, last: int) -> None:
        if self.all:
            begin, end, count = self.all[-1]
            if first - end <= PAUSE_NS and begin - last <= PAUSE_NS:
                self.all[-1] = min(begin, first), max(end, last), count + 1
                return
        self.all.append((first, last, 1))


def _pieces(stamp_ns: int, decoder: BlockDecoder | None, data: bytes) -> Iterator[tuple[int, int]]:
    """First and last time (ns) of what one message holds: of a block whose samples pause, one for each part."""
    if decoder is None:
        yield stamp_ns, stamp_ns
        return
    try:
        first, last, _ = decoder.span(data)
        if 0 <= last - first <= PAUSE_NS / NANOSECONDS:
            yield stamp_ns + round(first * NANOSECONDS), stamp_ns + round(last * NANOSECONDS)
            return
        times = np.sort(decoder.decode(data).times_ns)
    except (InputError, OverflowError, ValueError):  # times that are none are told when the block is read
        yield stamp_ns, stamp_ns
        return
    cuts = np.flatnonzero(np.diff(times) > PAUSE_NS)
    starts, stops = times[np.r_[0, cuts + 1]], times[np.r_[cuts, len(times) - 1]]
    yield from zip(starts.tolist(), stops.tolist(), strict=True)
