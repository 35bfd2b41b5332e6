"""The parameters of a machine that a calibration can find, each by a name, and how one changes the description."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Displacement, Harmonic, Vector
from rotary_error_monitor.errors import InputError


@dataclass(frozen=True)
class Orders:
    """Which terms of the error components a calibration looks for.

    Heights and slopes of straightness, and all constants, are left out: they are location errors and squareness.

    Attributes:
        positioning, straightness, angular: powers of u for linear axes.
        harmonic: waves per revolution for rotary axes.
        reversal, expansion: True to look for the reversal error (thermal expansion) of each (linear) axis.
        setup: True to look for the displacement of the workpiece's frame.
    """

    positioning: tuple[int, ...] = (1, 2, 3)
    straightness: tuple[int, ...] = (2, 3)
    angular: tuple[int, ...] = (1, 2)
    harmonic: tuple[int, ...] = (1,)
    reversal: bool = False
    expansion: bool = False
    setup: bool = False


DEFAULT_ORDERS = Orders()


@dataclass(frozen=True)
class MachineParameter:
    """One number that describes a machine.

    Attributes:
        name: such as EXX.poly.1, ECC.harmonic.1.cos, carriage.rotation.z, X.reversal.
        unit: m, rad, or 1/K.
    """

    name: str
    unit: str

    def added(self, machine: MachineDescription, value: float) -> MachineDescription:
        """The machine with `value` more of this parameter.

        Raises:
            InputError: the machine has no such axis or body.
        """
        owner, kind, *rest = self.name.split(".")
        if kind == "poly":
            return machine.with_error(owner, poly=(*([0.0] * int(rest[0])), value))
        if kind == "harmonic":
            wave = Harmonic(float(rest[0]), value if rest[1] == "cos" else 0.0, value if rest[1] == "sin" else 0.0)
            return _with_wave(machine, owner, wave)
        if kind == "reversal":
            return machine.with_axis(owner, reversal=value)
        if kind == "expansion":
            return machine.with_axis(owner, expansion=value)
        x, y, z = (value if letter == rest[0] else 0.0 for letter in "xyz")
        change: Vector = (x, y, z)
        error = Displacement(shift=change) if kind == "shift" else Displacement(rotation=change)
        return machine.with_location_error(owner, error)


def list_parameters(machine: MachineDescription, orders: Orders = DEFAULT_ORDERS) -> tuple[MachineParameter, ...]:
    """Parameters of a machine, as few as describe it: error components by `orders`, then squareness and location.

    The first linear axis defines a direction, the second has one squareness error to it, the third two. Each rotary
    axis has two tilts; every one after the first also has the distance from the first, across that axis.
    """
    return (
        *_component_parameters(machine, orders),
        *_squareness_parameters(machine),
        *_rotary_location_parameters(machine),
        *_other_parameters(machine, orders),
    )


def apply_parameters(
    machine: MachineDescription, parameters: Sequence[MachineParameter], values: Array
) -> MachineDescription:
    """The machine with all these values added.

    Raises:
        InputError: numbers of parameters and values differ.
    """
    if len(parameters) != len(values):
        raise InputError(f"{len(values)} values for {len(parameters)} parameters; expected one for each")
    for parameter, value in zip(parameters, values, strict=True):
        machine = parameter.added(machine, float(value))
    return machine


def value_of(machine: MachineDescription, parameter: MachineParameter) -> float:
    """What the machine has of a parameter now.

    Raises:
        InputError: the machine has no such axis or body.
    """
    owner, kind, *rest = parameter.name.split(".")
    if kind == "poly":
        poly = machine.errors[owner].poly if owner in machine.errors else ()
        return poly[int(rest[0])] if len(poly) > int(rest[0]) else 0.0
    if kind == "harmonic":
        waves = machine.errors[owner].harmonic if owner in machine.errors else ()
        found = [wave for wave in waves if wave.order == float(rest[0])]
        return math.fsum(wave.cos if rest[1] == "cos" else wave.sin for wave in found)
    if kind == "reversal":
        return machine.axis(owner).reversal
    if kind == "expansion":
        return machine.axis(owner).expansion
    error = machine.body(owner).location_error
    return (error.shift if kind == "shift" else error.rotation)["xyz".index(rest[0])]


def without_errors(machine: MachineDescription) -> MachineDescription:
    """The ideal machine: the same bodies and axes, no error."""
    return replace(
        machine,
        errors={},
        bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies),
        axes=tuple(replace(axis, expansion=0.0, reversal=0.0) for axis in machine.axes),
    )


def _with_wave(machine: MachineDescription, name: str, wave: Harmonic) -> MachineDescription:
    """The machine with a wave added, merged with one of the same order that is there."""
    old = machine.errors.get(name)
    if old is None or all(other.order != wave.order for other in old.harmonic):
        return machine.with_error(name, harmonic=(wave,))
    merged = tuple(
        Harmonic(other.order, other.cos + wave.cos, other.sin + wave.sin) if other.order == wave.order else other
        for other in old.harmonic
    )
    return replace(machine, errors={**machine.errors, name: replace(old, harmonic=merged)})


def _component_parameters(machine: MachineDescription, orders: Orders) -> Iterator[MachineParameter]:
    for axis in machine.axes:
        own = _along(axis)
        for place, letter in enumerate(DIRECTIONS):
            name, unit = f"E{letter}{axis.letter}", "m" if place < 3 else "rad"
            if axis.kind == "rotary":
                for order in orders.harmonic:
                    yield from (MachineParameter(f"{name}.harmonic.{order}.{part}", unit) for part in ("cos", "sin"))
                continue
            powers = orders.angular if place >= 3 else orders.positioning if place == own else orders.straightness
            yield from (MachineParameter(f"{name}.poly.{power}", unit) for power in powers)


def _squareness_parameters(machine: MachineDescription) -> Iterator[MachineParameter]:
    seen: list[Axis] = []
    for body in machine.bodies:
        if body.axis is None or machine.axis(body.axis).kind != "linear":
            continue
        axis = machine.axis(body.axis)
        for other in seen[:2]:
            normal = np.abs(np.cross(axis.direction, other.direction))
            yield MachineParameter(f"{body.name}.rotation.{'xyz'[int(np.argmax(normal))]}", "rad")
        seen.append(axis)


def _rotary_location_parameters(machine: MachineDescription) -> Iterator[MachineParameter]:
    first: Axis | None = None
    for body in machine.bodies:
        if body.axis is None or machine.axis(body.axis).kind != "rotary":
            continue
        axis = machine.axis(body.axis)
        own = _along(axis)
        yield from (MachineParameter(f"{body.name}.rotation.{c}", "rad") for i, c in enumerate("xyz") if i != own)
        if first is not None:
            along = _along(first)
            yield from (MachineParameter(f"{body.name}.shift.{c}", "m") for i, c in enumerate("xyz") if i != along)
        first = first or axis


def _other_parameters(machine: MachineDescription, orders: Orders) -> Iterator[MachineParameter]:
    if orders.reversal:
        yield from (
            MachineParameter(f"{a.letter}.reversal", "m" if a.kind == "linear" else "rad") for a in machine.axes
        )
    if orders.expansion:
        yield from (MachineParameter(f"{a.letter}.expansion", "1/K") for a in machine.axes if a.kind == "linear")
    if orders.setup:
        for kind, unit in (("shift", "m"), ("rotation", "rad")):
            yield from (MachineParameter(f"{machine.workpiece}.{kind}.{c}", unit) for c in "xyz")


def _along(axis: Axis) -> int:
    """Which of x, y, z the axis moves along or about."""
    return int(np.argmax(np.abs(axis.direction)))
