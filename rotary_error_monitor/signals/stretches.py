"""Which part of what was recorded is the recording: stamps may lie years apart, by a clock that was set meanwhile."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Times

PAUSE_NS = 600_000_000_000
"""Silence of all streams, ns, after which another recording begins: ten minutes, in which a stage is set up anew."""


def longest_stretch(
    first: Times,
    last: Times,
    stream: NDArray[np.int64],
    pause_ns: int = PAUSE_NS,
    counts: NDArray[np.int64] | None = None,
) -> tuple[int, int]:
    """First and last time, ns, of the longest stretch in which streams overlap and do not all pause.

    Longest is the stretch with the most time in which two streams at least have samples; among equals the one whose
    streams last longest all together, then the one with the most pieces, then the first.

    Args:
        first: (n,) timestamp (ns) of the first sample of each piece of a stream, in any order.
        last: (n,) of its last sample.
        stream: (n,) number of its stream.
        pause_ns: longest silence of all streams within a stretch.
        counts: (n,) of how many pieces each was put together, with no longer pause between them; None for one each.

    Raises:
        ValueError: there is no piece.
    """
    order = np.argsort(first, kind="stable")
    counts = np.ones(len(first), np.int64) if counts is None else counts
    first, last, stream, counts = first[order], last[order], stream[order], counts[order]
    reach = np.maximum.accumulate(last)
    starts = np.flatnonzero(np.concatenate([[True], first[1:] - reach[:-1] > pause_ns]))
    stops = np.append(starts[1:], len(first))
    best = max(
        range(len(starts)),
        key=lambda i: (*_lengths(*(each[starts[i] : stops[i]] for each in (first, last, stream, counts))), -i),
    )
    return int(first[starts[best]]), int(reach[stops[best] - 1])


def _lengths(first: Times, last: Times, stream: NDArray[np.int64], counts: NDArray[np.int64]) -> tuple[int, int, int]:
    """Time in which two streams overlap, time of all streams together (ns), and number of pieces."""
    if len(first) == 1:
        return 0, int(last[0]) - int(first[0]), int(counts[0])
    spans = [(int(first[stream == s].min()), int(last[stream == s].max())) for s in np.unique(stream)]
    borders = sorted([(start, 1) for start, _ in spans] + [(stop, -1) for _, stop in spans])
    overlap, present = 0, 0
    for (time, step), (later, _) in itertools.pairwise(borders):
        present += step
        overlap += (later - time) * (present >= 2)
    return overlap, sum(stop - start for start, stop in spans), int(counts.sum())
