"""What was seen of the rotor at each angle when it was there last: what turns with it is the same there again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

ANGLES = 360
"""Angles told apart in a turn: error motion of order 8 changes by a seventh of its size from one to the next."""

_STEP = 2 * math.pi / ANGLES


class TurnMemory:
    """A vector in the plane for each angle of the rotor at which one was seen.

    Attributes:
        empty: whether there is none yet.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        # a list, no array: within a window the rotor passes but a few of them
        self._seen: list[tuple[float, float] | None] = [None] * ANGLES
        self.empty = True

    def put(self, theta: float, moved: float, vector: tuple[float, float]) -> None:
        """Keep a mean over the angles (rad) from half of `moved` before `theta` to half of it behind."""
        seen = self._seen
        for place in _places(theta, moved):
            seen[place % ANGLES] = vector
        self.empty = False

    def get(self, theta: float, moved: float) -> tuple[float, float] | None:
        """The mean of what was seen at these angles; None where they are not all known."""
        places = _places(theta, moved)
        x = y = 0.0
        for place in places:
            vector = self._seen[place % ANGLES]
            if vector is None:
                return None
            x, y = x + vector[0], y + vector[1]
        return None if math.isnan(x) else (x / len(places), y / len(places))


class Course:
    """Where what is seen of the ring's centre was, over a turn and at last.

    Attributes:
        turn: at each angle.
        place: at last, m; None where nothing tells it.
        theta: rotation then, rad.
        number: of the window then.
        sure: whether it rests on heads of which none may have lost counts.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self.turn = TurnMemory()
        self.forget_last()

    def forget_last(self) -> None:
        """Where it was at last, and when, is not known any more."""
        self.place: tuple[float, float] | None = None
        self.theta: float | None = None
        self.number: int | None = None
        self.sure = False

    def moved(self, number: int, theta: float) -> float:
        """Rotation since the last window, rad; of a window behind a gap nothing but its middle is known."""
        return theta - self.theta if self.theta is not None and self.number == number - 1 else 0.0

    def follow_turn(self, first: int, thetas: Sequence[float], places: Sequence[tuple[float, float]]) -> None:
        """Take in, and keep for the turn, where it is for sure in windows one behind another from the `first` on."""
        moved = [self.moved(first, thetas[0]), *(theta - before for before, theta in pairwise(thetas))]
        for each in zip(thetas, moved, places, strict=True):
            self.turn.put(*each)
        self.follow(first + len(thetas) - 1, thetas[-1], places[-1], sure=True)

    def follow(self, number: int, theta: float, place: tuple[float, float], *, sure: bool) -> None:
        """Take in where it is in a window."""
        self.number, self.theta, self.place, self.sure = number, theta, place, sure


def _places(theta: float, moved: float) -> range:
    """The angles from half of `moved` before `theta` to half of it behind, rad: a turn at most, one after another."""
    half = abs(moved) / 2
    first, last = math.floor((theta - half) / _STEP), math.floor((theta + half) / _STEP)
    return range(first, min(last + 1, first + ANGLES))
