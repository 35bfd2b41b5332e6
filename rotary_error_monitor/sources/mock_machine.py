"""A machine that moves for ever: where the controller of a mock cell commands its axes at any time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.plant.stage import StagePlant

_SHARE = 0.35
_PERIODS = (7.0, 11.0, 13.0, 17.0, 19.0)
_LONGEST_STROKE = 0.15
_WIDEST_SWING = 0.6


@dataclass(frozen=True)
class AxisState:
    """Command to one axis: position (m or rad) and velocity (m/s or rad/s)."""

    letter: str
    position: float
    velocity: float


class MachineMotion:
    """Axes that swing about the middle of their travel, each with a period of its own; the monitored one is the stage.

    The periods share no factor, so the poses hardly repeat; strokes are bounded to keep speeds as in production.
    """

    def __init__(self, machine: MachineDescription, plant: StagePlant) -> None:
        """Motion of `machine`, whose monitored axis turns as `plant` is commanded."""
        self._machine = machine
        self._plant = plant

    def at(self, time_ns: int) -> tuple[AxisState, ...]:
        """Commands at `time_ns`, timestamp (ns), in the order of the machine's axes."""
        time = (time_ns - self._plant.epoch_ns) * 1e-9
        return tuple(self._axis(index, time) for index in range(len(self._machine.axes)))

    def _axis(self, index: int, time: float) -> AxisState:
        axis = self._machine.axes[index]
        if axis.letter == self._machine.monitored:
            angle, velocity = self._plant.motion.at(np.array([time]))
            return AxisState(axis.letter, float(angle[0]), float(velocity[0]))
        low, high = axis.travel
        stroke = min(_SHARE * (high - low), _LONGEST_STROKE if axis.kind == "linear" else _WIDEST_SWING)
        omega = 2 * math.pi / _PERIODS[index % len(_PERIODS)]
        position = 0.5 * (low + high) + stroke * math.sin(omega * time + index)
        return AxisState(axis.letter, position, stroke * omega * math.cos(omega * time + index))
