"""Where what is judged was most of the time: a fault that began unseen ends with a step back to there."""

from __future__ import annotations

from collections import deque

from rotary_error_monitor.pipeline.evidence import LONG, SHORT

Place = tuple[float, float]


class UsualLevel:
    """Places in the last ten seconds of believed windows."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._places: deque[Place] = deque(maxlen=10 * LONG)

    def add(self, place: Place) -> None:
        """Take in a window that is believed."""
        self._places.append(place)

    def is_at(self, place: Place, near: Place) -> bool:
        """Whether more than half of the windows, and no fewer than `SHORT`, were as near to a place in both."""
        (x, y), (width, height) = place, near
        count = sum(abs(each[0] - x) <= width and abs(each[1] - y) <= height for each in self._places)
        return count >= SHORT and 2 * count > len(self._places)
