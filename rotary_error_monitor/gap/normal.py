"""Normal equations of a linear model with Gaussian priors, kept block by block.

With them every question about a set of columns is small dense algebra: the fit, its evidence, its prediction of blocks
that were left out. The recording is read once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.problem import Columns, Conditions, LateRows, Problem, Rows, SparseRows

_Placed = dict[str, tuple[NDArray[np.intp], Array]]
"""By channel, which columns (k,) act on it, and their rows (m, k)."""


@dataclass(frozen=True)
class BlockNormal:
    """Products of all columns with one another and with the data, for each block.

    Attributes:
        gram: (b, p, p) products of columns.
        moment: (b, p) products of columns with the data.
        power: (b,) squares of the data.
        count: (b,) expected square of the data under noise alone.
    """

    gram: Array
    moment: Array
    power: Array
    count: Array

    def total(self, blocks: NDArray[np.bool_] | None = None) -> Normal:
        """Sum over all blocks, or over some."""
        chosen = slice(None) if blocks is None else blocks
        return Normal(
            self.gram[chosen].sum(axis=0),
            self.moment[chosen].sum(axis=0),
            float(self.power[chosen].sum()),
            float(self.count[chosen].sum()),
        )

    def reordered(self, order: NDArray[np.intp]) -> BlockNormal:
        """The same with columns in another order (p,)."""
        return replace(self, gram=self.gram[:, order[:, None], order], moment=self.moment[:, order])

    def squares(self, columns: Sequence[int] | NDArray[np.intp], amplitudes: Array) -> Array:
        """(b,) squares of the data minus the columns times their amplitudes, in each block."""
        index = np.asarray(columns, np.intp)
        gram = self.gram[:, index[:, None], index]
        fitted = gram @ amplitudes @ amplitudes - 2 * self.moment[:, index] @ amplitudes
        return np.asarray(self.power + fitted, np.float64)


@dataclass(frozen=True)
class Normal:
    """Products summed over blocks: `gram` (p, p), `moment` (p,), `power`, `count` as in `BlockNormal`."""

    gram: Array
    moment: Array
    power: float
    count: float

    def reordered(self, order: NDArray[np.intp]) -> Normal:
        """The same with columns in another order (p,)."""
        return replace(self, gram=self.gram[np.ix_(order, order)], moment=self.moment[order])

    def without(self, nuisance: int) -> Normal:
        """The equations with the first `nuisance` columns integrated out, each with a unit Gaussian prior.

        The Schur complement of the nuisance block: what is left of columns and data after the best guess at the
        nuisances, weighted with how well those are known beforehand.
        """
        if nuisance == 0:
            return self
        inner = self.gram[:nuisance, :nuisance] + np.eye(nuisance)
        factor = cho_factor(inner)
        cross = self.gram[:nuisance, nuisance:]
        moment = self.moment[:nuisance]
        solved, guess = cho_solve(factor, cross), cho_solve(factor, moment)
        return Normal(
            self.gram[nuisance:, nuisance:] - cross.T @ solved,
            self.moment[nuisance:] - cross.T @ guess,
            self.power - float(moment @ guess),
            self.count,
        )


def stack(
    problem: Problem,
    data: Rows,
    columns: Sequence[Columns],
    leading: Array | None = None,
    conditions: Conditions | None = None,
) -> BlockNormal:
    """Normal equations of all `columns`, one after the other, for the data, in the problem's own blocks or in others.

    Columns are absent from channels on which they do not act, which saves most of the work. So does `leading`
    (b, q, q): the products of the first `q` columns with one another, if they are known from before.
    """
    conditions = conditions or problem.conditions
    places = np.concatenate([[0], np.cumsum([width_of(rows) for rows in columns])]).astype(np.intp)
    blocks, size = len(conditions.labels), int(places[-1])
    done = 0 if leading is None else leading.shape[1]
    first = int(np.searchsorted(places, done))
    count = np.zeros(blocks)
    sheet, sums = _Sheet(), _Sums()
    for stretch in range(conditions.stretches):
        made = [rows_in(rows, stretch) for rows in columns]
        for channel, values in data.items():
            extent = conditions.extent(channel, len(values), stretch)
            known = _acting(made[:first], places, channel)
            index, table = sheet.lay_out(_acting(made[first:], places[first:], channel), values[extent])
            pieces = conditions.pieces(channel, problem.times(channel), stretch)
            inner = [(block, slice(part.start - extent.start, part.stop - extent.start)) for block, part in pieces]
            products = _products([*(rows for _, rows in known), table], inner, blocks)
            sums.add(np.concatenate([*(own for own, _ in known), index]), index, products)
            expected = problem.expected(channel)
            for block, part in pieces:
                count[block] += float(expected[part].sum())
    gram, moment, power = sums.spread(blocks, size)
    if leading is not None:
        gram[:, done:, :done] = gram[:, :done, done:].transpose(0, 2, 1)
        gram[:, :done, :done] = leading
    return BlockNormal(gram, moment, power, count)


def own_products(problem: Problem, columns: Columns, conditions: Conditions | None = None) -> Array | None:
    """(b, q, q) products of columns with one another in each block, as `leading` of `stack`; kept with the columns.

    Those of the twin's uncertain parameters are the same for fit after fit. None where such columns are not kept.
    """
    if not isinstance(columns, SparseRows):
        return None
    conditions = conditions or problem.conditions
    key = conditions.edges.tobytes()
    if key not in columns.products:
        blocks = len(conditions.labels)
        gram = np.zeros((blocks, columns.width, columns.width))
        for channel, (own, rows) in rows_in(columns, 0).items():
            pieces = conditions.pieces(channel, problem.times(channel), 0)
            gram[:, own[:, None], own] += _products([rows], pieces, blocks)
        columns.products[key] = gram
    return columns.products[key]


def _acting(made: Sequence[_Placed], places: NDArray[np.intp], channel: str) -> list[tuple[NDArray[np.intp], Array]]:
    """Positions (k,) of the columns that act on a channel, and their rows (m, k)."""
    found = [(place, rows[channel]) for place, rows in zip(places, made, strict=False) if channel in rows]
    return [(place + own, rows) for place, (own, rows) in found]


def _products(parts: Sequence[Array], pieces: Sequence[tuple[int, slice]], blocks: int) -> Array:
    """(blocks, p, q) products of all columns of the parts, (m, …) with p altogether, with the last part's (m, q)."""
    last = parts[-1]
    products = np.zeros((blocks, sum(part.shape[1] for part in parts), last.shape[1]))
    for block, piece in pieces:
        rows, place = last[piece], 0
        for part in parts:
            products[block, place : place + part.shape[1]] += part[piece].T @ rows
            place += part.shape[1]
    return products


