"""Two angles that are too far apart for both to be right: whether they are, and whether it is over."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class _Off:
    """Where a distance was too far, rad, at which speed, rad/s, and by how much, rad."""

    distance: float
    speed: float
    excess: float


class FarDistance:
    """Judges the distance of two angles by what it may be at rest, and by a delay of one against the other.

    An angle that is off is no delay, whatever the speed: what is told at rest is not over because the axis turns and a
    delay could explain it.
    """

    def __init__(self, at_rest: float, *, steady: bool) -> None:
        """Of angles that may be so far apart `at_rest`, rad; a `steady` delay is the same at each time."""
        self._at_rest, self._steady = at_rest, steady
        self._off: _Off | None = None
        self._has_returned = False

    @property
    def is_told(self) -> bool:
        """Whether a distance was too far since the last `clear`."""
        return self._off is not None

    def clear(self) -> None:
        """No distance is too far any more."""
        self._off, self._has_returned = None, False

    def allowed(self, speed: float, late: float) -> float:
        """Largest distance (rad) at a speed (rad/s), with a delay of up to `late` s."""
        return self._at_rest + late * abs(speed)

    def is_far(self, distance: float, speed: float, late: float, missed: float = 0.0) -> bool:
        """Whether a distance (rad) is too far, of which interpolation may miss some (rad)."""
        excess = abs(distance) - self.allowed(speed, late)
        if excess <= missed:
            return False
        self._has_returned = False
        # where it was farther it tells most, unless it is another one now
        if self._off is None or excess > self._off.excess or self.has_changed(distance, speed, 0.0, late):
            self._off = _Off(distance, speed, excess)
        return True

    def step(self, by: float, before: float, unknown: float) -> None:
        """A distance went at once `by` so much from what it was `before`, of which some may be of a delay, rad.

        Back by all that it was too far, and not as far to the other side, it is over at whatever speed.
        """
        if self._off is None:
            return
        back = -math.copysign(by, by * self._off.distance)
        farthest = max(abs(before), abs(self._off.distance)) + self._at_rest
        if back - unknown >= self._off.excess and back <= farthest + unknown:
            self._has_returned = True
        elif back + unknown < self._off.excess or back - unknown > farthest:
            self._has_returned = False

    def has_changed(self, distance: float, speed: float, delay: float, hidden: float) -> bool:
        """Whether a distance is another than where it was too far, with a delay (s) that is seen and what it hides.

        By more than it may vary at rest, or by all that it was too far.
        """
        if self._off is None or self._has_returned:
            return True
        faster = speed - self._off.speed
        unknown = hidden * (abs(faster) if self._steady else abs(speed) + abs(self._off.speed))
        changed = abs(distance - self._off.distance + delay * faster) - unknown
        return changed >= min(self._off.excess, self._at_rest)
