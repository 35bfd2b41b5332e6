"""What an analysis keeps of streams of any length: distances of stamps, a course that is not too fine, all samples."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rotary_error_monitor.analysis.course import Samples
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.signals.rows import Keep, Rows, place_of

MOST_POINTS = 100_000
"""Points of a course that is kept: of more, two and two become one. A page shows a thousand of them side by side."""

MOST_DISTANCES = 1 << 20
"""Distances of stamps that are told apart; of more different ones they are rounded, to 2 ns, 4 ns, …"""

Pairing = Callable[[Times, Array], tuple[Times, Array]]
"""Makes one of each group (m, g): times (m,) and values (m,)."""


def mean_of(times_ns: Times, values: Array) -> tuple[Times, Array]:
    """Means of groups (m, g): what a slow thing was at their middle."""
    begin = times_ns[:, :1]
    return begin[:, 0] + (times_ns - begin).mean(axis=1).astype(np.int64), values.mean(axis=1)


def largest_of(times_ns: Times, values: Array) -> tuple[Times, Array]:
    """The largest of each group (m, g), and when it was."""
    place = np.argmax(values, axis=1)[:, None]
    return np.take_along_axis(times_ns, place, 1)[:, 0], np.take_along_axis(values, place, 1)[:, 0]


class KeptCourse:
    """A course (n,) over time, of which each point stands for as many samples."""

    def __init__(self, pairing: Pairing) -> None:
        """Nothing yet; `pairing` makes one point of several samples."""
        self._pairing = pairing
        self._each = 1
        self._waiting: tuple[Times, Array] = np.empty(0, np.int64), np.empty(0)
        self._times, self._values = [np.empty(0, np.int64)], [np.empty(0)]
        self._count = 0

    def add(self, times_ns: Times, values: Array) -> None:
        """Take the next samples: timestamps (m,), ns, and values (m,)."""
        times_ns, values = (np.concatenate(each) for each in zip(self._waiting, (times_ns, values), strict=True))
        whole = len(times_ns) - len(times_ns) % self._each
        self._waiting = times_ns[whole:], values[whole:]
        self._put(times_ns[:whole], values[:whole])
        while self._count > MOST_POINTS:
            self._each *= 2
            found = self.samples
            self._times, self._values, self._count = [], [], 0
            self._waiting = np.empty(0, np.int64), np.empty(0)
            even = len(found.times_ns) - len(found.times_ns) % 2
            points = self._pairing(found.times_ns[:even].reshape(-1, 2), found.values[:even].reshape(-1, 2))
            self._times, self._values = [points[0], found.times_ns[even:]], [points[1], found.values[even:]]
            self._count = len(points[0]) + len(found.times_ns) - even

    def _put(self, times_ns: Times, values: Array) -> None:
        if len(times_ns):
            times_ns, values = self._pairing(times_ns.reshape(-1, self._each), values.reshape(-1, self._each))
            self._times.append(times_ns)
            self._values.append(values)
            self._count += len(times_ns)

    @property
    def samples(self) -> Samples:
        """All points, with one of those samples that wait for others."""
        times, values = list(self._times), list(self._values)
        if len(self._waiting[0]):
            last = self._pairing(self._waiting[0][None], self._waiting[1][None])
            times.append(last[0])
            values.append(last[1])
        return Samples(np.concatenate(times), np.concatenate(values))


class KeptSamples:
    """All samples (n, k) of a stream and their times, ascending."""

    def __init__(self, keep: Keep, width: int) -> None:
        self._times: Rows = keep((), np.int64)
        self._values: Rows = keep((width,), np.float64)

    def __len__(self) -> int:
        return len(self._times)

    def add(self, times_ns: Times, values: Array) -> None:
        """Take the next samples: timestamps (m,), ns, and values (m, k)."""
        self._times.append(times_ns)
        self._values.append(values)

    def all(self) -> tuple[Times, Array]:
        """Timestamps (ns) and samples, as many as there are."""
        return self._times.read(0, len(self)), self._values.read(0, len(self))

    def between(self, begin_ns: int, end_ns: int) -> tuple[Times, Array]:
        """Timestamps (ns) and samples from one time to before another."""
        first, last = place_of(self._times, begin_ns), place_of(self._times, end_ns)
        return self._times.read(first, last), self._values.read(first, last)


class Distances:
    """How often stamps are how far apart, ns."""

    def __init__(self) -> None:
        self._values: Times = np.empty(0, np.int64)
        self._counts: Times = np.empty(0, np.int64)
        self._waiting: list[Times] = []
        self._size = 0
        self._rounded = 0

    def add(self, distances_ns: Times) -> None:
        """Take distances (m,), ns."""
        self._waiting.append(distances_ns)
        self._size += len(distances_ns)
        if self._size > MOST_DISTANCES:
            self._gather()

    def _gather(self) -> None:
        new = np.concatenate([*self._waiting, np.empty(0, np.int64)]) >> self._rounded << self._rounded
        self._waiting, self._size = [], 0
        values, counts = np.unique(new, return_counts=True)
        self._values, place = np.unique(np.concatenate([self._values, values]), return_inverse=True)
        self._counts = np.bincount(place, np.concatenate([self._counts, counts])).astype(np.int64)
        while len(self._values) > MOST_DISTANCES:
            self._rounded += 1
            self._values, place = np.unique(self._values >> self._rounded << self._rounded, return_inverse=True)
            self._counts = np.bincount(place, self._counts).astype(np.int64)

    def rate_and_jitter(self) -> tuple[float, float]:
        """Samples a second, Hz, and standard deviation of a stamp, s, by distances that are about the usual one."""
        self._gather()
        if not len(self._values):
            return 0.0, 0.0
        until = np.cumsum(self._counts)
        middle = np.searchsorted(until, [(until[-1] - 1) // 2, until[-1] // 2], side="right")
        distances = self._values.astype(np.float64)  # ns, which are whole: 200 ms are 5 Hz, and do not scatter
        period = float(distances[middle].mean())
        regular = np.abs(distances - period) < 0.5 * period
        if not regular.any():
            return 0.0, 0.0
        distances, counts = distances[regular], self._counts[regular]
        mean = float(np.average(distances, weights=counts))
        deviation = float(np.sqrt(np.average((distances - mean) ** 2, weights=counts)))
        return NANOSECONDS / mean, deviation / NANOSECONDS / math.sqrt(2)  # a distance has two stamps
