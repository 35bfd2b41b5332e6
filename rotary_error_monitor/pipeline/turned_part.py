"""The part of a turn that a rotor was seen to go through."""

from __future__ import annotations

import math


class TurnedPart:
    """Keeps between which rotations a rotor was seen."""

    def __init__(self) -> None:
        """It was not seen yet."""
        self.forget()

    def forget(self) -> None:
        """It was not seen yet."""
        self._least, self._most = math.inf, -math.inf

    def add(self, theta: float) -> None:
        """It was seen at a rotation, rad."""
        self._least, self._most = min(self._least, theta), max(self._most, theta)

    @property
    def part(self) -> float:
        """Largest part of a turn between two rotations; 1 or more where it was a whole one."""
        return max(0.0, self._most - self._least) / (2.0 * math.pi)
