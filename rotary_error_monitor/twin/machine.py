"""The twin of a machine tool: predicts what a probe shows at static poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import MachineModel, arrange_machine, stand
from rotary_error_monitor.twin.finite import check_finite

FEWEST_POSES = 12


@dataclass(frozen=True)
class MachineRecording:
    """Static poses and what the probe showed.

    Attributes:
        positions: (n, axes) commanded, m or rad, columns in the machine's order.
        direction: (n, axes) sign of the travel by which each position was reached.
        temperature: (n,) °C, not a number where none was read.
        probe: (n, 3) tool tip as it is minus as it should be, in the workpiece's frame, m.
        remarks: what a reader should know.
    """

    positions: Array
    direction: Array
    temperature: Array
    probe: Array
    remarks: tuple[str, ...] = ()
    _ideal: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    def ideal_tool(self, model: MachineModel) -> Array:
        """(3, 4, n) tool in workpiece of the ideal machine at the poses, kept: hardly an error changes that machine."""
        parts = model.ideal.axes, model.ideal.tool, model.ideal.workpiece, model.direction, model.rotary
        key = b"".join(part.tobytes() for part in parts)
        if key not in self._ideal:
            self._ideal[key] = stand(model, np.ascontiguousarray(self.positions.T), None).tool_in_workpiece()
        return self._ideal[key]


def predict_probe(machine: MachineDescription, recording: MachineRecording, causes: Sequence[Cause] = ()) -> Array:
    """(n, 3) offset of the tool tip, m, of the machine with the causes in it; exact in all rotations.

    Raises:
        UnpredictableError: a value is not finite.
    """
    for cause in causes:
        assert isinstance(cause.effect, MachineEffect)
        machine = cause.effect.amend(machine, cause.values, cause.location)
    model = arrange_machine(machine)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # what is not finite is told below
        offset = predict_tool_offset(
            model,
            recording.positions,
            direction=recording.direction,
            temperature=recording.temperature,
            ideal=recording.ideal_tool(model),
        )
    check_finite("the tool's offset", offset, causes)
    return offset[:, :3]
