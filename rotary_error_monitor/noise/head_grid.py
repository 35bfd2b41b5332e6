"""Read heads side by side: which samples of different heads belong together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.twin.recording import StageRecording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeadGrid:
    """Heads side by side: samples of all heads that belong together stand in one row.

    Attributes:
        heads: names of the streams.
        rows: for each head, the row (n,) of each of its samples.
        present: (m, heads) whether a head has a sample there.
        time: (m,) s, of the row.
        period: s.
    """

    heads: tuple[str, ...]
    rows: Mapping[str, NDArray[np.intp]]
    present: NDArray[np.bool_]
    time: Array
    period: float


def align_heads(recording: StageRecording) -> HeadGrid:
    """Rows of samples that belong together: nearest in time, one period apart."""
    streams = {name: recording.streams[name] for name in recording.heads}
    period = float(np.median([stream.period for stream in streams.values()]))
    first = min(stream.time[0] for stream in streams.values())
    phases = np.concatenate([(stream.time - first) / period for stream in streams.values()])
    # Mean on the circle: the phase at which rows stand in the middle of the samples that belong together.
    middle = float(np.angle(np.mean(np.exp(2j * np.pi * phases)))) / (2 * np.pi)
    rows = {n: np.rint((s.time - first) / period - middle).astype(np.intp) for n, s in streams.items()}
    lowest = min(int(r[0]) for r in rows.values())
    count = max(int(r[-1]) for r in rows.values()) - lowest + 1
    present = np.zeros((count, len(streams)), bool)
    for i, name in enumerate(streams):
        rows[name] -= lowest
        present[rows[name], i] = True
    time = first + (middle + np.arange(count) + lowest) * period
    return HeadGrid(tuple(streams), rows, present, time, period)
