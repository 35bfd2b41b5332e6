"""A rotor that is steered after a command which becomes known only as it goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError

_LARGEST = 8192
_LONGEST = 0.1
"""An acceleration that no new command ends acts for no longer than this, s."""


class TrackedMotion:
    """Rotation that follows commands as a well damped drive with velocity feed-forward does.

    Between two commands the acceleration is constant, so the motion is smooth and known in closed form; what has been
    asked for once stays as it was, for a command acts only from its time on.
    """

    def __init__(self, bandwidth: float = 60.0) -> None:
        """Motion at rest at angle 0; it closes a distance within some `1 / bandwidth`, rad/s."""
        self._bandwidth = bandwidth
        self._rows = np.zeros((_LARGEST, 4))
        self._count = 0

    @property
    def has_begun(self) -> bool:
        """Whether a command has come."""
        return self._count > 0

    @property
    def newest(self) -> float:
        """Time of the last command, s."""
        return float(self._rows[self._count - 1, 0])

    def steer(self, time: float, angle: float, velocity: float) -> None:
        """Command from `time` (s) on: `angle` (rad) there, moving at `velocity` (rad/s). It starts at the first.

        Raises:
            InputError: the time is not after that of the last command.
        """
        if not self.has_begun:
            self._append(time, angle, 0.0, 0.0)
            return
        if time <= self.newest:
            raise InputError(f"a command for {time} s, not after the last one at {self.newest} s")
        here, speed = (float(part[0]) for part in self.at(np.array([time])))
        pull = self._bandwidth * (angle - here) + 2 * (velocity - speed)
        self._append(time, here, speed, self._bandwidth * pull)

    def at(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle (n,) rad and velocity (n,) rad/s at `time` (n,) s; before the first command as at it."""
        rows = self._rows[: max(self._count, 1)]
        start, angle, speed, acceleration = rows[np.maximum(np.searchsorted(rows[:, 0], time, side="right") - 1, 0)].T
        passed = np.maximum(time - start, 0.0)
        pushed = np.minimum(passed, _LONGEST)
        return angle + passed * speed + acceleration * pushed * (passed - pushed / 2), speed + acceleration * pushed

    def _append(self, *row: float) -> None:
        if self._count == _LARGEST:
            half = _LARGEST // 2
            self._rows[:half] = self._rows[half:]
            self._count = half
        self._rows[self._count] = row
        self._count += 1