class _Sums:
    """Products summed over channels; channels on which the same columns act are summed before they are spread out."""

    def __init__(self) -> None:
        self._found: dict[tuple[bytes, bytes], tuple[NDArray[np.intp], NDArray[np.intp], Array]] = {}

    def add(self, across: NDArray[np.intp], index: NDArray[np.intp], products: Array) -> None:
        """Take in products (b, p + 1, q + 1) of columns at positions `across` (p,) with those at `index` (q,)."""
        key = across.tobytes(), index.tobytes()
        if key in self._found:
            self._found[key][2][...] += products
        else:
            self._found[key] = across, index, products

    def spread(self, blocks: int, size: int) -> tuple[Array, Array, Array]:
        """Gram (b, size, size), moment (b, size) and power (b,)."""
        gram, moment, power = np.zeros((blocks, size, size)), np.zeros((blocks, size)), np.zeros(blocks)
        for across, index, products in self._found.values():
            gram[:, across[:, None], index] += products[:, :-1, :-1]
            moment[:, across] += products[:, :-1, -1]
            power += products[:, -1, -1]
        return gram, moment, power


class _Sheet:
    """Columns of one channel side by side with the data, in memory that the next channel uses again."""

    def __init__(self) -> None:
        self._memory: Array = np.empty(0)

    def lay_out(self, parts: Sequence[tuple[NDArray[np.intp], Array]], data: Array) -> tuple[NDArray[np.intp], Array]:
        """Positions (k,) of all columns, and the table (m, k + 1) of them and the data, each contiguous.

        Args:
            parts: positions (p,) of some columns, and their rows (m, p).
            data: (m, 1) the last column.
        """
        index = np.concatenate([np.zeros(0, np.intp), *(own for own, _ in parts)])
        shape = (len(index) + 1, len(data))
        if len(self._memory) < shape[0] * shape[1]:
            self._memory = np.empty(shape[0] * shape[1])
        table = self._memory[: shape[0] * shape[1]].reshape(shape)
        place = 0
        for own, rows in (*parts, (np.zeros(1), data)):
            table[place : place + len(own)] = rows.T
            place += len(own)
        return index, table.T


