"""What was seen of the rotor at each angle when it was there last: what turns with it is the same there again."""

from __future__ import annotations

import math

import numpy as np

ANGLES = 360
"""Angles told apart in a turn: error motion of order 8 changes by a seventh of its size from one to the next."""


class TurnMemory:
    """A vector in the plane for each angle of the rotor at which one was seen."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._seen = np.full((ANGLES, 2), np.nan)

    def put(self, theta: float, moved: float, vector: tuple[float, float]) -> None:
        """Keep a mean over the angles (rad) from half of `moved` before `theta` to half of it behind."""
        self._seen[_places(theta, moved)] = vector

    def get(self, theta: float, moved: float) -> tuple[float, float] | None:
        """The mean of what was seen at these angles; None where they are not all known."""
        x, y = self._seen[_places(theta, moved)].mean(axis=0).tolist()
        return None if math.isnan(x) else (x, y)


def _places(theta: float, moved: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    step = 2 * math.pi / ANGLES
    first, last = math.floor((theta - abs(moved) / 2) / step), math.floor((theta + abs(moved) / 2) / step)
    return np.arange(first, min(last, first + ANGLES - 1) + 1) % ANGLES
