"""Health of the streams of a recording: samples, losses, stamps, latency, and which instruments were not used when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Times

LEAST_FALL_OUT = 0.01
"""Shortest time without an instrument that is told, s: single samples are refused now and then."""

MOST_FALL_OUTS = 20
"""Times without an instrument that are told one by one; of more, the longest."""


@dataclass(frozen=True)
class StreamHealth:
    """What one stream of samples was like.

    Attributes:
        topic: its name on the wire.
        samples: how many.
        rate: Hz.
        jitter: standard deviation of a stamp, s.
        lost: samples that are missing between others.
        longest_gap: s.
        disordered: samples out of order or not finite.
        latency, latency_99: time from a block's newest sample to its arrival at the recorder, median and 99 % of
            blocks, s; NaN where the bag does not tell.
    """

    topic: str
    samples: int
    rate: float
    jitter: float
    lost: int
    longest_gap: float
    disordered: int
    latency: float
    latency_99: float


@dataclass(frozen=True)
class FallOut:
    """An instrument that was not used, or a doubt.

    Attributes:
        what: stream, or what was doubted.
        begin: s after the first estimate.
        duration: s.
    """

    what: str
    begin: float
    duration: float


class FallOuts:
    """Looks for times in which an instrument that was used at some time was not."""

    def __init__(self, bits: Mapping[str, int], period_ns: int) -> None:
        """Look at instruments by their bits, in estimates that are `period_ns` apart."""
        self._bits, self._period_ns = bits, period_ns
        self._first_ns: int | None = None
        self._begun: dict[str, tuple[int, int]] = {}  # time without each that has not ended: first and last timestamp
        self._used: set[str] = set()
        self._found: list[tuple[str, int, int]] = []

    def add(self, stamp_ns: Times, streams: NDArray[np.int64]) -> None:
        """Take the next estimates: timestamps (m,), ns, and bit mask (m,) of what was used."""
        if self._first_ns is None:
            self._first_ns = int(stamp_ns[0])
        for name, bit in self._bits.items():
            used = streams & bit != 0
            if used.any():
                self._used.add(name)
            if used[0] and name in self._begun:
                self._end(name)
            edges = np.flatnonzero(np.diff(np.concatenate([[True], used, [True]]).astype(np.int8)))
            for first, after in edges.reshape(-1, 2).tolist():
                begun = self._begun.get(name) if first == 0 else None
                begin_ns = int(stamp_ns[first]) if begun is None else begun[0]
                self._begun[name] = begin_ns, int(stamp_ns[after - 1])
                if after < len(used):
                    self._end(name)

    def _end(self, name: str) -> None:
        begin_ns, end_ns = self._begun.pop(name)
        if self._duration(begin_ns, end_ns) >= LEAST_FALL_OUT:
            self._found.append((name, begin_ns, end_ns))

    def _duration(self, begin_ns: int, end_ns: int) -> float:
        return (end_ns - begin_ns + self._period_ns) * 1e-9

    @property
    def found(self) -> tuple[FallOut, ...]:
        """The longest `MOST_FALL_OUTS`, in their order."""
        origin, order = self._first_ns or 0, list(self._bits)
        rows = [*self._found, *((name, *each) for name, each in self._begun.items())]
        told = [
            FallOut(name, (begin_ns - origin) * 1e-9, self._duration(begin_ns, end_ns))
            for name, begin_ns, end_ns in sorted(rows, key=lambda row: order.index(row[0]))
            if name in self._used and self._duration(begin_ns, end_ns) >= LEAST_FALL_OUT
        ]
        longest = sorted(told, key=lambda each: -each.duration)[:MOST_FALL_OUTS]
        return tuple(sorted(longest, key=lambda each: each.begin))
