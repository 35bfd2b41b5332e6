"""Location errors of a machine by the names that ISO 230-1, ISO 230-7 and Pan et al. 2013, Table 2 give them.

A location error stands at a body: three shifts and three rotations, each of which changes how the body's axis (or the
spindle, along z) lies beside the axes that carry it. A rotation is a squareness error where it turns the axis towards
another, a parallelism error where the two run alike; a shift is a coplanarity error between axes that should meet, a
concentricity error between axes that should coincide. The symbol in brackets says the component: E, direction, 0, axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Body, Displacement
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.machine.topology import way

ALIKE = 1e-6
"""Sine of the angle below which directions count as the same; distance, m, below which lines count as meeting."""

SPINDLE = "spindle"


@dataclass(frozen=True)
class LocationError:
    """One component of a body's location error.

    Attributes:
        name: such as `squareness X-Y (EC0X)`.
        body: name of the body.
        displacement: this component alone.
    """

    name: str
    body: str
    displacement: Displacement


@dataclass(frozen=True)
class AxisLine:
    """Nominal line of an axis or of the spindle, all axes at zero.

    Attributes:
        name: letter of the axis, or `spindle`.
        body: that it moves.
        linear: whether it is a linear axis, which has a direction and no place.
        point, direction: (3,) in the base, m.
    """

    name: str
    body: str
    linear: bool
    point: Array
    direction: Array

    def is_along(self, direction: Array) -> bool:
        """Whether it runs along or against a unit vector."""
        return bool(np.linalg.norm(np.cross(self.direction, direction)) < ALIKE)


def nominal_lines(machine: MachineDescription) -> tuple[AxisLine, ...]:
    """Lines of all axes and of the spindle in the order of the bodies."""
    frames = ideal_frames(machine)
    found = []
    for body in machine.bodies:
        rotation, point = frames[body.name]
        if body.axis is not None:
            axis = machine.axis(body.axis)
            direction = rotation @ np.array(axis.direction)
            found.append(AxisLine(axis.letter, body.name, axis.kind == "linear", point, direction))
        if body.name == machine.spindle:
            found.append(AxisLine(SPINDLE, body.name, False, point, rotation[:, 2]))
    return tuple(found)


def ideal_frames(machine: MachineDescription) -> dict[str, tuple[Array, Array]]:
    """Rotation (3, 3) and origin (3,) m of each body in the base, by name, without errors and with all axes at zero."""
    zero = np.zeros((len(machine.axes), 1))
    found = {}
    for body in machine.bodies:
        # As the tool of a machine whose workpiece is the base, so that no way is shared.
        end = stand(arrange_machine(replace(machine, tool=body.name, workpiece="base")), zero, None).tool.end[:, :, 0]
        found[body.name] = end[:, :3], end[:, 3]
    return found


def location_errors(machine: MachineDescription) -> tuple[LocationError, ...]:
    """All components of location errors that are not zero, each with a name of its own."""
    lines, frames = nominal_lines(machine), ideal_frames(machine)
    found = []
    for body in machine.bodies:
        values = (*body.location_error.shift, *body.location_error.rotation)
        for component, value in enumerate(values):
            if value:
                name = _name(machine, lines, frames[body.name][0], body, component)
                found.append(LocationError(name, body.name, _alone(component, value)))
    return tuple(found)


def _alone(component: int, value: float) -> Displacement:
    x, y, z = (value if k == component % 3 else 0.0 for k in range(3))
    return Displacement(shift=(x, y, z)) if component < 3 else Displacement(rotation=(x, y, z))


def _name(machine: MachineDescription, lines: tuple[AxisLine, ...], frame: Array, body: Body, component: int) -> str:
    own = next((line for line in lines if line.body == body.name), None)
    letter = "xyz"[component % 3]
    if own is None:
        what = f"position of {body.name} along" if component < 3 else f"orientation of {body.name} about"
        return f"{what} {letter}"
    symbol = f"(E{DIRECTIONS[component]}0{'S' if own.name == SPINDLE else own.name})"
    carriers, others = _beside(machine, lines, own)
    direction = frame[:, component % 3]
    if component < 3:
        return f"{_shift(own, (*carriers, *others), direction, letter)} {symbol}"
    return f"{_rotation(own, carriers, others, direction, letter)} {symbol}"


def _beside(
    machine: MachineDescription, lines: tuple[AxisLine, ...], own: AxisLine
) -> tuple[list[AxisLine], list[AxisLine]]:
    """Lines that an axis may be told against: of what carries it, the nearest first, and of what it does not carry."""
    carriers = [body.name for body in way(machine, own.body)[-2::-1]]
    below = sorted((line for line in lines if line.body in carriers), key=lambda line: carriers.index(line.body))
    carried = {line.name for line in lines if own.body in [body.name for body in way(machine, line.body)]}
    return below, [line for line in lines if line.body not in carriers and line.name not in carried]


def _rotation(own: AxisLine, carriers: list[AxisLine], others: list[AxisLine], about: Array, letter: str) -> str:
    towards = np.cross(about, own.direction)
    if np.linalg.norm(towards) < ALIKE:
        return f"roll of {own.name}" if own.linear else f"zero position of {own.name}"
    # Of the other branch no axis is nearer than another: ISO 10791 tells rotary axes by the linear one beside them.
    ordered = sorted(others, key=lambda line: not line.is_along(own.direction))
    for other in (*carriers, *ordered):
        if other.is_along(towards) and (not own.linear or other.linear):
            return f"squareness {_pair(own, other)}"
        if other.is_along(own.direction):
            return f"parallelism {_pair(own, other)} about {letter}"
    return f"orientation of {own.name} about {letter}"


def _shift(own: AxisLine, others: tuple[AxisLine, ...], along: Array, letter: str) -> str:
    if own.is_along(along) or own.linear:
        return f"zero position of {own.name} along {letter}"
    for other in others:
        if other.linear:
            continue
        normal = np.cross(own.direction, other.direction)
        apart = own.point - other.point
        if np.linalg.norm(normal) < ALIKE:
            across = apart - (apart @ own.direction) * own.direction
            meets = bool(np.linalg.norm(across) < ALIKE)
            return f"{'concentricity' if meets else 'distance'} {_pair(own, other)} along {letter}"
        normal = normal / np.linalg.norm(normal)
        if np.linalg.norm(np.cross(normal, along)) < ALIKE:
            return f"{'coplanarity' if abs(apart @ normal) < ALIKE else 'distance'} {_pair(own, other)}"
    return f"position of {own.name} along {letter}"


def _pair(own: AxisLine, other: AxisLine) -> str:
    """Both names; of two linear axes in the order of the alphabet, as the paper has them."""
    names = [own.name, other.name]
    return "-".join(sorted(names) if own.linear and other.linear else names)
