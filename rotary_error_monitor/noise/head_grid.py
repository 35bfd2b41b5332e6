"""Read heads side by side: which samples of different heads belong together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.twin.recording import StageRecording


@dataclass(frozen=True)
class HeadGrid:
    """Heads side by side: samples of all heads that belong together stand in one row.

    Attributes:
        heads: names of the streams.
        rows: for each head, the row (n,) of each of its samples; a slice where none is lost or comes twice.
        present: (m, heads) whether a head has a sample there.
        time: (m,) s, of the row.
        period: s.
    """

    heads: tuple[str, ...]
    rows: Mapping[str, slice | NDArray[np.int32]]
    present: Mask
    time: Array
    period: float

    def present_of(self, kept: Mapping[str, Mask]) -> Mask:
        """(m, heads) which heads were read at each instant, by the samples (n,) of each head that are kept."""
        present = self.present.copy()
        for i, name in enumerate(self.heads):
            present[self.rows[name], i] &= kept[name]
        return present

    def width(self, signals: Mapping[str, Array]) -> int:
        """Number of columns of the heads' signals."""
        return next(int(signals[name].shape[-1]) for name in self.heads if name in signals)

    def lay_out(self, table: Array, signals: Mapping[str, Array], kept: Mapping[str, Mask], columns: slice) -> None:
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
            piece = rows if isinstance(rows, slice) else _piece(rows)
            if piece is not None:
                head[:, : piece.start], head[:, piece], head[:, piece.stop :] = 0.0, values, 0.0
            else:
                head[...] = 0.0
                head[:, rows] = values
            if not kept[name].all():
                head[:, self.rows_of(name, ~kept[name])] = 0.0

    def rows_of(self, head: str, samples: Mask) -> NDArray[np.intp]:
        """Rows (k,) of some samples (n,) of a head."""
        rows = self.rows[head]
        if isinstance(rows, slice):
            return np.flatnonzero(samples) + int(rows.start)
        return np.asarray(rows[samples], np.intp)


def _piece(rows: NDArray[np.int32]) -> slice | None:
    """Rows (n,) as one piece, if there are as many of them as samples from the first to the last; else None."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first == len(rows) - 1 else None


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
    at = {n: np.rint((s.time - first) / period - middle).astype(np.intp) for n, s in streams.items()}
    lowest = min(int(r[0]) for r in at.values())
    count = max(int(r[-1]) for r in at.values()) - lowest + 1
    present = np.zeros((count, len(streams)), bool)
    rows: dict[str, slice | NDArray[np.int32]] = {}
    for i, (name, own) in enumerate(at.items()):
        own -= lowest
        # As wide as a thousand hours need: of a long recording they are kept for all stretches.
        rows[name] = slice(int(own[0]), int(own[-1]) + 1) if (np.diff(own) == 1).all() else own.astype(np.int32)
        present[rows[name], i] = True
    time = first + (middle + np.arange(count) + lowest) * period
    return HeadGrid(tuple(streams), rows, present, time, period)


def rate_of(mean: Array, known: Mask, period: float) -> Array:
    """(p, m) rate of change of columns (p, m), 0 beside samples that are not known."""
    rate = np.zeros_like(mean)
    inner = known[2:] & known[:-2]
    rate[:, 1:-1] = (mean[:, 2:] - mean[:, :-2]) * (inner / (2 * period))
    return rate


def weight_of_rows(grid: HeadGrid, weights: Mapping[str, Array]) -> Array:
    """(m,) weight of each row of the heads: that of the head in it whose rounding errors repeat most.

    Args:
        grid: of the heads.
        weights: (n, 1) of the samples of each head whose rounding errors repeat.
    """
    found = np.ones(len(grid.time))
    for name in grid.heads:
        if name in weights:
            rows = grid.rows[name]
            found[rows] = np.minimum(found[rows], weights[name][:, 0])
    return found


@dataclass(frozen=True)
class HeadRows:
    """What is asked for again and again of the heads in m rows.

    Attributes:
        count: (m,) heads that were read.
        weight: (m,) of the row: less where noise does not break up the steps of the heads.
        late: (heads, m) how much later than the mean of the heads in its row each of them sampled, s; 0 where absent.
    """

    count: NDArray[np.intp]
    weight: Array
    late: Array

    @classmethod
    def of(cls, grid: HeadGrid, present: Mask, weight: Array, times: Mapping[str, Array]) -> HeadRows:
        """From a grid.

        Args:
            grid: of the heads.
            present: (m, heads) which were read.
            weight: (m,) as `weight_of_rows`.
            times: (n,) s of the samples of each head.
        """
        count, late = present.sum(axis=1), np.zeros(present.shape)
        for i, name in enumerate(grid.heads):
            late[grid.rows[name], i] = times[name] - grid.time[grid.rows[name]]
        late -= (np.sum(late * present, axis=1) / np.maximum(count, 1))[:, None]
        late *= present
        return cls(count, weight, np.ascontiguousarray(late.T))
