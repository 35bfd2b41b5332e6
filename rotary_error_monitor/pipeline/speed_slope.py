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


class SpeedSlope:
    """Slope over the speed of what windows show, by least squares; drift and some orders of the rotation beside it.

    The speed is that from the window before to the window after: jitter of the rotor is in what is seen as well, and a
    speed that ends at the window itself would go with it.

    Attributes:
        value: the slope (k,) where it stands out from what is left, in the unit of the values times s/rad; zero
            elsewhere.
    """

    def __init__(self, kept: int, size: int = 1, orders: int = 0) -> None:
        """Slope of `size` values over the `kept` latest windows, beside orders of the rotation up to `orders`."""
        from scipy.special import stdtrit  # loads for a third of a second: now, not when a sample waits

        self._quantile = stdtrit
        self._orders = np.arange(1, orders + 1)
        self._kept = kept
        # twice the room: only once in `kept` windows the latest are moved to the front
        self._room = np.empty((2 * kept, 2 + size))
        self._begin = self._end = 0
        self._time, self._powers = np.empty(0), np.empty((0, TREND + 1))
        self.value = np.zeros(size)

    def forget(self) -> None:
        """Forget the windows; what they have shown stays."""
        self._begin = self._end = 0

    def add(self, number: int, theta: float, *values: float) -> None:
        """Take in what the window of a `number` shows at a rotation (rad)."""
        if self._end == len(self._room):
            latest = self._room[self._end - self._kept + 1 :]
            self._room[: len(latest)] = latest
            self._begin, self._end = 0, len(latest)
        self._room[self._end] = (number, theta, *values)
        self._end += 1
        self._begin = max(self._begin, self._end - self._kept)

    def measure(self, duration: float) -> None:
        """Renew the slope by what was taken in, of windows of a duration (s).

        At a constant speed nothing is seen of it: what was seen before holds until it is contradicted.
        """
        rows = self._room[self._begin : self._end]
        inner = np.flatnonzero(rows[2:, 0] - rows[:-2, 0] == 2.0) + 1
        speed = (rows[inner + 1, 1] - rows[inner - 1, 1]) / (2.0 * duration)
        slope, margin = self._regress(rows[inner, 0], rows[inner, 1], np.column_stack([speed, rows[inner, 2:]]))
        unseen = np.where(np.abs(slope - self.value) > margin, 0.0, self.value)
        self.value = np.where(np.abs(slope) > margin, slope, unseen)

    def _regress(self, number: Array, theta: Array, rows: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from rows (n, 1 + k) of speed and values.

        The windows' numbers (n,) tell their times, which have gaps where samples were missing; `theta` (n,) is in rad.
        """
        angles, time = theta[:, None] * self._orders, number - number.mean() if len(number) else number
        time = time / max(float(np.abs(time).max(initial=0.0)), 1.0)
        known = np.column_stack([self._powers_of(time), np.cos(angles), np.sin(angles)])
        if len(rows) < 2 * known.shape[1]:
            return np.zeros_like(self.value), np.full_like(self.value, np.inf)
        others, _ = np.linalg.qr(known)
        free = rows - others @ (others.T @ rows)
        speed, values = free[:, 0], free[:, 1:]
        spread = max(float(speed @ speed), np.finfo(float).tiny)
        slope = speed @ values / spread
        rest = values - speed[:, None] * slope
        freedom = np.maximum(_independent(rest) - known.shape[1] - 1.0, 1.0)
        deviation = np.sqrt(np.square(rest).sum(axis=0) / spread / freedom)
        return slope, self._quantile(freedom, 1.0 - CHANCE) * deviation

    def _powers_of(self, time: Array) -> Array:
        """(n, TREND + 1) powers of times (n,); windows without a gap have the same times whenever all are kept."""
        if not np.array_equal(time, self._time):
            self._time, self._powers = time, time[:, None] ** np.arange(TREND + 1)
        return self._powers

    def __len__(self) -> int:
        return self._end - self._begin

    @property
    def length(self) -> float:
        """Length of the slope as a vector."""
        return math.sqrt(float(self.value @ self.value))


def _independent(rest: Array) -> Array:
    """How many of n residuals (n, k) count where neighbours are alike (Bayley and Hammersley 1946, first order)."""
    square = np.square(rest).sum(axis=0)
    alike = (rest[1:] * rest[:-1]).sum(axis=0).clip(0.0)
    return np.asarray(len(rest) * (square - alike) / np.maximum(square + alike, np.finfo(float).tiny))
