"""Faults of the five-axis machine: those that the vocabulary names, and others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.cases.faults.named import Named, Pair, Reals, unnamed, vocabulary
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Displacement
from rotary_error_monitor.plant.machine import MachineFault, MachineStates, over_travel

Vector = tuple[float, float, float]
TURNED = {"XY": ("X", (0.0, 0.0, -1.0)), "XZ": ("Z", (0.0, 1.0, 0.0)), "YZ": ("Z", (-1.0, 0.0, 0.0))}
"""For each pair of axes the one that is turned if they are out of square, and about what."""


@dataclass(frozen=True, kw_only=True)
class AxisFault(Named, MachineFault):
    """A named fault of the machine."""


@dataclass(frozen=True, kw_only=True)
class ComponentFault(AxisFault, ABC):
    """A fault that adds to one error component of one axis."""

    @property
    def component(self) -> str:
        """Name of the component, such as EXX."""
        return f"E{self.location}{self.location}"

    def err(self, errors: Reals, axis: Axis, column: int, poses: MachineStates) -> Reals:
        """Errors with this fault's."""
        if axis.letter != self.component[2]:
            return errors
        errors = errors.copy()
        q = poses.positions[:, column]
        added = self.added(q, over_travel(axis, q), poses.directions[:, column], poses.warming)
        errors[:, DIRECTIONS.index(self.component[1])] += added
        return errors

    @abstractmethod
    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """(n,) what is added at position `q`, scaled to the travel `u`, reached in `direction`, at `warming`."""


def _located(machine: MachineDescription, body: str, shift: Vector, rotation: Vector) -> MachineDescription:
    return machine.with_location_error(body, Displacement(shift, rotation))


@vocabulary("squareness")
class Squareness(AxisFault):
    """Two axes, `XY`, `XZ` or `YZ`, are out of square."""

    angle: float

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Turned axis."""
        letter, normal = TURNED[self.location]
        x, y, z = (self.angle * value for value in normal)
        return _located(machine, machine.body_of(letter).name, (0.0, 0.0, 0.0), (x, y, z))


@vocabulary("axis_scale")
class AxisScale(ComponentFault):
    """The scale of an axis is too long."""

    relative: float

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """In proportion to the position."""
        return self.relative * q


@vocabulary("thermal_expansion")
class ThermalExpansion(ComponentFault):
    """The scale of an axis expands more than described."""

    coefficient: float

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """In proportion to position and temperature."""
        return self.coefficient * warming * q


@vocabulary("axis_backlash")
class AxisBacklash(ComponentFault):
    """An axis lags behind by half of `width` in the direction of travel."""

    width: float

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Half the width, against the travel."""
        return -self.width / 2 * direction


@vocabulary("axis_straightness")
class AxisStraightness(ComponentFault):
    """A guideway sags; the location is the error component."""

    sag: float

    @property
    def component(self) -> str:
        """The location."""
        return self.location

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Parabola over the travel."""
        return self.sag * u**2


@vocabulary("axis_angular")
class AxisAngular(ComponentFault):
    """A guideway twists; the location is the error component."""

    slope: float

    @property
    def component(self) -> str:
        """The location."""
        return self.location

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Straight line over the travel."""
        return self.slope * u


@vocabulary("cyclic_error")
class CyclicError(ComponentFault):
    """Lead screw or scale let an axis err as a wave in its position."""

    period: float
    cos: float
    sin: float

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Wave."""
        phase = 2 * np.pi / self.period * q
        return self.cos * np.cos(phase) + self.sin * np.sin(phase)


@vocabulary("rotary_harmonic")
class RotaryHarmonic(ComponentFault):
    """One more order of a rotary axis's positioning error."""

    order: int
    cos: float
    sin: float

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Wave over the turn."""
        return self.cos * np.cos(self.order * q) + self.sin * np.sin(self.order * q)


@vocabulary("pivot_offset")
class PivotOffset(AxisFault):
    """Axis A sits beside axis C."""

    shift: Pair

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Shifted axis."""
        return _located(machine, machine.body_of("A").name, (*self.shift, 0.0), (0.0, 0.0, 0.0))


@vocabulary("axis_orientation")
class AxisOrientation(AxisFault):
    """The average line of axis `C` or `A` leans."""

    tilt: Pair

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Leaning axis."""
        first, second = self.tilt
        rotation = (first, second, 0.0) if self.location == "C" else (0.0, first, second)
        return _located(machine, machine.body_of(self.location).name, (0.0, 0.0, 0.0), rotation)


@vocabulary("head_droop")
class HeadDroop(ComponentFault):
    """Axis A gives way under the weight of the head."""

    coefficient: float
    component = "EAA"

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """In proportion to the lever of the weight."""
        return self.coefficient * np.sin(q)


@vocabulary("tool_length")
class ToolLength(AxisFault):
    """The tool is longer than described."""

    offset: float

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Longer tool."""
        return _located(machine, machine.tool, (0.0, 0.0, -self.offset), (0.0, 0.0, 0.0))


@vocabulary("setup_offset")
class SetupOffset(AxisFault):
    """The workpiece is clamped beside its place."""

    shift: Vector
    rotation: Vector

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Displaced workpiece."""
        return _located(machine, machine.workpiece, self.shift, self.rotation)


@unnamed("gantry_sag")
class GantrySag(ComponentFault):
    """The gantry bends under the carriage with a bump of its own shape in the middle of the travel."""

    sag: float
    component = "EZX"

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Narrow bump."""
        return self.sag * np.exp(-0.5 * (u / 0.2) ** 2)


@unnamed("ram_bend")
class RamBend(AxisFault):
    """The ram bends with its reach while the head leans: what moves Z also tilts with A."""

    angle: float

    def err(self, errors: Reals, axis: Axis, column: int, poses: MachineStates) -> Reals:
        """Pitch of the ram with the lever of the head."""
        if axis.letter != "A":
            return errors
        reach = np.linalg.norm(poses.positions[:, :3], axis=1)
        errors = errors.copy()
        errors[:, DIRECTIONS.index("B")] += self.angle * reach * np.sin(2 * poses.positions[:, column])
        return errors


@unnamed("warm_swivel")
class WarmSwivel(ComponentFault):
    """The swivel head grows sideways as it warms, once around C."""

    rate: float
    component = "EXC"

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Once around, in proportion to the temperature."""
        return self.rate * warming * np.cos(q)


@unnamed("cable_drag")
class CableDrag(ComponentFault):
    """Cables pull axis C the more the further it is wound up, against the travel."""

    angle: float
    component = "ECC"

    def added(self, q: Reals, u: Reals, direction: Reals, warming: Reals) -> Reals:
        """Loop that opens with the winding."""
        return -self.angle * direction * u**2
