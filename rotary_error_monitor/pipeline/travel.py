"""The direction from which each axis of a machine came to where it stands: what its reversal error hangs on."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription

STILL = 1e-9
"""Motion (m or rad) that counts as none."""


class TravelDirections:
    """Direction of travel of each axis, step by step.

    An axis has turned back once it has gone back by more than half its reversal error: until then most of its play is
    not taken up, and the direction that it had is nearer to how it stands. So a joint that dithers by a count, at rest
    or in motion, keeps its direction.

    Attributes:
        direction: (axes,) +1 or -1, 0 before an axis has moved.
    """

    def __init__(self, machine: MachineDescription) -> None:
        """Axes of `machine` of which none has moved yet."""
        self._half = np.maximum(0.5 * np.abs([axis.reversal for axis in machine.axes]), STILL)
        self.direction: Array = np.zeros(len(machine.axes))
        self._back: Array = np.zeros(len(machine.axes))

    def move(self, moved: Array, speed: Array) -> Array:
        """Directions (axes,) after a motion (axes,) in m or rad; one that has only just begun is known by its speed."""
        first = np.where(np.abs(moved) > STILL, np.sign(moved), np.sign(speed))
        along = moved * self.direction
        self._back = np.minimum(self._back + along, 0.0)
        turned = self._back < -self._half
        self._back = np.where(turned, 0.0, self._back)
        self.direction = np.where(self.direction == 0.0, first, np.where(turned, -self.direction, self.direction))
        return self.direction

    def resume(self, speed: Array) -> Array:
        """Directions (axes,) after a time in which axes may have turned back: those of the speed, as far as it says."""
        self.direction = np.where(speed == 0.0, self.direction, np.sign(speed))
        self._back = np.zeros(len(speed))
        return self.direction
