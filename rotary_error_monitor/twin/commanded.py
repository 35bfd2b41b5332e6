"""The commanded rotation between its samples, as a function of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array

_AT_ONCE = 2**14
"""Times that are worked on together: what is made on the way fits into a processor's cache."""


@dataclass(frozen=True)
class CommandCurve:
    """A command whose angle between two samples is the cubic that has the angle and the speed of both.

    As scipy's `CubicHermiteSpline`, which keeps the coefficients of all cubics: of a long recording three times as much
    as its samples. Beyond the samples the first and the last cubic go on.

    Attributes:
        time: (n,) s of the samples, increasing, two or more.
        angles: (n,) rad.
        speeds: (n,) rad/s.
    """

    time: Array
    angles: Array
    speeds: Array

    def angle(self, time: Array) -> Array:
        """Commanded rotation at any times, rad."""
        return self._in_parts(time, 0)

    def speed(self, time: Array) -> Array:
        """Its rate of change, rad/s."""
        return self._in_parts(time, 1)

    def _in_parts(self, time: Array, derivative: int) -> Array:
        wanted = np.asarray(time, np.float64)
        flat = wanted.reshape(-1)
        found = np.empty_like(flat)
        for first in range(0, len(flat), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            found[part] = self._evaluated(flat[part], derivative)
        return found.reshape(wanted.shape)

    def _evaluated(self, time: Array, derivative: int) -> Array:
        """(m,) by the coefficients of the cubics about their first sample (de Boor 1978, chapter IV)."""
        before = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        begin, angle, speed = self.time[before], self.angles[before], self.speeds[before]
        length = self.time[before + 1] - begin
        slope = (self.angles[before + 1] - angle) / length
        bend = (speed + self.speeds[before + 1] - 2 * slope) / length
        cubic, square = bend / length, (slope - speed) / length - bend
        since = time - begin
        if derivative:
            found = speed + 2 * square * since + 3 * cubic * (since * since)
            straight = speed + (self.speeds[before + 1] - speed) * (since / length)
            # a cubic that turns back between two samples of one direction of travel is no motion of a stage
            turns_back = (speed * self.speeds[before + 1] > 0) & (found * speed <= 0)
            return np.asarray(np.where(turns_back, straight, found), np.float64)
        return np.asarray(
            angle + speed * since + square * (since * since) + cubic * (since * since * since), np.float64
        )
