"""How fast the stage turns, as far as the heads told it."""

from __future__ import annotations

from rotary_error_monitor.pipeline.distance_reach import ACCELERATION
from rotary_error_monitor.pipeline.evidence import EvidenceWindow


class ToldSpeed:
    """Speed by the rotation in windows, and what it may be where these do not tell it.

    Attributes:
        number: of the window in which it was told last; None before.
    """

    def __init__(self, most: float) -> None:
        """Of a stage that turns at `most` rad/s."""
        self.number: int | None = None
        self._most, self._speed, self._duration = most, 0.0, 0.0

    def tell(self, window: EvidenceWindow, speed: float) -> None:
        """Take in a speed, rad/s, that a window told."""
        self.number, self._speed, self._duration = window.number, speed, window.duration

    def of(self, window: EvidenceWindow, last: EvidenceWindow | None) -> float:
        """Speed in a window by that before it, rad/s; where it is not told the largest that it can be."""
        if last is None or window.number != last.number + 1 or not (window.tells_rotation and last.tells_rotation):
            return self.largest(window.number)
        speed = (window.mean.theta - last.mean.theta) / window.duration
        self.tell(window, speed)
        return speed

    def largest(self, number: int) -> float:
        """How fast the stage may turn in a window by its number, rad/s: it may have accelerated since it was told."""
        if self.number is None:
            return self._most
        return min(self._most, abs(self._speed) + ACCELERATION * (number - self.number) * self._duration)
