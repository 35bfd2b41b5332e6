"""What of a quantity goes with the speed of the rotor: that is how a delay between two instruments shows."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

CHANCE = 1e-9
"""Probability by which chance makes a slope that counts as seen, by Student's t: of few windows a rotor that hardly
changes its speed shows any slope."""

Array = NDArray[np.float64]


class SpeedSlope:
    """Slope over the speed of what windows show, by least squares, from one window to the next.

    What drifts, or comes and goes slowly, hardly changes within 10 ms, whereas a delay shows at the moment at which the
    speed changes.

    Attributes:
        value: the slope (k,) where it stands out from what is left, in the unit of the values times s/rad; zero
            elsewhere.
    """

    def __init__(self, kept: int, size: int = 1, orders: int = 0) -> None:
        """Slope of `size` values over the `kept` latest windows, beside orders of the rotation up to `orders`."""
        from scipy.special import stdtrit  # loads for a third of a second: now, not when a sample waits

        self._quantile = stdtrit
        self._orders = np.arange(1, orders + 1)
        self._rows: deque[tuple[float, ...]] = deque(maxlen=kept)
        self.value = np.zeros(size)

    def forget(self) -> None:
        """Forget the windows; what they have shown stays."""
        self._rows.clear()

    def pause(self) -> None:
        """What is added next does not follow upon the last."""
        self._rows.append((math.nan,) * (2 + len(self.value)))

    def add(self, theta: float, speed: float, *values: float) -> None:
        """Take in what a window shows at a rotation (rad) and a speed (rad/s)."""
        self._rows.append((theta, speed, *values))

    def measure(self) -> None:
        """Renew the slope by what was taken in.

        At a constant speed nothing is seen of it: what was seen before holds until it is contradicted.
        """
        slope, margin = self._regress(np.array(self._rows))
        unseen = np.where(np.abs(slope - self.value) > margin, 0.0, self.value)
        self.value = np.where(np.abs(slope) > margin, slope, unseen)

    def _regress(self, rows: Array) -> tuple[Array, Array]:
        """Slope (k,), and how large it can be by chance, from rows of angle, speed and values."""
        angles = rows[:, :1] * self._orders
        changes = np.diff(np.column_stack([np.cos(angles), np.sin(angles), rows[:, 1:]]), axis=0)
        changes = changes[np.isfinite(changes).all(axis=1)]
        known, changes = np.split(changes, [2 * len(self._orders)], axis=1)
        if len(changes) < 2 * known.shape[1] + 2:
            return np.zeros_like(self.value), np.full_like(self.value, np.inf)
        others, _ = np.linalg.qr(known)
        changes = changes - others @ (others.T @ changes)
        speed, values = changes[:, 0], changes[:, 1:]
        spread = max(float(speed @ speed), np.finfo(float).tiny)
        slope = speed @ values / spread
        rest = values - speed[:, None] * slope
        # as many changes count as have a part in the slope, and of these as many as are independent
        part = spread**2 / max(float(np.sum(speed**4)), np.finfo(float).tiny)
        freedom = np.maximum(part * _independent(rest) - 1.0, 1.0)
        return slope, self._quantile(freedom, 1.0 - CHANCE) * np.sqrt(np.square(rest).mean(axis=0) / spread)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def length(self) -> float:
        """Length of the slope as a vector."""
        return math.sqrt(float(self.value @ self.value))


def _independent(rest: Array) -> Array:
    """Part of the residuals (n, k) that counts where neighbours are alike (Bayley and Hammersley 1946, first order)."""
    square = np.square(rest).sum(axis=0)
    alike = (rest[1:] * rest[:-1]).sum(axis=0).clip(0.0)
    return np.asarray((square - alike) / np.maximum(square + alike, 1e-300))
