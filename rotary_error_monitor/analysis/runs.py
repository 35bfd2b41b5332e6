"""Stretches of a recording in which the rotor turns at one speed in one direction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.rotation import ArrayCourse, Moving, RotationCourse, Stretch, Stretches, moving_parts
from rotary_error_monitor.arrays import Array, Times

STEADY = 0.02
"""Part by which the speed may change within a window in a run of constant speed."""

ALIKE = 0.03
"""Part by which speeds within a run, and of two runs at the same speed, may differ."""

MOVING = 0.02
"""Part of the fastest speed from which the rotor turns; slower it stands, or sets off."""

LEAST_SPEED = 1e-3
"""Slowest rotation that is one, rad/s: a turn in one and three quarter hours."""


@dataclass(frozen=True)
class Segment:
    """Runs at one speed in one direction.

    Attributes:
        runs: first sample and the one after the last of each.
        speed: mean speed with its sign, rad/s.
        steady: whether it is constant within each run.
        turned: how far it turns in all runs, rad.
        longest: how far in the longest run, rad.
        begin_ns: timestamp (ns) of its first sample.
    """

    runs: tuple[tuple[int, int], ...]
    speed: float
    steady: bool
    turned: float
    longest: float
    begin_ns: int

    @property
    def name(self) -> str:
        """Direction and speed, such as `forward 1.571 rad/s`."""
        way = "forward" if self.speed > 0 else "backward"
        return f"{way} {abs(self.speed):.4g} rad/s" + ("" if self.steady else ", speed changing")


def find_segments(times_ns: Times, theta: Array) -> tuple[Segment, ...]:
    """Segments of a rotation (n,), rad, unwrapped, at timestamps (n,), ns; see `segments_of`."""
    return segments_of(ArrayCourse(times_ns, theta))


def segments_of(course: RotationCourse) -> tuple[Segment, ...]:
    """Segments in the order in which they begin.

    A direction in which no whole turn is made at a constant speed has one segment of all that turns, at changing speed:
    error motion values do not need a constant speed, but mean one.
    """
    if len(course) < 3:
        return ()
    least = _least_speed(course)
    steady, turning = Stretches(), Stretches()
    for part in moving_parts(course):
        moving, sense = np.abs(part.speed) > least, np.sign(part.speed)
        steady.add(part, moving & (np.abs(part.change) <= STEADY * np.abs(part.speed)), sense)
        turning.add(part, moving, sense)
    found = [_segment(runs, steady=True) for runs in _alike(_constant(course, steady.found))]
    for sign in (1, -1):
        if any(segment.longest >= 2 * math.pi for segment in found if sign * segment.speed > 0):
            continue
        long = [run for run in turning.found if sign * run.fastest > 0 and abs(run.turned) >= 2 * math.pi]
        if long:
            found = [segment for segment in found if sign * segment.speed < 0]
            found.append(_segment(long, steady=False))
    return tuple(sorted(found, key=lambda segment: segment.runs[0]))


def rests(course: RotationCourse) -> list[Stretch]:
    """Stretches in which the rotor stands."""
    if len(course) < 3:
        return []
    least = _least_speed(course)
    standing = Stretches()
    for part in moving_parts(course):
        standing.add(part, np.abs(part.speed) <= least, np.zeros(len(part.speed)))
    return standing.found


def _least_speed(course: RotationCourse) -> float:
    """Speed above which the rotor turns, rad/s."""
    return max(MOVING * max(float(np.abs(part.speed).max()) for part in moving_parts(course)), LEAST_SPEED)


def _constant(course: RotationCourse, runs: Sequence[Stretch]) -> list[Stretch]:
    """Runs in which speeds that change slowly stay within `ALIKE` of their middle.

    The middle is a median, which need not be known for that: only how many speeds are so fast that they would do.
    """
    counts = [_Fast(run) for run in runs]
    at = 0
    for part in moving_parts(course):
        end = part.begin + len(part.speed)
        while at < len(runs) and runs[at].last <= part.begin:
            at += 1
        for count in counts[at:]:
            if count.run.first >= end:
                break
            count.add(part)
    return [count.run for count in counts if count.middle_is_fast]


class _Fast:
    """How many speeds of a run would do as its middle, for it to be constant."""

    def __init__(self, run: Stretch) -> None:
        self.run = run
        self._spread = run.fastest - run.slowest
        self._fast = 0
        self._slowest_fast, self._fastest_slow = math.inf, 0.0

    def add(self, part: Moving) -> None:
        """Count those of the run that are in a part."""
        first, last = max(self.run.first - part.begin, 0), self.run.last - part.begin
        speed = np.abs(part.speed[first:last])
        does = self._does(speed)
        self._fast += int(does.sum())
        self._slowest_fast = min(self._slowest_fast, float(speed[does].min(initial=math.inf)))
        self._fastest_slow = max(self._fastest_slow, float(speed[~does].max(initial=0.0)))

    @property
    def middle_is_fast(self) -> bool:
        """Whether the median of all does."""
        half, odd = divmod(self.run.last - self.run.first, 2)
        if odd or self._fast != half:
            return self._fast > half
        return bool(self._does(np.array(0.5 * (self._slowest_fast + self._fastest_slow))))

    def _does(self, speed: Array) -> NDArray[np.bool_]:
        return np.asarray(self._spread <= 2 * ALIKE * speed)


def _alike(runs: Sequence[Stretch]) -> Iterator[list[Stretch]]:
    """Runs of like speed together, each speed within `ALIKE` of the longest run's."""
    left = sorted(runs, key=lambda run: run.first - run.last)
    while left:
        speed = _mean_speed(left[:1])
        same = [run for run in left if abs(_mean_speed([run]) - speed) <= ALIKE * abs(speed)]
        taken = {run.first for run in same}
        left = [run for run in left if run.first not in taken]
        yield sorted(same, key=lambda run: run.first)


def _segment(runs: Sequence[Stretch], steady: bool) -> Segment:
    return Segment(
        tuple((run.first, run.last) for run in runs),
        _mean_speed(runs),
        steady,
        sum(abs(run.turned) for run in runs),
        max(abs(run.turned) for run in runs),
        runs[0].begin_ns,
    )


def _mean_speed(runs: Sequence[Stretch]) -> float:
    return sum(run.turned for run in runs) / (sum(run.end_ns - run.begin_ns for run in runs) * 1e-9)
