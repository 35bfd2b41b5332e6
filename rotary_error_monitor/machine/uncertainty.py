"""The uncertain numbers of a machine's description, one by one: what each makes of the tool's place."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.description.machine import THERMOMETER, MachineDescription
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent, Harmonic, Vector
from rotary_error_monitor.errors import InputError

ALONG = 0.99
"""Part of a direction from which it is that of the axis itself: about it nothing can be measured of its place."""


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
    return tuple(Shift(each.name, each.change(machine, each.size)) for each in _numbers(machine))


def shifts_at_a_pose(machine: MachineDescription) -> tuple[Shift, ...]:
    """The same, and each error component that is read from a table off by one standard uncertainty as well.

    How the values of a table hang together along the axis is not stated; at one pose it does not matter.
    """
    numbers = [*_numbers(machine), *_tables(machine)]
    return tuple(Shift(each.name, each.change(machine, each.size)) for each in numbers)


def drawn_machines(machine: MachineDescription, count: int, seed: int) -> Iterator[MachineDescription]:
    """The machine with every uncertain number of `shifts_at_a_pose` off at once, drawn `count` times.

    Each number departs by a normal deviate of its standard uncertainty, independent of the others: the trials of a
    Monte Carlo propagation (JCGM 101:2008, 6.4.7). The same seed gives the same machines.

    Raises:
        InputError: the machine states no uncertainty, or one of something unknown.
    """
    numbers = [*_numbers(machine), *_tables(machine)]
    if not numbers:
        raise InputError(f"machine {machine.name} states no uncertainty; its file needs a section 'uncertainty'")
    for deviates in np.random.default_rng(seed).standard_normal((count, len(numbers))):
        drawn = machine
        for number, deviate in zip(numbers, deviates.tolist(), strict=True):
            drawn = number.change(drawn, deviate * number.size)
        yield drawn


Change = Callable[[MachineDescription, float], MachineDescription]
"""A machine with one number of it larger by so much."""


@dataclass(frozen=True)
class _Number:
    """An uncertain number: its name, its standard uncertainty, and how a machine has another one."""

    name: str
    size: float
    change: Change


def _numbers(machine: MachineDescription) -> list[_Number]:
    return [
        _Number(label, size, change)
        for name, size in machine.uncertainty.items()
        if size > 0
        for label, change in _changes(machine, name)
    ]


def _tables(machine: MachineDescription) -> list[_Number]:
    found = []
    for name, errors in machine.errors.items():
        size = machine.uncertainty.get("errors.linear" if name[1] in "XYZ" else "errors.angular", 0.0)
        if errors.table is not None and size > 0:
            found.append(_Number(f"{name}.table", size, _coefficient(name, 0)))
    return found


def calibrated_shifts(machine: MachineDescription) -> tuple[Shift, ...]:
    """The machine at one pose with what calibrations have measured off by its standard uncertainty, part by part.

    An error component is off as a whole. Squareness is off at each linear axis by itself, the place of a rotary axis or
    of the spindle by two tilts and two shifts across it.
    """
    found = []
    for name, size in machine.calibrated.items():
        if size > 0:
            found += [Shift(label, shifted) for label, shifted in _off(machine, name, size)]
    return tuple(found)


def measured_apart(machine: MachineDescription, label: str) -> bool:
    """Whether a calibration has measured what `shifts_at_a_pose` gives this name, so that it is known by itself."""
    if label.split(".")[0] in machine.calibrated or label.split("[")[0] in machine.calibrated:
        return True
    if not label.startswith("location."):
        return False
    body = next(body for body in machine.bodies if body.name == label.split(".")[2].split("[")[0])
    return f"location of {'spindle' if body.name == machine.spindle else body.axis}" in machine.calibrated


def _off(machine: MachineDescription, name: str, size: float) -> list[tuple[str, MachineDescription]]:
    """The machine with a calibrated part off by `size`."""
    if re.fullmatch("E[XYZABC][A-Z]", name) and name[2] in machine.letters:
        return [(name, machine.with_error(name, poly=(size,)))]
    if name == "squareness":
        turned = [(body, _turn(*normal)) for body, normal in _square_normals(machine)]
    else:
        owner = name.removeprefix("location of ").removesuffix(".shift")
        if owner == name or (owner not in machine.letters and owner != "spindle"):
            return []
        body = machine.spindle if owner == "spindle" else machine.body_of(owner).name
        if body is None:
            return []
        own = (0.0, 0.0, 1.0) if owner == "spindle" else machine.axis(owner).direction
        units = _SHIFTS if name.endswith(".shift") else _TURNS
        turned = [(body, unit) for unit, part in zip(units, own, strict=True) if abs(part) < ALONG]
    return [
        (f"{name}[{i}]", machine.with_location_error(body, _scaled(unit, size)))
        for i, (body, unit) in enumerate(turned)
    ]


def _square_normals(machine: MachineDescription) -> list[tuple[str, Vector]]:
    """Body of each linear axis and the direction about which its squareness to the first two before it turns it."""
    found: list[tuple[str, Vector]] = []
    seen: list[Vector] = []
    for body in machine.bodies:
        if body.axis is None or machine.axis(body.axis).kind != "linear":
            continue
        x, y, z = machine.axis(body.axis).direction
        for a, b, c in seen[:2]:
            found.append((body.name, (y * c - z * b, z * a - x * c, x * b - y * a)))
        seen.append((x, y, z))
    return found


def _changes(machine: MachineDescription, name: str) -> list[tuple[str, Change]]:
    if name in ("errors.linear", "errors.angular"):
        wanted = "XYZ" if name == "errors.linear" else "ABC"
        return [item for component in machine.errors for item in _coefficients(machine, component, wanted)]
    if name == "expansion":
        linear = [axis.letter for axis in machine.axes if axis.kind == "linear"]
        return [(f"{name}.{letter}", _of_axis(letter, "expansion")) for letter in linear]
    if name in ("reversal.linear", "reversal.angular"):
        kind = "linear" if name == "reversal.linear" else "rotary"
        letters = [axis.letter for axis in machine.axes if axis.kind == kind]
        return [(f"{name}.{letter}", _of_axis(letter, "reversal")) for letter in letters]
    if name in ("location.linear", "location.angular"):
        moving = [body.name for body in machine.bodies if body.axis is not None]
        units = _SHIFTS if name == "location.linear" else _TURNS
        return [(f"{name}.{body}[{i}]", _at_body(body, unit)) for body in moving for i, unit in enumerate(units)]
    if name == THERMOMETER:
        return [(name, _read_colder)]
    if name not in _PLACES:
        raise InputError(
            f"uncertainty: no parameter is called '{name}'; known are errors.linear, errors.angular, expansion, "
            f"{THERMOMETER}, reversal.linear, reversal.angular, location.linear, location.angular, {', '.join(_PLACES)}"
        )
    found = [(carrier, unit) for carrier, unit in _PLACES[name] if carrier == "tool" or carrier in machine.letters]
    return [(f"{name}[{i}]", _at_body(_body(machine, carrier), unit)) for i, (carrier, unit) in enumerate(found)]


def _read_colder(machine: MachineDescription, size: float) -> MachineDescription:
    """The machine that is warmer than its thermometer reads, K."""
    return replace(machine, reference_temperature=machine.reference_temperature - size)


def _coefficients(machine: MachineDescription, component: str, wanted: str) -> list[tuple[str, Change]]:
    if component[1] not in wanted:
        return []
    errors: ErrorComponent = machine.errors[component]
    found: list[tuple[str, Change]] = []
    for power, value in enumerate(errors.poly):
        # A coefficient of exactly zero is a choice of origin (a mean, a slope told as squareness), not measured.
        if value != 0.0:
            found.append((f"{component}.poly[{power}]", _coefficient(component, power)))
    for wave in errors.harmonic:
        for cos, sin in ((1.0, 0.0), (0.0, 1.0)):
            found.append((f"{component}.harmonic[{wave.order:g}]", _wave(component, wave.order, cos, sin)))
    return found


def _coefficient(component: str, power: int) -> Change:
    return lambda machine, size: machine.with_error(component, poly=(*(0.0,) * power, size))


def _wave(component: str, order: float, cos: float, sin: float) -> Change:
    return lambda machine, size: machine.with_error(component, harmonic=(Harmonic(order, cos * size, sin * size),))


def _of_axis(letter: str, name: str) -> Change:
    return lambda machine, size: machine.with_axis(letter, **{name: size})


def _at_body(body: str, unit: Displacement) -> Change:
    return lambda machine, size: machine.with_location_error(body, _scaled(unit, size))


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
