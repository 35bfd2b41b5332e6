"""Where rotation and command were to one another of late, as far as interpolation lets that be told."""

from __future__ import annotations

import operator
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.pipeline.evidence import SHORT

NEAR = 3
"""Windows in which some third difference shows what interpolation misses: as long as samples that are joined are apart.
One that changes its sign, of jumps of the acceleration one behind another, is small for a moment."""

OLDEST = SHORT + NEAR
"""Windows that a step between two samples takes at most, with those behind it in which nothing is missed again."""


class WindowDistance(NamedTuple):
    """What a window shows.

    Attributes:
        number: of the window.
        distance: of rotation and command, rad.
        speed: rad/s.
        missed: what interpolation may miss of the distance, rad.
    """

    number: int
    distance: float
    speed: float
    missed: float = 0.0


class DistancePlaces:
    """Keeps what a window is held against to tell a step.

    A step stays, and what interpolation misses does not: that is the last plain window, as long as a step may take, and
    later the window of which least is missed.

    Attributes:
        plain: the last window in which nothing is missed; none since something came between.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self.plain: WindowDistance | None = None
        self._bent: deque[WindowDistance] = deque(maxlen=OLDEST)
        self._course: deque[tuple[float, float]] = deque(maxlen=2 * OLDEST)

    def clear(self) -> None:
        """Forget all: what comes does not follow upon it."""
        self.plain = None
        self._bent.clear()
        self._course.clear()

    def follow(self, thetas: Iterable[float], distances: Iterable[float]) -> None:
        """Take in the rotation and the distance of the next windows, rad."""
        self._course.extend((theta - distance, distance) for theta, distance in zip(thetas, distances, strict=True))

    @property
    def course(self) -> tuple[Array, Array]:
        """(n,) angles of the command and (n,) distances of the latest windows, rad."""
        both = np.array(self._course).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def add(self, place: WindowDistance, *, plain: bool) -> None:
        """Take in the next window, in which something is missed or nothing."""
        if plain:
            self.plain = place._replace(missed=0.0)
            self._bent.clear()
        else:
            self._bent.append(place)

    def most_missed(self, missed: float) -> float:
        """What may be missed about now, rad, where so much is in the latest window."""
        return max([missed, *(each.missed for each in list(self._bent)[-NEAR:])])

    def before(self, number: int, last: WindowDistance) -> WindowDistance:
        """What the window of that number is held against, of which that before it is the `last`."""
        if self.plain is not None and not self.is_old(number):
            return self.plain
        since = [each for each in self._bent if each.number >= number - OLDEST]
        missed = (max(near.missed for near in since[max(at - NEAR, 0) : at + NEAR + 1]) for at in range(len(since)))
        known = [place._replace(missed=most) for place, most in zip(since, missed, strict=True)]
        return min(known[:-NEAR], key=operator.attrgetter("missed"), default=last)

    def is_old(self, number: int) -> bool:
        """Whether the last plain window is longer ago than a step takes, for the window of that number."""
        return self.plain is not None and self.plain.number < number - OLDEST
