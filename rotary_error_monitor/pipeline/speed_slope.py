"""What of a quantity goes with the speed of the rotor: that is how a delay between two instruments shows."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CHANCE = 1e-9
"""Probability by which chance makes a slope that counts as seen, by Student's t: of few windows a rotor that hardly
changes its speed shows any slope."""

TREND = 2
"""Power of time up to which what is seen may drift, as where a stage warms up."""

LEAST_PART = 1e-8
"""Part of a wave's square that must be left beside the others before normal equations are trusted: sums over a thousand
windows are wrong by 2e-13 of the whole at most, 1 in 10,000 of that part."""

ROUNDING = 1e-10
"""Part of speed and values that must be left beside all else, for the same reason: less may be rounding."""

SURELY = 0.9
"""Part of the largest slope by chance below which there is none for sure, whatever digits are lost."""

Array = NDArray[np.float64]

_TINY = float(np.finfo(np.float64).tiny)
"""Stands for a sum of squares of zero."""


class SpeedSlope:
    """Slope over the speed of what windows show, by least squares; drift and some orders of the rotation beside it.

    The speed is that from the window before to the window after: jitter of the rotor is in what is seen as well, and a
    speed that ends at the window itself would go with it.

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
        # a row each of numbers, angles, values and waves of the angles, which are the same at each measurement; twice
        # the room: only once in `kept` windows the latest are moved to the front
        self._room = np.empty((2 + size + 2 * orders, 2 * kept))
        self._shown, self._waves = slice(2, 2 + size), slice(2 + size, None)
        self._begin = self._end = 0
        self._new: list[tuple[float, ...]] = []  # windows that are not in the room yet
        self._unknown = TREND + 1 + 2 * orders
        self.value, self.length = np.zeros(size), 0.0

    def forget(self) -> None:
        """Forget the windows; what they have shown stays."""
        self._begin = self._end = 0
        self._new.clear()

    def add(self, number: int, theta: float, *values: float) -> None:
        """Take in what the window of a `number` shows at a rotation (rad)."""
        self._new.append((number, theta, *values))
        if len(self._new) >= self._kept:
            self._make_room()

    def measure(self, duration: float) -> None:
        """Renew the slope by what was taken in, of windows of a duration (s).

        At a constant speed nothing is seen of it: what was seen before holds until it is contradicted.
        """
        self._make_room()
        room = self._room[:, self._begin : self._end]
        speed, among = (room[1, 2:] - room[1, :-2]) / (2.0 * duration), room[:, 1:-1]
        if room[0, -1] - room[0, 0] != room.shape[1] - 1:  # some windows are missing
            inner = np.flatnonzero(room[0, 2:] - room[0, :-2] == 2.0)
            speed, among = speed[inner], among[:, inner]
        if among.shape[1] < 2 * self._unknown:
            return
        powers, trend = _trend(among[0])
        rows = np.vstack([among[self._waves], speed, among[self._shown]])
        if not self.length and self._shows_none(rows, trend):
            return
        slope, margin = self._regress(rows, powers, trend)
        unseen = np.where(np.abs(slope - self.value) > margin, 0.0, self.value)
        self.value = np.where(np.abs(slope) > margin, slope, unseen)
        self.length = math.sqrt(float(self.value @ self.value))

    def _make_room(self) -> None:
        """Put new windows behind the others."""
        if not self._new:
            return
        new = np.array(self._new).T
        self._new.clear()
        count = new.shape[1]
        if self._end + count > self._room.shape[1]:
            latest = self._room[:, max(self._begin, self._end + count - self._kept) : self._end]
            self._begin, self._end = 0, latest.shape[1]
            self._room[:, : self._end] = latest
        room, angles = self._room[:, self._end : self._end + count], self._orders * new[1]
        room[: len(new)] = new
        room[self._waves] = np.concatenate([np.cos(angles), np.sin(angles)])
        self._end += count
        self._begin = max(self._begin, self._end - self._kept)

    def _regress(self, rows: Array, powers: Array, trend: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from rows (w + 1 + k, n): waves, speed, values.

        `powers` (p, n) of time and the `trend` (n, p) that spans them are fitted as well.
        """
        fitted = len(rows) - 1 - len(self.value)
        others = np.linalg.qr(np.vstack([powers, rows[:fitted]]).T)[0] if fitted else trend
        columns = np.ascontiguousarray(rows[fitted:].T)
        return self._slope_of(columns - others @ (others.T @ columns))

    def _shows_none(self, rows: Array, trend: Array) -> bool:
        """Whether for sure no slope stands out, told by normal equations: a third of the time, but digits are lost."""
        fitted = len(rows) - 1 - len(self.value)
        free = rows - (rows @ trend) @ np.ascontiguousarray(trend.T)
        others = free[fitted:]
        if fitted:
            waves = free[:fitted]
            products = free @ waves.T
            squares = products[:fitted]
            try:
                pivots = np.square(np.linalg.cholesky(squares).diagonal())
            except np.linalg.LinAlgError:
                return False
            if (pivots < LEAST_PART * squares.diagonal()).any():
                return False
            others = others - np.linalg.solve(squares, products[fitted:].T).T @ waves
        # of speed and values with one another, and with what is one window later
        # by a copy: for an array with itself numpy asks for a symmetric product, which takes as long as all the rest
        same, later = (others @ others.copy().T).tolist(), (others[:, 1:] @ others[:, :-1].T).tolist()
        if any(same[k][k] <= ROUNDING**2 * float(row @ row) for k, row in enumerate(rows[fitted:])):
            return False
        return all(self._is_chance(same, later, k, rows.shape[1]) for k in range(1, len(same)))

    def _is_chance(self, same: list[list[float]], later: list[list[float]], place: int, count: int) -> bool:
        """Whether for sure a slope is none: by products of `count` speeds (0) and values, as `_slope_of`."""
        slope = same[0][place] / same[0][0]
        square = same[place][place] - slope * same[0][place]
        if square <= ROUNDING * same[place][place]:
            return False
        alike = later[place][place] - slope * (later[0][place] + later[place][0] - slope * later[0][0])
        alike = max(alike, 0.0)
        freedom = max(count * (square - alike) / (square + alike) - self._unknown - 1.0, 1.0)
        margin = float(self._quantile(freedom, 1.0 - CHANCE)) * math.sqrt(square / same[0][0] / freedom)
        return abs(slope) < SURELY * margin

    def _slope_of(self, free: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from speed and values (n, 1 + k) free of all else."""
        speed, values = free[:, 0], free[:, 1:]
        spread = max(float(speed @ speed), _TINY)
        slope = speed @ values / spread
        rest = values.T - slope[:, None] * speed
        squares = np.square(rest).sum(axis=1)
        freedom = np.maximum(_independent(rest, squares) - self._unknown - 1.0, 1.0)
        deviation = np.sqrt(squares / spread / freedom)
        return slope, self._quantile(freedom, 1.0 - CHANCE) * deviation

    def __len__(self) -> int:
        return min(self._end - self._begin + len(self._new), self._kept)


def _trend(number: Array) -> tuple[Array, Array]:
    """Powers (TREND + 1, n) of the times of windows by their increasing numbers (n,), and what spans them, (n, …)."""
    count = len(number)
    return _uniform_trend(count) if number[-1] - number[0] == count - 1 else _trend_over(number - number.mean())


@lru_cache(maxsize=2)
def _uniform_trend(count: int) -> tuple[Array, Array]:
    """The same of so many windows without a gap: whoever measures as many needs the same."""
    return _trend_over(np.arange(count, dtype=np.float64) - 0.5 * (count - 1))


def _trend_over(time: Array) -> tuple[Array, Array]:
    powers = (time / max(float(np.abs(time).max()), 1.0)) ** np.arange(TREND + 1)[:, None]
    return powers, np.linalg.qr(powers.T)[0]


def _independent(rest: Array, square: Array) -> Array:
    """How many of n residuals (k, n) count where neighbours are alike (Bayley and Hammersley 1946, first order).

    `square` (k,) is the sum of their squares.
    """
    alike = (rest[:, 1:] * rest[:, :-1]).sum(axis=1).clip(0.0)
    return np.asarray(rest.shape[1] * (square - alike) / np.maximum(square + alike, _TINY))
