"""What was seen of the rotor at each angle when it was there last: what turns with it is the same there again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Generic, NamedTuple, TypeVar

from rotary_error_monitor.pipeline.evidence import SIGMAS

ANGLES = 360
"""Angles told apart in a turn: error motion of order 8 changes by a seventh of its size from one to the next."""

_STEP = 2 * math.pi / ANGLES

Seen = TypeVar("Seen")


class AngleMemory(Generic[Seen]):
    """Something for each angle of the rotor at which it was seen.

    Attributes:
        empty: whether there is nothing yet.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        # a list, no array: within a window the rotor passes but a few of them
        self._seen: list[Seen | None] = [None] * ANGLES
        self.empty = True

    def put(self, theta: float, moved: float, seen: Seen) -> None:
        """Keep what was seen over the angles (rad) from half of `moved` before `theta` to half of it behind."""
        for place in _places(theta, moved):
            self._seen[place % ANGLES] = seen
        self.empty = False

    def complete(self, theta: float, moved: float, seen: Seen) -> None:
        """Keep what was seen as `put` does, but only where nothing was."""
        for place in _places(theta, moved):
            if self._seen[place % ANGLES] is None:
                self._seen[place % ANGLES] = seen
        self.empty = False

    def seen(self, theta: float, moved: float) -> list[Seen] | None:
        """What was seen at each of these angles; None where that is not known of all."""
        found = []
        for place in _places(theta, moved):
            each = self._seen[place % ANGLES]
            if each is None:
                return None
            found.append(each)
        return found


class TurnMemory(AngleMemory[tuple[float, float]]):
    """A vector in the plane for each angle of the rotor at which one was seen."""

    def get(self, theta: float, moved: float) -> tuple[float, float] | None:
        """The mean of what was seen at these angles; None where they are not all known."""
        found = self.seen(theta, moved)
        if found is None:
            return None
        x, y = sum([each[0] for each in found]), sum([each[1] for each in found])
        return None if math.isnan(x) else (x / len(found), y / len(found))


class Held(NamedTuple):
    """A window that others are held against.

    Attributes:
        number: of the window.
        shown: what the heads show, as `head_history.Shown`.
        noise: standard deviation of its place, m.
    """

    number: int
    shown: tuple[float, float, float, float]
    noise: float

    @property
    def place(self) -> tuple[float, float]:
        """Of the ring's centre, m."""
        return self.shown[2:]


class RingStep(NamedTuple):
    """A change that no bearing makes.

    Attributes:
        size: m.
        most: what the bearing and noise explain, m.
        windows: over how many it was found.
        before: what the heads showed before it, as of `Held`.
    """

    size: float
    most: float
    windows: int
    before: tuple[float, float, float, float]


class CentreCourse:
    """Where what is seen of the ring's centre was, over a turn and at last.

    Attributes:
        turn: at each angle.
        place: at last, m; None where nothing tells it.
        theta: rotation then, rad.
        number: of the window then.
        sure: whether it rests on heads of which none may have lost counts.
        held: number, place and noise (m) of the window that tells most of where it may be next: a step lasts, but the
            windows between which it is interpolated tell little.
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
        self.held: Held | None = None

    def moved(self, number: int, theta: float) -> float:
        """Rotation since the last window, rad; of a window behind a gap nothing but its middle is known."""
        return theta - self.theta if self.theta is not None and self.number == number - 1 else 0.0

    def follow_turn(self, first: int, thetas: Sequence[float], places: Sequence[tuple[float, float]]) -> None:
        """Take in, and keep for the turn, where it is for sure in windows one behind another from the `first` on."""
        moved = [self.moved(first, thetas[0]), *(theta - before for before, theta in pairwise(thetas))]
        for each in zip(thetas, moved, places, strict=True):
            self.turn.put(*each)
        self.follow(first + len(thetas) - 1, thetas[-1], places[-1], sure=True)

    def hold(self, window: Held, rate: float) -> RingStep | None:
        """Hold on to a window unless the one that is held tells more; give the step from that one if there is one.

        Args:
            window: the latest.
            rate: largest way from one window to the next, m.
        """
        before, self.held = self.held, window
        if before is None:
            return None
        way = rate * (window.number - before.number)
        if SIGMAS * before.noise + way < SIGMAS * window.noise:
            self.held = before
        size, most = distance(window.place, before.place), way + SIGMAS * math.hypot(before.noise, window.noise)
        return RingStep(size, most, window.number - before.number, before.shown) if size > most else None

    def holds(self, number: int) -> bool:
        """Whether a window is the one that is held."""
        return self.held is not None and self.held.number == number

    def follow(self, number: int, theta: float, place: tuple[float, float], *, sure: bool) -> None:
        """Take in where it is in a window."""
        self.number, self.theta, self.place, self.sure = number, theta, place, sure


def _places(theta: float, moved: float) -> range:
    """The angles from half of `moved` before `theta` to half of it behind, rad: a turn at most, one after another."""
    half = abs(moved) / 2
    first, last = math.floor((theta - half) / _STEP), math.floor((theta + half) / _STEP)
    return range(first, min(last + 1, first + ANGLES))


def distance(one: tuple[float, float], other: tuple[float, float]) -> float:
    """The larger of the two components."""
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))
