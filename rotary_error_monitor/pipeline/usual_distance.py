"""How far rotation and command were apart most of the time."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

from rotary_error_monitor.pipeline.evidence import LONG, SHORT
from rotary_error_monitor.pipeline.usual_level import UsualLevel


class UsualDistance:
    """Distances of rotation and command in the last ten seconds of believed windows, and the delays that were seen."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._level = UsualLevel()
        self._delays: deque[float] = deque(maxlen=10 * LONG // SHORT)  # of as long a time

    def add(self, distance: float, speed: float, delay: float) -> None:
        """Take in a distance (rad) that is believed, at a speed (rad/s) and the delay (s) that is known there."""
        self._level.add((distance + delay * speed, speed))

    def add_delay(self, delay: float) -> None:
        """Take in a delay, s, that was measured while the command was believed."""
        self._delays.append(delay)

    @property
    def delay(self) -> float:
        """The usual one, s; 0 where none was measured."""
        return median(self._delays) if self._delays else 0.0

    def is_at(self, distance: float, speed: float, near: float, hidden: float) -> bool:
        """Whether a distance at a speed is within `near`, rad, of what was usual.

        Distances at another speed tell it as far as a delay leaves open that may be another by the `hidden` time, s.
        """
        slower = near / hidden if hidden else math.inf
        return self._level.is_at((distance + self.delay * speed, speed), (near, slower))
