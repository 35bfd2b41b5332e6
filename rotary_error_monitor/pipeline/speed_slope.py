"""What of a quantity goes with the speed of the rotor: that is how a delay between two instruments shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array

CHANCE = 1e-9
"""Probability by which chance makes a slope that counts as seen, by Student's t: of few windows a rotor that hardly
changes its speed shows any slope."""

TREND = 2
"""Power of time up to which what is seen may drift, as where a stage warms up."""

DIGITS = 1e-8
"""Part of a square that must be left beside all else, of waves times of speed and values, before normal equations are
trusted: sums over two thousand windows are wrong by 1e-13 of the whole at most, 1 in 100,000 of that part."""

FEWEST = 3
"""Measurements from which it is faster to make them ready together."""

SURELY = 0.9
"""Part of the largest slope by chance below which there is none for sure, whatever digits are lost."""


_TINY = float(np.finfo(np.float64).tiny)
"""Stands for a sum of squares of zero."""


class SpeedSlope:
    """Slope over the speed of what windows show, by least squares; drift and some orders of the rotation beside it.

    The speed is that from the window before to the window after: jitter of the rotor is in what is seen as well, and a
    speed that ends at the window itself would go with it. What interpolation misses goes with the speed as well where
    drift leaves little of that, as in a first ramp: it counts as a deviation that no scatter shows. Where windows are
    missing the values may be others behind the gap, as where something began to push: each course has a level of its
    own, and only a change of speed within one tells.

    Attributes:
        value: the slope (k,) where it stands out from what is left, in the unit of the values times s/rad; zero
            elsewhere.
        length: of the slope as a vector.
    """

    def __init__(self, kept: int, size: int = 1, orders: int = 0) -> None:
        """Slope of `size` values over the `kept` latest windows, beside orders of the rotation up to `orders`."""
        from scipy.special import stdtrit  # loads for a third of a second: now, not when a sample waits

        self._quantile = stdtrit
        self._orders = np.arange(1, orders + 1)[:, None]
        self._kept = kept
        # a row each of numbers, angles, what is missed, values and waves of the angles, which are the same at each
        # measurement; twice the room: only once in `kept` windows the latest are moved to the front
        self._room = np.empty((3 + size + 2 * orders, 2 * kept))
        self._shown, self._waves = slice(3, 3 + size), slice(3 + size, None)
        self._begin = self._end = 0
        self._new: list[tuple[float, ...]] = []  # windows that are not in the room yet
        self._ahead = 0  # windows behind the end that were foreseen
        self._none: set[int] = set()  # numbers of windows behind which for sure no slope stands out if all of them come
        self._unknown = TREND + 1 + 2 * orders
        self.value, self.length = np.zeros(size), 0.0

    def forget(self) -> None:
        """Forget the windows; what they have shown stays."""
        self._begin = self._end = self._ahead = 0
        self._none.clear()
        self._new.clear()

    def restore(self, *value: float) -> None:
        """Forget the windows, which a fault was in, and take the slope to be what it was before."""
        self.forget()
        self.value = np.array(value)
        self.length = math.hypot(*value)

    def foresee(
        self,
        first: int,
        every: int,
        thetas: Sequence[float],
        *values: Sequence[float],
        missed: Sequence[float] | None = None,
    ) -> None:
        """Make ready for windows that are to be taken in: of many at once it takes less time than of each.

        What was foreseen before and did not come is forgotten.

        Args:
            first: number of the first; it is made ready for nothing where that does not follow upon what was taken in.
            every: a measurement follows upon each window whose number is a multiple.
            thetas: of each, as of `add`.
            *values: the same.
            missed: the same; none for 0.
        """
        self._ahead = 0
        self._none.clear()
        count = min(len(thetas), self._kept)
        if count < FEWEST * every:
            return
        self._make_room()
        if not self._end or self._room[0, self._end - 1] != first - 1:
            return
        new = [thetas[:count], missed[:count] if missed else [0.0] * count, *(each[:count] for each in values)]
        self._put(np.array([range(first, first + count), *new], np.float64))
        self._ahead = count
        ends = np.arange(self._end + 1 + -first % every, self._end + count + 1, every)
        whole = ends - self._begin > self._kept  # from then on one leaves for each that comes
        for some in (ends[~whole], ends[whole]):
            sure = some[self._are_none(some)]
            self._none.update(self._room[0, sure - 1].astype(np.int64).tolist())

    def _are_none(self, ends: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether for sure no slope stands out of the windows up to each of some evenly spaced places."""
        begins = np.maximum(self._begin, ends - self._kept)
        told = ends - begins - 2 >= 2 * self._unknown
        sure = np.zeros(len(ends), np.bool_)
        if told.any():
            room = self._room[:, begins[told][0] : ends[-1]]
            if room[0, -1] - room[0, 0] == room.shape[1] - 1:
                places = begins[told] - begins[told][0], ends[told] - begins[told][0] - 2
                sure[told] = self._show_none(room[0, 1:-1], self._rows(room, 1.0), *places)
        return sure

    def add(self, number: int, theta: float, *values: float, missed: float = 0.0) -> None:
        """Take in what the window of a `number` shows at a rotation (rad), and what interpolation may miss of each."""
        if self._ahead and self._room[0, self._end] == number:
            self._ahead -= 1
            self._end += 1
            self._begin = max(self._begin, self._end - self._kept)
            return
        self._ahead = 0
        self._none.clear()
        self._new.append((number, theta, missed, *values))
        if len(self._new) >= self._kept:
            self._make_room()

    def measure(self, duration: float) -> None:
        """Renew the slope by what was taken in, of windows of a duration (s).

        At a constant speed nothing is seen of it: what was seen before holds until it is contradicted.
        """
        self._make_room()
        if not self.length and self._none and int(self._room[0, self._end - 1]) in self._none:
            return
        number, missed, rows = self._usable(duration)
        if len(number) < 2 * self._unknown:
            return
        if not self.length and number[-1] - number[0] == len(number) - 1 and self._shows_none(number, rows):
            return
        slope, margin = self._regress(number, missed, rows)
        unseen = np.where(np.abs(slope - self.value) > margin, 0.0, self.value)
        self.value = np.where(np.abs(slope) > margin, slope, unseen)
        self.length = math.sqrt(float(self.value @ self.value))

    def unseen(self, duration: float) -> float:
        """Length of a slope that the windows, of a duration (s), would not show; infinite where they are too few."""
        self._make_room()
        if self._end == self._begin:
            return math.inf
        number, missed, rows = self._usable(duration)
        if len(number) < 2 * self._unknown:
            return math.inf
        margin = self._regress(number, missed, rows)[1]
        return math.hypot(*margin.tolist())  # of a speed of zero its square may be too large for a float

    def course(self) -> tuple[Array, Array]:
        """Angles (n,) and the first of the values (n,) of the latest windows, back to the last gap between two."""
        self._make_room()
        number, theta, _, value = self._room[:4, self._begin : self._end]
        gaps = np.flatnonzero(np.diff(number) != 1.0)
        first = int(gaps[-1]) + 1 if len(gaps) else 0
        return theta[first:], value[first:]

    def _usable(self, duration: float) -> tuple[Array, Array, Array]:
        """Numbers (n,), what is missed (n,) and rows, as of `_rows`, of the windows that have both neighbours."""
        room = self._room[:, self._begin : self._end]
        number, missed, rows = room[0, 1:-1], room[2, 1:-1], self._rows(room, duration)
        if room[0, -1] - room[0, 0] != room.shape[1] - 1:  # some windows are missing
            inner = np.flatnonzero(room[0, 2:] - room[0, :-2] == 2.0)
            number, missed, rows = number[inner], missed[inner], rows[:, inner]
        return number, missed, rows

    def _make_room(self) -> None:
        """Put new windows behind the others."""
        if not self._new:
            return
        new = np.array(self._new).T
        self._new.clear()
        self._put(new)
        self._end += new.shape[1]
        self._begin = max(self._begin, self._end - self._kept)

    def _put(self, new: Array) -> None:
        """Put new windows behind the end."""
        count = new.shape[1]
        if self._end + count > self._room.shape[1]:
            latest = self._room[:, self._begin : self._end]
            self._begin, self._end = 0, latest.shape[1]
            self._room[:, : self._end] = latest
        room, angles = self._room[:, self._end : self._end + count], self._orders * new[1]
        room[: len(new)] = new
        room[self._waves] = np.concatenate([np.cos(angles), np.sin(angles)])

    def _regress(self, number: Array, missed: Array, rows: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from rows (w + 1 + k, n): waves, speed, values.

        Of the values as much as `missed` (n,) may be wrong. Powers of time, by the numbers (n,) of the windows, are
        fitted as well, and a level of each course of them without a gap.
        """
        fitted = len(rows) - 1 - len(self.value)
        begins = np.flatnonzero(np.diff(number, prepend=-np.inf) != 1.0)
        if len(begins) > 1:
            powers = _powers(number - number.mean())[1:]
            free = _without_levels(np.vstack([powers, rows]), begins)
            others, rows = np.linalg.qr(free[: len(powers) + fitted].T)[0], free[len(powers) :]
        elif fitted:
            others = np.linalg.qr(np.vstack([_uniform_trend(len(number))[0], rows[:fitted]]).T)[0]
        else:
            others = _uniform_trend(len(number))[1]
        columns = np.ascontiguousarray(rows[fitted:].T)
        return self._slope_of(columns - others @ (others.T @ columns), missed, self._unknown + len(begins) - 1)

    def _rows(self, room: Array, duration: float) -> Array:
        """(w + 1 + k, n) waves, speed and values of windows between the first and the last of a part of the room."""
        speed, among = (room[1, 2:] - room[1, :-2]) / (2.0 * duration), room[:, 1:-1]
        return np.vstack([among[self._waves], speed, among[self._shown]])

    def _shows_none(self, number: Array, rows: Array) -> bool:
        """Whether for sure no slope stands out of rows as of `_regress`, at the numbers (n,) of their windows."""
        return bool(self._show_none(number, rows, np.zeros(1, np.intp), np.array([len(number)]))[0])

    def _show_none(
        self, number: Array, rows: Array, begins: NDArray[np.intp], ends: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """(m,) the same of those from one of m places to before another, which are evenly spaced.

        It is told by normal equations: half of the time of a fit, of many at once a tenth, but digits are lost.
        """
        fitted = self._unknown
        columns = np.empty((TREND + 1 + len(rows), len(number)))
        columns[0], columns[1] = 1.0, (number - number[-1]) / self._kept
        columns[2] = columns[1] * columns[1]
        columns[TREND + 1 :] = rows
        seen = columns[fitted:]
        seen -= seen.sum(axis=1, keepdims=True) / len(number)  # which the powers of time hold as well
        same, later, whole = _products(columns, begins, ends)
        none = np.zeros(len(begins), np.bool_)
        squares, mixed = same[:, :fitted, :fitted], same[:, :fitted, fitted:]
        try:
            pivots = np.square(np.linalg.cholesky(squares).diagonal(axis1=1, axis2=2))
            part = np.linalg.solve(squares, mixed).swapaxes(1, 2)
        except np.linalg.LinAlgError:
            return none
        free = same[:, fitted:, fitted:] - part @ mixed
        left = free.diagonal(axis1=1, axis2=2) / whole[fitted:]
        sure = (pivots / whole[:fitted]).min(axis=1) * left.min(axis=1) > DIGITS
        beside = np.empty((len(none), len(whole) - fitted, len(whole)))
        beside[:, :, :fitted], beside[:, :, fitted:] = -part, np.eye(len(whole) - fitted)
        later, counts = (beside @ later @ beside.swapaxes(1, 2)).tolist(), (ends - begins).tolist()
        for place, each in enumerate(free.tolist()):
            slopes = range(1, len(each)) if sure[place] else ()
            none[place] = sure[place] and all(self._is_chance(each, later[place], k, counts[place]) for k in slopes)
        return none

    def _is_chance(self, same: list[list[float]], later: list[list[float]], place: int, count: int) -> bool:
        """Whether for sure a slope is none: by products of `count` speeds (0) and values, as `_slope_of`."""
        slope = same[0][place] / same[0][0]
        square = same[place][place] - slope * same[0][place]
        if square <= DIGITS * same[place][place]:
            return False
        alike = later[place][place] - slope * (later[0][place] + later[place][0] - slope * later[0][0])
        alike = max(alike, 0.0)
        freedom = max(count * (square - alike) / (square + alike) - self._unknown - 1.0, 1.0)
        margin = float(self._quantile(freedom, 1.0 - CHANCE)) * math.sqrt(square / same[0][0] / freedom)
        return abs(slope) < SURELY * margin

    def _slope_of(self, free: Array, missed: Array, unknown: int) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from speed and values (n, 1 + k) free of all else.

        What they are free of had so many unknowns. What may be `missed` (n,) of the values counts as its standard
        uncertainty.
        """
        speed, values = free[:, 0], free[:, 1:]
        spread = max(float(speed @ speed), _TINY)
        slope = speed @ values / spread
        rest = values.T - slope[:, None] * speed
        squares = np.square(rest).sum(axis=1)
        freedom = np.maximum(_independent(rest, squares) - unknown - 1.0, 1.0)
        systematic = float(np.square(speed * missed).sum()) / spread
        deviation = np.sqrt((squares / freedom + systematic) / spread)
        return slope, self._quantile(freedom, 1.0 - CHANCE) * deviation

    def __len__(self) -> int:
        return min(self._end - self._begin + len(self._new), self._kept)


def _products(columns: Array, begins: NDArray[np.intp], ends: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Products of rows of columns (r, n) from each of m places to before another, which are evenly spaced.

    Given are (m, r, r) those of each row with each other, (m, r, r) with the other one column before, and (r,) the
    squares of all columns.
    """
    begin, end, more = int(begins[0]), int(ends[0]), len(begins) - 1
    first = columns[:, begin:end]
    # by a copy: for an array with itself numpy asks for a symmetric product, which takes longer
    same, later = first @ first.copy().T, first[:, 1:] @ first[:, :-1].T
    whole = same.diagonal()
    if not more:
        return same[None], later[None], np.maximum(whole, _TINY)
    came, left = int(ends[1]) - end, int(begins[1]) - begin
    come, before = (_parts(columns, place, more, came) for place in (end, end - 1))
    gone, behind = (_parts(columns, place, more, left) for place in (begin, begin + 1))
    come_too, gone_too = come.swapaxes(1, 2), gone.swapaxes(1, 2)
    entered = come @ come_too
    all_same = np.concatenate([same[None], entered - gone @ gone_too]).cumsum(axis=0)
    all_later = np.concatenate([later[None], come @ before.swapaxes(1, 2) - behind @ gone_too]).cumsum(axis=0)
    return all_same, all_later, np.maximum(whole + entered.sum(axis=0).diagonal(), _TINY)


def _parts(columns: Array, begin: int, count: int, size: int) -> Array:
    """(count, r, size) so many parts of columns (r, n), one behind another."""
    return columns[:, begin : begin + count * size].reshape(len(columns), count, size).swapaxes(0, 1)


@lru_cache(maxsize=2)
def _uniform_trend(count: int) -> tuple[Array, Array]:
    """Powers (TREND + 1, n) of the times of so many windows without a gap, and what spans them, (n, TREND + 1).

    Whoever measures as many needs the same.
    """
    powers = _powers(np.arange(count, dtype=np.float64) - 0.5 * (count - 1))
    return powers, np.linalg.qr(powers.T)[0]


def _powers(time: Array) -> Array:
    """Powers (TREND + 1, n) of times (n,), which are 1 at most."""
    return np.asarray((time / max(float(np.abs(time).max()), 1.0)) ** np.arange(TREND + 1)[:, None])


def _without_levels(rows: Array, begins: NDArray[np.intp]) -> Array:
    """Rows (r, n) less their mean within each of the parts that begin at some columns."""
    lengths = np.diff(begins, append=rows.shape[1])
    return np.asarray(rows - np.repeat(np.add.reduceat(rows, begins, axis=1) / lengths, lengths, axis=1))


def _independent(rest: Array, square: Array) -> Array:
    """How many of n residuals (k, n) count where neighbours are alike (Bayley and Hammersley 1946, first order).

    `square` (k,) is the sum of their squares.
    """
    alike = (rest[:, 1:] * rest[:, :-1]).sum(axis=1).clip(0.0)
    return np.asarray(rest.shape[1] * (square - alike) / np.maximum(square + alike, _TINY))
