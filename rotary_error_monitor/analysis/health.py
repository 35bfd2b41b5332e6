"""Health of the streams of a recording: samples, losses, stamps, latency, and which instruments were not used when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]

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


def fall_outs(
    stamp_ns: Times, streams: NDArray[np.int64], bits: Mapping[str, int], period_ns: int
) -> tuple[FallOut, ...]:
    """Times in which an instrument that was used at some time was not, the longest `MOST_FALL_OUTS` in their order.

    Args:
        stamp_ns: (n,) timestamps (ns) of the estimates.
        streams: (n,) bit mask of what was used.
        bits: bit of each instrument.
        period_ns: distance of two estimates, ns.
    """
    found = [each for name, bit in bits.items() for each in _gaps(name, stamp_ns, streams & bit != 0, period_ns)]
    longest = sorted(found, key=lambda each: -each.duration)[:MOST_FALL_OUTS]
    return tuple(sorted(longest, key=lambda each: each.begin))


def _gaps(name: str, stamp_ns: Times, used: NDArray[np.bool_], period_ns: int) -> Iterator[FallOut]:
    if not used.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[True], used, [True]]).astype(np.int8)))
    for first, after in edges.reshape(-1, 2).tolist():
        duration = (int(stamp_ns[after - 1]) - int(stamp_ns[first]) + period_ns) * 1e-9
        if duration >= LEAST_FALL_OUT:
            yield FallOut(name, (int(stamp_ns[first]) - int(stamp_ns[0])) * 1e-9, duration)
