"""Effects of linear axes: squareness, scale, warmth, backlash, straightness, angular errors, cyclic errors."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Harmonic
from rotary_error_monitor.effects.effect import Parameter, Role, Searched, Values
from rotary_error_monitor.effects.machine_effect import (
    LINEAR,
    MachineEffect,
    axes_of,
    moved,
    positioning_error,
    with_positioning_error,
)

_NOWHERE = np.zeros(3)

_TURNED = {"XY": ("X", (0.0, 0.0, -1.0)), "XZ": ("Z", (0.0, 1.0, 0.0)), "YZ": ("Z", (-1.0, 0.0, 0.0))}
"""For each pair of axes the one whose guideway turns when they are out of square, and about what."""


class Squareness(MachineEffect):
    """Two linear axes are out of square."""

    name = "squareness"
    title = "squareness error"
    remedy = "Align the axes, or add the angle to the machine file (`calibrate squareness`)."
    source = "ISO 230-1, 3.6; Pan et al. 2013, Equation 8"
    parameters = (Parameter("angle", "rad", 1e-5, bound=1e-2),)

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Pairs of linear axes that the machine has."""
        letters = axes_of(machine, LINEAR)
        return tuple(pair for pair in _TURNED if all(letter in letters for letter in pair))

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Turn the axis."""
        letter, normal = _TURNED[location]
        return moved(machine, machine.body_of(letter).name, _NOWHERE, values[0] * np.asarray(normal))


class AxisScale(MachineEffect):
    """The scale of a linear axis is too long."""

    name = "axis_scale"
    title = "scale error of an axis"
    remedy = "Correct the axis's scale in the controller, or add it to the machine file (`calibrate positioning`)."
    source = "ISO 230-1, 3.4.2 (EXX); lowest order"
    axes = LINEAR
    parameters = (Parameter("relative", "1", 1e-5, bound=1e-2),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add in proportion to the position."""
        low, high = machine.axis(location).travel
        poly = values[0] * np.array([0.5 * (low + high), 0.5 * (high - low)])
        return with_positioning_error(machine, location, poly=[float(value) for value in poly])


class ThermalExpansion(MachineEffect):
    """The scale of a linear axis expands more than the twin says."""

    name = "thermal_expansion"
    title = "thermal expansion of an axis"
    remedy = "Check the axis's coefficient of expansion and where its thermometer sits."
    source = "ISO 230-3"
    axes = LINEAR
    parameters = (Parameter("coefficient", "1/K", 5e-6, bound=1e-3),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add to the axis's expansion."""
        return machine.with_axis(location, expansion=float(values[0]))


class AxisBacklash(MachineEffect):
    """An axis lags half of a width behind in its direction of travel."""

    name = "axis_backlash"
    title = "backlash of an axis"
    remedy = "Preload nut or gear, or enter the width as reversal error in the controller or the machine file."
    source = "ISO 230-2, 3.9 (reversal error B)"
    parameters = (Parameter("width", "m or rad", 1e-5, bound=1e-2),)

    def units(self, location: str) -> dict[str, str]:
        """That of the axis, by its letter (ISO 841): A to E are rotary."""
        return {"width": "rad" if location in ("A", "B", "C", "D", "E") else "m"}

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Each axis."""
        return machine.letters

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add to the axis's reversal."""
        return machine.with_axis(location, reversal=float(values[0]))


class AxisStraightness(MachineEffect):
    """A guideway sags."""

    name = "axis_straightness"
    title = "sag of a guideway"
    remedy = "Align or scrape the guideway, or add the sag to the machine file (`calibrate straightness`)."
    source = "ISO 230-1, 3.4.8 (straightness error motions); lowest order"
    parameters = (Parameter("sag", "m", 1e-5, bound=1e-2),)

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Error components across each linear axis."""
        return _across(machine, "XYZ")

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add a parabola over the travel."""
        return machine.with_error(location, poly=(0.0, 0.0, float(values[0])))


class AxisAngular(MachineEffect):
    """A guideway twists along its travel."""

    name = "axis_angular"
    title = "angular error of a guideway"
    remedy = "Align the guideway, or add the slope to the error component in the machine file (`calibrate machine`)."
    source = "ISO 230-1, 3.4.16 (angular error motions); lowest order"
    parameters = (Parameter("slope", "rad", 1e-5, bound=1e-2),)

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Angular components of each linear axis."""
        return tuple(f"E{about}{letter}" for letter in axes_of(machine, LINEAR) for about in "ABC")

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add a straight line over the travel."""
        return machine.with_error(location, poly=(0.0, float(values[0])))


class CyclicError(MachineEffect):
    """Screw, rack or scale let a linear axis err as a wave in its position."""

    name = "cyclic_error"
    title = "cyclic error of an axis"
    remedy = "Look for a screw pitch or scale period of that length; have the error compensated at its period."
    source = "ISO 230-2, Annex (periodic positioning error); pitch of a screw, period of a scale"
    axes = LINEAR
    parameters = (
        Parameter("period", "m", 1e-2, role=Role.SHAPE, bound=10.0, least=1e-4),
        Parameter("cos", "m", 3e-6, bound=1e-2),
        Parameter("sin", "m", 3e-6, bound=1e-2),
    )
    searched = Searched.WAVE

    def start(self, location: str) -> Values:
        """A period of a usual screw; a search finds the real one."""
        return np.array([1e-2, 0.0, 0.0])

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add a wave to the positioning error."""
        wave = Harmonic(2 * np.pi / float(values[0]), float(values[1]), float(values[2]))
        return with_positioning_error(machine, location, harmonic=(wave,))


def _across(machine: MachineDescription, directions: str) -> tuple[str, ...]:
    return tuple(
        f"E{across}{letter}"
        for letter in axes_of(machine, LINEAR)
        for across in directions
        if f"E{across}{letter}" != positioning_error(machine, letter)
    )
