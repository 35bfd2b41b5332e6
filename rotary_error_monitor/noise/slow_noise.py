"""Slow noise of an instrument as a whitening map: what its slow courses show of white rows is weighed down."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array


@dataclass(frozen=True)
class Cells:
    """Rows of one channel in cells of as many rows each: what is slow is the same for all rows of a cell.

    Attributes:
        starts: (k,) first row of each cell.
        weight: (n,) what a course of one adds to each row; 0 where there is no sample.
    """

    starts: NDArray[np.intp]
    weight: Array

    @cached_property
    def size(self) -> Array:
        """(k,) root of the sum of the squared weights of each cell: what a course of one adds to its sum."""
        return np.asarray(np.sqrt(np.add.reduceat(np.square(self.weight), self.starts)), np.float64)

    def sums(self, rows: Array) -> Array:
        """(k, p) weighted sums of rows (n, p) over each cell, white if the rows are."""
        scale = np.where(self.size > 0, 1 / np.maximum(self.size, np.finfo(np.float64).tiny), 0.0)
        weighted = rows.T * self.weight
        # Where each row is a cell of its own there is nothing to sum.
        sums = weighted if len(self.starts) == len(self.weight) else np.add.reduceat(weighted, self.starts, axis=1)
        sums *= scale
        return np.asarray(sums.T, np.float64)

    def spread(self, values: Array) -> Array:
        """(n, p) rows of courses (k, p)."""
        if len(self.starts) == len(self.weight):
            return np.asarray((values.T * self.weight).T, np.float64)
        lengths = np.diff(np.append(self.starts, len(self.weight)))
        rows = np.repeat(values.T, lengths, axis=1)
        rows *= self.weight
        return np.asarray(rows.T, np.float64)


def cells_of(weight: Array, most: int) -> Cells:
    """Cells of rows with these weights (n,), at most so many."""
    count = min(most, len(weight))
    return Cells(np.arange(count) * len(weight) // count, weight)


@dataclass(frozen=True)
class SlowNoise:
    """Whitens the rows of one channel beside independent slow courses.

    Rows white but for `U d`, `d ~ N(0, 1)`, are white times `(I + U U')^(-1/2)`: of each principal direction of `U`,
    with square `s`, the part `1 - 1 / sqrt(1 + s)` is taken off.

    Attributes:
        cells: of the channel.
        courses: (k, q) one standard deviation of each course in each cell, in those of a row's white noise.
    """

    cells: Cells
    courses: Array

    def whiten(self, rows: Array) -> Array:
        """(n, p) white rows from rows (n, p) that are white but for the slow courses."""
        return self._added(rows, -0.5)

    def plain(self, rows: Array) -> Array:
        """(n, p) rows from which `whiten` made these."""
        return self._added(rows, 0.5)

    def plain_sums(self, rows: Array) -> Array:
        """(k, p) sums of the same over the cells, as `Cells.sums` gives them."""
        return self.cells.sums(rows) + self._own @ self._shown(rows, 0.5)

    def _added(self, rows: Array, power: float) -> Array:
        """(n, p) `(I + U U')^power` times rows (n, p)."""
        found = self.cells.spread(self.courses @ self._shown(rows, power))
        found += rows
        return found

    @property
    def _own(self) -> Array:
        """(k, q) what one standard deviation of each course adds to the sum over each cell."""
        return np.asarray(self.cells.size[:, None] * self.courses, np.float64)

    @cached_property
    def _directions(self) -> tuple[Array, Array]:
        """Squares (r,) of the principal directions of the courses, and those as combinations (q, r) of courses."""
        own = self._own
        squares, vectors = np.linalg.eigh(own.T @ own)
        shown = squares > np.finfo(np.float64).eps * squares.max(initial=0.0)
        return squares[shown], vectors[:, shown]

    def _shown(self, rows: Array, power: float) -> Array:
        """(q, p) courses by which rows differ from `(I + U U')^power` times the rows."""
        squares, vectors = self._directions
        share = ((1 + squares) ** power - 1) / squares
        return np.asarray(vectors @ (share[:, None] * (vectors.T @ (self._own.T @ self.cells.sums(rows)))), np.float64)
