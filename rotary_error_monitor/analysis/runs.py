"""Stretches of a recording in which the rotor turns at one speed in one direction."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Times = NDArray[np.int64]

WINDOW_NS = 100_000_000
"""Time over which a speed is taken, ns: some periods of what a drive trembles at."""

STEADY = 0.02
"""Part by which the speed may change within a window in a run of constant speed."""

ALIKE = 0.03
"""Part by which speeds within a run, and of two runs at the same speed, may differ."""

MOVING = 0.02
"""Part of the fastest speed from which the rotor turns; slower it stands, or sets off."""

LEAST_SPEED = 1e-3
"""Slowest rotation that is one, rad/s: a turn in one and three quarter hours."""

LONGEST_GAP_NS = 1_000_000_000
"""Longest time without an estimate within a run, ns."""


@dataclass(frozen=True)
class Segment:
    """Runs at one speed in one direction.

    Attributes:
        runs: first sample and the one after the last of each.
        speed: mean speed with its sign, rad/s.
        steady: whether it is constant within each run.
    """

    runs: tuple[tuple[int, int], ...]
    speed: float
    steady: bool

    @property
    def name(self) -> str:
        """Direction and speed, such as `forward 1.571 rad/s`."""
        way = "forward" if self.speed > 0 else "backward"
        return f"{way} {abs(self.speed):.4g} rad/s" + ("" if self.steady else ", speed changing")


def find_segments(times_ns: Times, theta: Array) -> tuple[Segment, ...]:
    """Segments in the order in which they begin.

    A direction in which no whole turn is made at a constant speed has one segment of all that turns, at changing speed:
    error motion values do not need a constant speed, but mean one.

    Args:
        times_ns: (n,) timestamps (ns), ascending.
        theta: (n,) rotation, rad, unwrapped.
    """
    if len(times_ns) < 3:
        return ()
    speed, change = speeds(times_ns, theta)
    moving = np.abs(speed) > max(MOVING * float(np.abs(speed).max()), LEAST_SPEED)
    steady = moving & (np.abs(change) <= STEADY * np.abs(speed))
    runs = [run for run in _stretches(times_ns, steady, np.sign(speed)) if _is_constant(speed[slice(*run)])]
    found = list(_alike(times_ns, theta, runs))
    for sense in (1, -1):
        if any(_longest(segment, theta) >= 2 * math.pi for segment in found if sense * segment.speed > 0):
            continue
        runs = _stretches(times_ns, moving & (np.sign(speed) == sense), np.sign(speed))
        long = [run for run in runs if abs(theta[run[1] - 1] - theta[run[0]]) >= 2 * math.pi]
        if long:
            found = [segment for segment in found if sense * segment.speed < 0]
            found.append(Segment(tuple(long), _mean_speed(times_ns, theta, long), steady=False))
    return tuple(sorted(found, key=lambda segment: segment.runs[0]))


def rests(times_ns: Times, theta: Array) -> list[tuple[int, int]]:
    """Stretches in which the rotor stands: first sample and the one after the last."""
    if len(times_ns) < 3:
        return []
    speed, _ = speeds(times_ns, theta)
    still = np.abs(speed) <= max(MOVING * float(np.abs(speed).max()), LEAST_SPEED)
    return _stretches(times_ns, still, np.zeros(len(theta)))


def speeds(times_ns: Times, theta: Array) -> tuple[Array, Array]:
    """(n,) speed over a window about each sample, rad/s, and its change over the window."""
    before = np.searchsorted(times_ns, times_ns - WINDOW_NS // 2)
    after = np.minimum(np.searchsorted(times_ns, times_ns + WINDOW_NS // 2), len(times_ns) - 1)
    span = np.maximum((times_ns[after] - times_ns[before]) * 1e-9, 1e-9)
    speed = (theta[after] - theta[before]) / span
    return speed, speed[after] - speed[before]


def _stretches(times_ns: Times, chosen: NDArray[np.bool_], sense: Array) -> list[tuple[int, int]]:
    """First sample and the one after the last of each stretch that is chosen, has one sense and no long gap."""
    ends = np.diff(times_ns) > LONGEST_GAP_NS
    breaks = ends | (np.diff(chosen.astype(np.int8)) != 0) | (np.diff(sense) != 0)
    edges = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(times_ns)]
    return [(a, b) for a, b in itertools.pairwise(edges) if chosen[a] and b - a > 1]


def _is_constant(speed: Array) -> bool:
    """Whether speeds (m,) that change slowly stay within `ALIKE` of their middle."""
    return float(np.ptp(speed)) <= 2 * ALIKE * abs(float(np.median(speed)))


def _alike(times_ns: Times, theta: Array, runs: Sequence[tuple[int, int]]) -> Iterator[Segment]:
    """Runs of like speed together, each speed within `ALIKE` of the longest run's."""
    left = sorted(runs, key=lambda run: run[0] - run[1])
    while left:
        speed = _mean_speed(times_ns, theta, left[:1])
        same = [run for run in left if abs(_mean_speed(times_ns, theta, [run]) - speed) <= ALIKE * abs(speed)]
        left = [run for run in left if run not in same]
        yield Segment(tuple(sorted(same)), _mean_speed(times_ns, theta, same), steady=True)


def _longest(segment: Segment, theta: Array) -> float:
    return max(abs(float(theta[last - 1] - theta[first])) for first, last in segment.runs)


def _mean_speed(times_ns: Times, theta: Array, runs: Sequence[tuple[int, int]]) -> float:
    turned = sum(float(theta[last - 1] - theta[first]) for first, last in runs)
    return turned / (sum(int(times_ns[last - 1] - times_ns[first]) for first, last in runs) * 1e-9)
