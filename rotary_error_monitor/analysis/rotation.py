"""Rotation over time, looked at part by part: speeds about each sample, and stretches in which something holds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.signals.rows import parts_of

WINDOW_NS = 100_000_000
"""Time over which a speed is taken, ns: some periods of what a drive trembles at."""

LONGEST_GAP_NS = 1_000_000_000
"""Longest time without an estimate within a run, ns."""


class RotationCourse(Protocol):
    """Rotation at n times, ascending."""

    def __len__(self) -> int:
        """How many there are."""

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """Timestamps (ns) and rotation (rad, unwrapped) from one sample to before another."""

    def place(self, time_ns: int) -> int:
        """Number of the first sample that is not before a time; n where all are."""


@dataclass(frozen=True)
class ArrayCourse:
    """Rotation (n,), rad, at timestamps (n,), ns, that are in memory."""

    times_ns: Times
    theta: Array

    def __len__(self) -> int:
        return len(self.times_ns)

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """As `Course.read`."""
        return self.times_ns[first:last], self.theta[first:last]

    def place(self, time_ns: int) -> int:
        """As `Course.place`."""
        return int(np.searchsorted(self.times_ns, time_ns))


def span_of(course: RotationCourse) -> tuple[int, int]:
    """First and last timestamp (ns), of one sample at least."""
    return int(course.read(0, 1)[0][0]), int(course.read(len(course) - 1, len(course))[0][0])


@dataclass(frozen=True)
class Moving:
    """Samples from number `begin` on.

    Attributes:
        begin: number of the first.
        times_ns: (m,) timestamps (ns).
        theta: (m,) rotation, rad.
        speed: (m,) over a window about each, rad/s.
        change: (m,) of the speed over the window, rad/s.
    """

    begin: int
    times_ns: Times
    theta: Array
    speed: Array
    change: Array


def speeds_in(course: RotationCourse, first: int, last: int) -> Moving:
    """Speeds from one sample to before another, the same whatever else is looked at with them."""
    times, _ = course.read(first, last)
    # the speed at the end of the window rests on samples to both of its own sides
    low = course.place(int(times[0]) - WINDOW_NS)
    high = len(course)
    at_end = course.place(int(times[-1]) + WINDOW_NS // 2)
    if at_end < high:
        time, _ = course.read(at_end, at_end + 1)
        high = min(high, course.place(int(time[0]) + WINDOW_NS // 2) + 1)
    times, theta = course.read(low, high)
    speed, change = _speeds(times, theta)
    inside = slice(first - low, last - low)
    return Moving(first, times[inside], theta[inside], speed[inside], change[inside])


def moving_parts(course: RotationCourse) -> Iterator[Moving]:
    """All samples with their speeds, some at a time."""
    return (speeds_in(course, first, last) for first, last in parts_of(0, len(course)))


def _speeds(times_ns: Times, theta: Array) -> tuple[Array, Array]:
    """(n,) speed over a window about each sample, rad/s, and its change over the window."""
    before = np.searchsorted(times_ns, times_ns - WINDOW_NS // 2)
    after = np.minimum(np.searchsorted(times_ns, times_ns + WINDOW_NS // 2), len(times_ns) - 1)
    span = np.maximum((times_ns[after] - times_ns[before]) * 1e-9, 1e-9)
    speed = (theta[after] - theta[before]) / span
    return speed, speed[after] - speed[before]


@dataclass(frozen=True)
class Stretch:
    """Samples one behind another.

    Attributes:
        first, last: number of the first, and of the one after the last.
        begin_ns, end_ns: timestamps (ns) of its first and last sample.
        begin, end: rotation at these, rad.
        slowest, fastest: smallest and largest speed, rad/s.
    """

    first: int
    last: int
    begin_ns: int
    end_ns: int
    begin: float
    end: float
    slowest: float
    fastest: float

    @property
    def turned(self) -> float:
        """Rotation from its first to its last sample, rad."""
        return self.end - self.begin

    def followed_by(self, other: Stretch) -> Stretch:
        """Both as one, the other behind it."""
        return replace(
            self,
            last=other.last,
            end_ns=other.end_ns,
            end=other.end,
            slowest=min(self.slowest, other.slowest),
            fastest=max(self.fastest, other.fastest),
        )


class Stretches:
    """Finds the stretches in which something holds, with one sense and no long gap, part after part."""

    def __init__(self) -> None:
        self._found: list[Stretch] = []
        self._before: tuple[int, bool, float] | None = None

    def add(self, part: Moving, chosen: NDArray[np.bool_], sense: Array) -> None:
        """Take the next samples: whether it holds (m,), and in which sense (m,)."""
        times = part.times_ns
        breaks = (np.diff(times) > LONGEST_GAP_NS) | (chosen[1:] != chosen[:-1]) | (sense[1:] != sense[:-1])
        edges = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(times)]
        goes_on = self._before is not None and (
            int(times[0]) - self._before[0] <= LONGEST_GAP_NS and self._before[1:] == (chosen[0], sense[0])
        )
        for a, b in itertools.pairwise(edges):
            if not chosen[a]:
                continue
            speed = part.speed[a:b]
            found = Stretch(
                part.begin + a,
                part.begin + b,
                int(times[a]),
                int(times[b - 1]),
                float(part.theta[a]),
                float(part.theta[b - 1]),
                float(speed.min()),
                float(speed.max()),
            )
            if a == 0 and goes_on:
                found = self._found.pop().followed_by(found)
            self._found.append(found)
        self._before = int(times[-1]), bool(chosen[-1]), float(sense[-1])

    @property
    def found(self) -> list[Stretch]:
        """Those of more than one sample."""
        return [each for each in self._found if each.last - each.first > 1]
