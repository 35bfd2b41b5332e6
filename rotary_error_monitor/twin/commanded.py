"""The commanded rotation between its samples, as a function of time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from rotary_error_monitor.arrays import Array

_SAMPLES = 2**12
"""Samples of the command whose cubics are made together: some seconds of it, in a tenth of a millisecond."""

_TIMES = 2**16
"""Times that are worked on together: those of a stretch of a recording, with fewer cubics than numbers around them."""


class CommandedRotation:
    """Angle of a command, a cubic between two samples that has the angle and the speed of both.

    A cubic hangs on its two samples alone. So those of a span of time are made when they are asked for, and the last
    ones are kept: for all of a long recording they take three times the room of the samples.

    Args:
        time: (n,) s of the samples, increasing, two or more.
        angle: (n,) rad.
        speed: (n,) rad/s.
    """

    def __init__(self, time: Array, angle: Array, speed: Array) -> None:
        self._time, self._angle, self._speed = time, angle, speed
        self._made: tuple[int, int, CubicHermiteSpline, Callable[[Array], Array]] | None = None

    def __call__(self, time: Array) -> Array:
        """Angle at any times, rad; beyond the samples by the first or the last cubic."""
        return self._in_parts(time, 2)

    def speed(self, time: Array) -> Array:
        """Its rate of change, rad/s."""
        return self._in_parts(time, 3)

    def _in_parts(self, time: Array, which: int) -> Array:
        wanted = np.asarray(time, np.float64)
        flat = wanted.reshape(-1)
        found = np.empty_like(flat)
        for first in range(0, len(flat), _TIMES):
            part = flat[first : first + _TIMES]
            found[first : first + _TIMES] = self._around(part)[which](part)
        return found.reshape(wanted.shape)

    def _around(self, time: Array) -> tuple[int, int, CubicHermiteSpline, Callable[[Array], Array]]:
        """First and last sample, cubics and their slopes, of a span that holds these times."""
        # One sample more on either side: a time on the last one would be beyond the cubics. What is not a number has
        # none.
        begin, end = np.searchsorted(self._time, [np.fmin.reduce(time), np.fmax.reduce(time)])
        first = max(int(begin) - 1, 0) // _SAMPLES * _SAMPLES
        last = min(-(-(int(end) + 2) // _SAMPLES) * _SAMPLES + 1, len(self._time))
        first = min(first, last - 2)
        if self._made is None or first < self._made[0] or last > self._made[1]:
            own = slice(first, last)
            angle = CubicHermiteSpline(self._time[own], self._angle[own], self._speed[own])
            self._made = first, last, angle, angle.derivative()
        return self._made