def grams_by_channel(problem: Problem, columns: Sequence[Columns], channels: Iterable[str]) -> dict[str, Array]:
    """(p, p) products of all columns with one another, one after the other, as far as each channel shows them."""
    places = np.concatenate([[0], np.cumsum([width_of(rows) for rows in columns])]).astype(np.intp)
    found = {channel: np.zeros((places[-1], places[-1])) for channel in channels}
    for stretch in range(problem.conditions.stretches):
        made = [rows_in(rows, stretch) for rows in columns]
        for channel, gram in found.items():
            acting = _acting(made, places, channel)
            if acting:
                index, table = np.concatenate([own for own, _ in acting]), np.hstack([rows for _, rows in acting])
                gram[np.ix_(index, index)] += table.T @ table
    return found


def own_rest(problem: Problem, data: Rows, nuisance: Columns) -> tuple[Rows, dict[str, float]]:
    """Each channel on its own, its nuisances chosen for it alone: rows (m, 1) that are left, and excess over noise.

    The excess is that of the rows, and that of what their nuisances had to be moved, each as far as it is more than
    chance: an effect that looks like an uncertain parameter shows in the channel that it moves, and in no other as it
    would if all channels shared the nuisances.
    """
    count = width_of(nuisance)
    gram = {channel: np.eye(count) for channel in data}
    moment = {channel: np.zeros(count) for channel in data}
    for stretch in range(problem.conditions.stretches):
        for channel, (own, rows) in rows_in(nuisance, stretch).items():
            extent = problem.conditions.extent(channel, len(data[channel]), stretch)
            gram[channel][np.ix_(own, own)] += rows.T @ rows
            moment[channel][own] += rows.T @ data[channel][extent, 0]
    inverse = {channel: np.linalg.inv(gram[channel]) for channel in data}
    moved = {channel: inverse[channel] @ moment[channel] for channel in data}
    rest = {channel: rows.copy() for channel, rows in data.items()}
    for stretch in range(problem.conditions.stretches):
        for channel, (own, rows) in rows_in(nuisance, stretch).items():
            extent = problem.conditions.extent(channel, len(data[channel]), stretch)
            rest[channel][extent, 0] -= rows @ moved[channel][own]
    excess = {}
    for channel, rows in rest.items():
        expected = float(np.sum(problem.expected(channel)))
        # Fitted nuisances scatter with the part of their prior that the data decide on.
        decided = count - float(np.trace(inverse[channel]))
        excess[channel] = _beyond_noise(float(np.sum(rows**2)), expected)
        excess[channel] += _beyond_noise(float(np.sum(moved[channel] ** 2)), decided)
    return rest, excess


def _beyond_noise(squares: float, dof: float) -> float:
    """What a chi-square is above its mean, if that is more than two of its standard deviations; else 0."""
    above = squares - dof
    return above if above > 2 * np.sqrt(2 * dof) else 0.0


def width_of(rows: Columns) -> int:
    """Number of columns."""
    if isinstance(rows, SparseRows | LateRows):
        return rows.width
    return next((values.shape[1] for values in rows.values()), 0)


def acting_on(rows: Columns) -> set[str]:
    """Channels on which columns act."""
    return set(rows_in(rows, 0))


def rows_in(rows: Columns, stretch: int) -> _Placed:
    """Which columns (k,) act on each channel, and their rows (m, k) of one stretch; kept rows are of the only one."""
    made = rows.of(stretch) if isinstance(rows, LateRows) else rows
    if isinstance(made, SparseRows):
        return {channel: (made.acting[channel], values) for channel, values in made.rows.items()}
    return {channel: (np.arange(values.shape[1]), values) for channel, values in made.items()}


def combine(problem: Problem, columns: Sequence[Columns], amplitudes: Sequence[Array]) -> Rows:
    """White rows (m, 1) of columns times amplitudes, summed."""
    total: Rows = {}
    conditions = problem.conditions
    for stretch in range(conditions.stretches):
        for rows, amplitude in zip(columns, amplitudes, strict=True):
            for channel, (own, values) in rows_in(rows, stretch).items():
                count = len(problem.times(channel))
                whole = total.setdefault(channel, np.zeros((count, 1)))
                whole[conditions.extent(channel, count, stretch)] += values @ amplitude[own].reshape(-1, 1)
    return total


def subtract(data: Rows, part: Rows) -> Rows:
    """White rows with a part taken away."""
    return {channel: values - part[channel] if channel in part else values for channel, values in data.items()}


def solve_scaled(gram: Array, moment: Array) -> Array:
    """Solution (p, …) of normal equations whose columns may be of very unequal lengths."""
    if len(gram) == 0:
        return moment
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    factor = cho_factor(gram * np.outer(scale, scale) + 1e-12 * np.eye(len(gram)))
    return np.asarray((scale * cho_solve(factor, (scale * moment.T).T).T).T, np.float64)
