"""Effects of rotary axes and of what they carry: harmonics, orientation, pivot, droop, tool, set-up."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Harmonic
from rotary_error_monitor.effects.effect import Parameter, Searched, Values, wave_of_order
from rotary_error_monitor.effects.machine_effect import ROTARY, MachineEffect, axes_of, moved, with_positioning_error

_NOWHERE = np.zeros(3)


class RotaryHarmonic(MachineEffect):
    """The positioning error of a rotary axis has one more harmonic."""

    name = "rotary_harmonic"
    title = "harmonic of a rotary axis's positioning"
    remedy = "Calibrate the rotary axis and add the harmonic to the machine file, or to the controller's table."
    source = "ISO 230-1, 3.4.17 (ECC); eccentricity and shape of scale or gear"
    axes = ROTARY
    parameters = wave_of_order("rad", 1e-5, bound=1e-2, highest=12)
    searched = Searched.ORDER

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add the harmonic."""
        wave = Harmonic(round(float(values[0])), float(values[1]), float(values[2]))
        return with_positioning_error(machine, location, harmonic=(wave,))


class PivotOffset(MachineEffect):
    """The second rotary axis misses the first one."""

    name = "pivot_offset"
    title = "offset between the rotary axes"
    remedy = "Measure the offset between the rotary axes and state it in the machine file (`calibrate machine`)."
    source = "ISO 230-1, location errors of rotary axes; Pan et al. 2013, Table 2"
    parameters = (Parameter("shift", "m", 1e-5, 2, bound=1e-2),)

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """One place, if there are two rotary axes on one another."""
        return ("",) if len(axes_of(machine, ROTARY)) > 1 else ()

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Shift the carried axis in the plane across the carrying one."""
        return moved(machine, _carried(machine), np.array([values[0], values[1], 0.0]), _NOWHERE)


class AxisOrientation(MachineEffect):
    """A rotary axis is tilted on what carries it."""

    name = "axis_orientation"
    title = "orientation error of a rotary axis"
    remedy = "Align the axis, or add the tilt to its location errors in the machine file (`calibrate squareness`)."
    source = "ISO 230-1, location errors of rotary axes (A0C, B0C)"
    axes = ROTARY
    parameters = (Parameter("tilt", "rad", 1e-5, 2, bound=1e-2),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Turn the axis about the two directions across it, in the order x, y, z."""
        along = int(np.argmax(np.abs(machine.axis(location).direction)))
        rotation = np.zeros(3)
        rotation[[i for i in range(3) if i != along]] = values
        return moved(machine, machine.body_of(location).name, _NOWHERE, rotation)


class HeadDroop(MachineEffect):
    """A tilting head yields to its own weight."""

    name = "head_droop"
    title = "droop of the tilting head"
    remedy = "Balance or stiffen the head, or add the droop to the machine file (`calibrate machine`)."
    source = "gravity on a lever: moment in proportion to the sine of the tilt"
    parameters = (Parameter("coefficient", "rad", 1e-5, bound=1e-2),)

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """One place, if an axis A tilts the head."""
        return ("",) if "A" in machine.letters else ()

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add to the tilting axis's positioning error."""
        return with_positioning_error(machine, "A", harmonic=(Harmonic(1, 0.0, float(values[0])),))


class ToolLength(MachineEffect):
    """The tool is longer than the twin says."""

    name = "tool_length"
    title = "tool length error"
    remedy = "Measure the tool and correct its length."
    source = "ISO 230-1; Pan et al. 2013, Table 1 (bodies 8 and 9)"
    parameters = (Parameter("offset", "m", 1e-5, bound=1e-2),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Shift the tool tip along the tool, away from the spindle."""
        return moved(machine, machine.tool, np.array([0.0, 0.0, -float(values[0])]), _NOWHERE)


class SetupOffset(MachineEffect):
    """The workpiece stands elsewhere on the machine than the twin says."""

    name = "setup_offset"
    title = "displaced workpiece"
    remedy = "Probe the workpiece again and correct its frame."
    source = "set-up of the workpiece frame; rigid displacement"
    parameters = (Parameter("shift", "m", 2e-5, 3, bound=1e-2), Parameter("rotation", "rad", 1e-5, 3, bound=1e-2))

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Displace the workpiece on what carries it."""
        return moved(machine, machine.workpiece, values[:3], values[3:])


def _carried(machine: MachineDescription) -> str:
    """Body of the rotary axis that another rotary axis carries."""
    rotary = [body for body in machine.bodies if body.axis in axes_of(machine, ROTARY)]
    return next((body.name for body in rotary if any(body.parent == other.name for other in rotary)), rotary[-1].name)
