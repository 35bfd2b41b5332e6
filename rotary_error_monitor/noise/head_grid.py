"""Read heads side by side: which samples of different heads belong together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import Encoder
from rotary_error_monitor.twin.recording import StageRecording

STANDSTILL_WEIGHT = 0.2
"""At rest a head rounds the same way again and again: its samples carry the information of one in 25."""


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

    def lay_out(
        self, table: Array, signals: Mapping[str, Array], kept: Mapping[str, NDArray[np.bool_]], columns: slice
    ) -> None:
        """Put some columns of signals into a table (heads, p, m), the heads one after the other.

        Args:
            table: is filled, with zeros where a head has no sample.
            signals: (n, 1, q) of some of the heads; the others count as zero.
            kept: (n,) samples of each head that take part.
            columns: which of the q, p of them.
        """
        for head, name in zip(table, self.heads, strict=True):
            if name not in signals:
                head[...] = 0.0
                continue
            rows, values = self.rows[name], signals[name][:, 0, columns].T
            # Nothing lost: as one piece, which is much faster than row by row.
            if int(rows[-1]) - int(rows[0]) == len(rows) - 1:
                first, last = int(rows[0]), int(rows[-1]) + 1
                head[:, :first], head[:, first:last], head[:, last:] = 0.0, values, 0.0
            else:
                head[...] = 0.0
                head[:, rows] = values
            if not kept[name].all():
                head[:, rows[~kept[name]]] = 0.0


def align_heads(recording: StageRecording) -> HeadGrid:
    """Rows of samples that belong together: nearest in time, one period apart; none of a stage without heads."""
    streams = {name: recording.streams[name] for name in recording.heads}
    if not streams:
        return HeadGrid((), {}, np.zeros((0, 0), bool), np.zeros(0), np.inf)
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


def rate_of(mean: Array, known: NDArray[np.bool_], period: float) -> Array:
    """(p, m) rate of change of columns (p, m), 0 beside samples that are not known."""
    rate = np.zeros_like(mean)
    inner = known[2:] & known[:-2]
    rate[:, 1:-1] = (mean[:, 2:] - mean[:, :-2]) * (inner / (2 * period))
    return rate


def standstill_weight(grid: HeadGrid, encoder: Encoder | None, omega: Mapping[str, Array]) -> Array:
    """(m,) weight of each row of the heads: less at rest, where noise does not break up their steps.

    Args:
        grid: of the heads.
        encoder: that they are of.
        omega: commanded speed (n,) at the samples of each head, rad/s.
    """
    weight = np.ones(len(grid.time))
    if encoder is not None and encoder.noise < 0.3 * encoder.resolution:
        for name in grid.heads:
            resting = np.abs(omega[name]) * grid.period < 0.5 * encoder.resolution
            weight[grid.rows[name][resting]] = STANDSTILL_WEIGHT
    return weight
