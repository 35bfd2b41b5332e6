"""The twin of a machine tool: predicts what a probe shows at static poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import (
    Displacement,
    ErrorComponent,
    Harmonic,
    MachineDescription,
    Vector,
)
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import MachineModel, arrange_machine, stand
from rotary_error_monitor.twin.finite import check_finite

Array = NDArray[np.float64]

FEWEST_POSES = 12


@dataclass(frozen=True)
class MachineRecording:
    """Static poses and what the probe showed.

    Attributes:
        positions: (n, axes) commanded, m or rad, columns in the machine's order.
        direction: (n, axes) sign of the travel by which each position was reached.
        temperature: (n,) °C.
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


@dataclass(frozen=True)
class Shift:
    """One uncertain number of a machine: the machine with it larger by its standard uncertainty."""

    name: str
    machine: MachineDescription


def uncertain_shifts(machine: MachineDescription) -> tuple[Shift, ...]:
    """The machine with each uncertain parameter off by one standard uncertainty.

    Names as in a digital twin: `errors.linear` and `errors.angular` are each coefficient that an error component has,
    the others are the parameters of that name.

    Raises:
        InputError: an uncertainty is stated of something unknown.
    """
    found: list[Shift] = []
    for name, size in machine.uncertainty.items():
        if size > 0:
            found += [Shift(label, shifted) for label, shifted in _shifted(machine, name, size)]
    return tuple(found)


def _shifted(machine: MachineDescription, name: str, size: float) -> list[tuple[str, MachineDescription]]:
    if name in ("errors.linear", "errors.angular"):
        wanted = "XYZ" if name == "errors.linear" else "ABC"
        return [item for component in machine.errors for item in _coefficients(machine, component, wanted, size)]
    if name == "expansion":
        linear = [axis.letter for axis in machine.axes if axis.kind == "linear"]
        return [(f"{name}.{letter}", machine.with_axis(letter, expansion=size)) for letter in linear]
    if name in ("reversal.linear", "reversal.angular"):
        kind = "linear" if name == "reversal.linear" else "rotary"
        letters = [axis.letter for axis in machine.axes if axis.kind == kind]
        return [(f"{name}.{letter}", machine.with_axis(letter, reversal=size)) for letter in letters]
    if name in ("location.linear", "location.angular"):
        moving = [body.name for body in machine.bodies if body.axis is not None]
        units = _SHIFTS if name == "location.linear" else _TURNS
        return [
            (f"{name}.{body}[{i}]", machine.with_location_error(body, _scaled(unit, size)))
            for body in moving
            for i, unit in enumerate(units)
        ]
    if name not in _PLACES:
        raise InputError(
            f"uncertainty: no parameter is called '{name}'; known are errors.linear, errors.angular, expansion, "
            f"reversal.linear, reversal.angular, location.linear, location.angular, {', '.join(_PLACES)}"
        )
    found = [(carrier, unit) for carrier, unit in _PLACES[name] if carrier == "tool" or carrier in machine.letters]
    return [
        (f"{name}[{i}]", machine.with_location_error(_body(machine, carrier), _scaled(unit, size)))
        for i, (carrier, unit) in enumerate(found)
    ]


def _coefficients(
    machine: MachineDescription, component: str, wanted: str, size: float
) -> list[tuple[str, MachineDescription]]:
    if component[1] not in wanted:
        return []
    errors: ErrorComponent = machine.errors[component]
    found = []
    for power, value in enumerate(errors.poly):
        # A coefficient of exactly zero is a choice of origin (a mean, a slope told as squareness), not measured.
        if value != 0.0:
            poly = (*(0.0,) * power, size)
            found.append((f"{component}.poly[{power}]", machine.with_error(component, poly=poly)))
    for wave in errors.harmonic:
        for cos, sin in ((size, 0.0), (0.0, size)):
            added = (Harmonic(wave.order, cos, sin),)
            found.append((f"{component}.harmonic[{wave.order:g}]", machine.with_error(component, harmonic=added)))
    return found


def _turn(*rotation: float) -> Displacement:
    a, b, c = rotation
    return Displacement(rotation=(a, b, c))


_SHIFTS = (Displacement((1, 0, 0)), Displacement((0, 1, 0)), Displacement((0, 0, 1)))
_TURNS = (_turn(1, 0, 0), _turn(0, 1, 0), _turn(0, 0, 1))

_PLACES: Mapping[str, Sequence[tuple[str, Displacement]]] = {
    "squareness": (("X", _turn(0, 0, -1)), ("Z", _turn(0, 1, 0)), ("Z", _turn(-1, 0, 0))),
    "orientation": (("C", _turn(1, 0, 0)), ("C", _turn(0, 1, 0)), ("A", _turn(0, 1, 0)), ("A", _turn(0, 0, 1))),
    "pivot_offset": (("A", Displacement((1, 0, 0))), ("A", Displacement((0, 1, 0)))),
    "head_length": (("tool", Displacement((0, 0, -1))),),
    "tool_length": (("tool", Displacement((0, 0, -1))),),
}
"""Which body each parameter displaces, by its axis letter or as the tool, and the displacement of size 1."""


def _body(machine: MachineDescription, carrier: str) -> str:
    return machine.tool if carrier == "tool" else machine.body_of(carrier).name


def _scaled(unit: Displacement, size: float) -> Displacement:
    def times(vector: Vector) -> Vector:
        return size * vector[0], size * vector[1], size * vector[2]

    return replace(unit, shift=times(unit.shift), rotation=times(unit.rotation))
