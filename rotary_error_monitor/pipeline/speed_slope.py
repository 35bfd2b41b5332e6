"""What of a quantity goes with the speed of the rotor: that is how a delay between two instruments shows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

CHANCE = 1e-9
"""Probability by which chance makes a slope that counts as seen, by Student's t: of few windows a rotor that hardly
changes its speed shows any slope."""

TREND = 2
"""Power of time up to which what is seen may drift, as where a stage warms up."""

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
        self._orders = np.arange(1, orders + 1)
        self._kept = kept
        # twice the room: only once in `kept` windows the latest are moved to the front
        self._room, self._waves = np.empty((2 * kept, 2 + size)), np.empty((2 * kept, 2 * orders))
        self._begin = self._end = 0
        self._new: list[tuple[float, ...]] = []  # windows that are not in the room yet
        self._trend = _Trend(orders == 0)
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
        rows = self._room[self._begin : self._end]
        inner = np.flatnonzero(rows[2:, 0] - rows[:-2, 0] == 2.0) + 1
        if len(inner) == len(rows) - 2:  # no gap: a view of them all, not a copy
            before, chosen, after = slice(0, -2), slice(1, -1), slice(2, None)
        else:
            before, chosen, after = inner - 1, inner, inner + 1
        speed = (rows[after, 1] - rows[before, 1]) / (2.0 * duration)
        waves = self._waves[self._begin : self._end][chosen]
        slope, margin = self._regress(rows[chosen, 0], waves, np.column_stack([speed, rows[chosen, 2:]]))
        unseen = np.where(np.abs(slope - self.value) > margin, 0.0, self.value)
        self.value = np.where(np.abs(slope) > margin, slope, unseen)
        self.length = math.sqrt(float(self.value @ self.value))

    def _make_room(self) -> None:
        """Put new windows behind the others, with the waves of their angles: these are the same at each measurement."""
        if not self._new:
            return
        new = np.array(self._new)
        self._new.clear()
        if self._end + len(new) > len(self._room):
            latest = slice(max(self._begin, self._end + len(new) - self._kept), self._end)
            count = latest.stop - latest.start
            for each in (self._room, self._waves):
                each[:count] = each[latest]
            self._begin, self._end = 0, count
        place = slice(self._end, self._end + len(new))
        angles = new[:, 1:2] * self._orders
        self._room[place], self._waves[place] = new, np.hstack([np.cos(angles), np.sin(angles)])
        self._end = place.stop
        self._begin = max(self._begin, self._end - self._kept)

    def _regress(self, number: Array, waves: Array, rows: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from rows (n, 1 + k) of speed and values.

        The windows' numbers (n,) tell their times, which have gaps where samples were missing; `waves` (n, w) are
        those of the rotation.
        """
        unknown = TREND + 1 + waves.shape[1]
        if len(rows) < 2 * unknown:
            return np.zeros_like(self.value), np.full_like(self.value, np.inf)
        others = self._trend.orthogonal(number, waves)
        free = rows - others @ (others.T @ rows)
        speed, values = free[:, 0], free[:, 1:]
        spread = max(float(speed @ speed), _TINY)
        slope = speed @ values / spread
        rest = values - speed[:, None] * slope
        squares = np.square(rest).sum(axis=0)
        freedom = np.maximum(_independent(rest, squares) - unknown - 1.0, 1.0)
        deviation = np.sqrt(squares / spread / freedom)
        return slope, self._quantile(freedom, 1.0 - CHANCE) * deviation

    def __len__(self) -> int:
        return min(self._end - self._begin + len(self._new), self._kept)


class _Trend:
    """Powers of time, and with waves beside them what spans all of these.

    As many windows without a gap always have the same times: what was made of these is kept.
    """

    def __init__(self, alone: bool) -> None:
        """With `alone` there are never waves beside the powers."""
        self._alone = alone
        self._count, self._powers = 0, np.empty((0, TREND + 1))
        self._orthogonal = self._powers

    def orthogonal(self, number: Array, waves: Array) -> Array:
        """(n, TREND + 1 + w) orthonormal columns of the same span, for windows by their increasing numbers (n,)."""
        count = len(number)
        if count != self._count or number[-1] - number[0] != count - 1:
            time = number - number.mean()
            time = time / max(float(np.abs(time).max()), 1.0)
            self._powers = time[:, None] ** np.arange(TREND + 1)
            self._count = count if number[-1] - number[0] == count - 1 else 0
            if self._alone:
                self._orthogonal = np.linalg.qr(self._powers)[0]
        return self._orthogonal if self._alone else np.linalg.qr(np.column_stack([self._powers, waves]))[0]


def _independent(rest: Array, square: Array) -> Array:
    """How many of n residuals (n, k) count where neighbours are alike (Bayley and Hammersley 1946, first order).

    `square` (k,) is the sum of their squares.
    """
    alike = (rest[1:] * rest[:-1]).sum(axis=0).clip(0.0)
    return np.asarray(len(rest) * (square - alike) / np.maximum(square + alike, _TINY))
