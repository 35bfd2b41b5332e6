"""A rotor that turns as it is commanded, by commands that become known only as it goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError

_LARGEST = 8192


class CommandedMotion:
    """Rotation that is at each command where that says, and as fast; between two it takes the cubic through both.

    After the last command it stands. What lies before a command stays as it was when that comes.
    """

    def __init__(self) -> None:
        """Motion at rest at angle 0 until the first command."""
        self._rows = np.zeros((_LARGEST, 3))
        self._count = 0

    @property
    def has_begun(self) -> bool:
        """Whether a command has come."""
        return self._count > 0

    @property
    def newest(self) -> float:
        """Time of the last command, s."""
        return float(self._rows[self._count - 1, 0])

    @property
    def last_angle(self) -> float:
        """Angle of the last command, rad."""
        return float(self._rows[self._count - 1, 1])

    def command(self, time: float, angle: float, velocity: float) -> None:
        """Be at `angle` (rad) at `time` (s), moving at `velocity` (rad/s).

        Raises:
            InputError: the time is not after that of the last command.
        """
        if self.has_begun and time <= self.newest:
            raise InputError(f"a command for {time} s, not after the last one at {self.newest} s")
        if self._count == _LARGEST:
            half = _LARGEST // 2
            self._rows[:half] = self._rows[half:]
            self._count = half
        self._rows[self._count] = time, angle, velocity
        self._count += 1

    def at(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle (n,) rad and velocity (n,) rad/s at `time` (n,) s; before the first command as at it, but at rest."""
        rows = self._rows[: max(self._count, 1)]
        after = np.searchsorted(rows[:, 0], time, side="right")
        begin, angle, speed = rows[np.maximum(after - 1, 0)].T
        end, next_angle, next_speed = rows[np.minimum(after, len(rows) - 1)].T
        moving = (after > 0) & (after < len(rows))
        step = np.where(moving, end - begin, 1.0)
        passed = np.where(moving, time - begin, 0.0)
        mean = (next_angle - angle) / step
        bend = (3 * mean - 2 * speed - next_speed) / step
        twist = (speed + next_speed - 2 * mean) / step**2
        turned = passed * (speed + passed * (bend + passed * twist))
        velocity = speed + passed * (2 * bend + 3 * passed * twist)
        return np.where(moving, angle + turned, angle), np.where(moving, velocity, 0.0)
