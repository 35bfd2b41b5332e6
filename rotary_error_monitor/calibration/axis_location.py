"""Where rotary axes and the spindle lie, from their lines as a tracker saw them, and a point that ties both frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.machine import Body, Displacement, MachineDescription, Vector
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.location_names import SPINDLE
from rotary_error_monitor.machine.topology import branches, way
from rotary_error_monitor.metrology.axis_fits import LineFit, LocationErrors, estimate_location_errors

Array = NDArray[np.float64]
Points = tuple[Array, Array]

ZERO = "zero"
"""Feature of readings of the tool tip with all axes at zero: it ties the tracker to the machine's coordinates."""

LEAST_ANGLE = 0.1
"""Rotary axes at a smaller angle, rad, count as parallel: they have a distance in two directions, not one."""


@dataclass(frozen=True)
class RotaryLocation:
    """How a rotary axis lies beside where the file has it, in the frame of its body.

    Attributes:
        rotation, rotation_uncertainty: (3,) tilt and its standard uncertainty, rad.
        shift, shift_uncertainty: (3,) displacement across the axis and its standard uncertainty, m; a component that
            was not measured keeps what the file has, with uncertainty NaN.
    """

    rotation: Array
    rotation_uncertainty: Array
    shift: Array
    shift_uncertainty: Array


@dataclass(frozen=True)
class Origin:
    """A point that is known in the machine's coordinates and was seen by the tracker.

    Attributes:
        place: (3,) in the machine's coordinates, m.
        seen: (3,) as the tracker saw it, turned into the machine's directions, m.
        covariance: (3, 3) of the difference, m².
        turn_covariance: (3, 3) of the rotation between the two frames, rad².
    """

    place: Array
    seen: Array
    covariance: Array
    turn_covariance: Array

    def located(self, line: LineFit) -> LineFit:
        """The line in the machine's coordinates."""
        lever = line.point - self.seen
        turned = _cross(lever) @ self.turn_covariance @ _cross(lever).T
        covariance = line.point_covariance + self.covariance + turned
        return replace(line, point=self.place + lever, point_covariance=covariance)


def body_of(machine: MachineDescription, name: str) -> Body:
    """The body that an axis moves, or that carries the spindle.

    Raises:
        InputError: the machine has no such axis, or its file names no spindle.
    """
    if name != SPINDLE:
        return machine.body_of(name)
    if machine.spindle is None:
        raise InputError(
            f"machine {machine.name} names no spindle; add `spindle: NAME` to its file, with the name of the body "
            "whose z is the spindle's axis"
        )
    return machine.body(machine.spindle)


def direction_of(machine: MachineDescription, name: str) -> Vector:
    """Direction of an axis, or of the spindle, in the frame of its body.

    Raises:
        InputError: the machine has no such axis.
    """
    return (0.0, 0.0, 1.0) if name == SPINDLE else machine.axis(name).direction


def carries(machine: MachineDescription, lower: str, upper: str) -> bool:
    """Whether an axis carries another, or the spindle."""
    return body_of(machine, lower) in way(machine, body_of(machine, upper).name)


def locate(job: Job, lines: Mapping[str, LineFit], origin: Origin, reference: str) -> dict[str, RotaryLocation]:
    """Location errors of rotary axes and the spindle, one after the other: what carries an axis is set before it.

    `lines` are in the machine's directions; the place of the axis `reference` stays, and so does that of a spindle
    which the reference does not carry.

    Raises:
        InputError: an axis lies far from where the file has it.
    """
    locations: dict[str, RotaryLocation] = {}
    for name, line in lines.items():
        machine = job.file.changed
        old, direction = np.array(body_of(machine, name).location_error.shift), direction_of(machine, name)
        rotation, place = frame_of(machine, body_of(machine, name).name)
        located = origin.located(line)
        local = turned(replace(located, point=located.point - place), rotation.inv().as_matrix())
        try:
            errors = estimate_location_errors(local, np.zeros(3), np.array(direction))
        except InputError as error:
            raise InputError(f"{job.source}: feature {name}: {error}") from error
        shift, spread = errors.shift, errors.shift_uncertainty
        apart = name == SPINDLE and not (reference in lines and carries(machine, reference, name))
        if name == reference or apart:
            shift, spread = old, np.full(3, np.nan)
        elif reference in lines:
            towards = rotation.inv().apply(lines[reference].direction)
            shift, spread = _along_normal(towards, np.array(direction), old, errors)
        locations[name] = RotaryLocation(errors.rotation, errors.rotation_uncertainty, shift, spread)
        job.file.set_location(name, shift, errors.rotation)
    return locations


def _along_normal(first: Array, direction: Array, old: Array, errors: LocationErrors) -> tuple[Array, Array]:
    """Shift and its uncertainty where only the distance from another axis, that runs along `first`, was measured."""
    normal = np.cross(first, direction)
    size = float(np.linalg.norm(normal))
    if size < LEAST_ANGLE:
        return errors.shift, errors.shift_uncertainty
    normal = normal / size
    shift = old + (errors.shift - old) @ normal * normal
    uncertainty = float(np.linalg.norm(errors.shift_uncertainty * normal))
    return shift, np.where(np.abs(normal) > LEAST_ANGLE, uncertainty * np.abs(normal), np.nan)


def origin_by_axis(machine: MachineDescription, lines: Mapping[str, LineFit], turn_covariance: Array) -> Origin:
    """The first rotary axis lies where the file has it, and along it so does the foot of an axis that crosses it.

    Without an axis that crosses, the first target of one that runs alike counts as at the origin of its body: a target
    at the spindle's nose, say. With one axis alone its own first target does.
    """
    names = list(lines)
    first = lines[names[0]]
    crossing = [name for name in names[1:] if _is_crossing(first, lines[name])]
    nominal = {name: _nominal_line(machine, name) for name in names}
    if crossing:
        along = _foot(first, lines[crossing[0]]) - _foot(nominal[names[0]], nominal[crossing[0]])
    elif len(names) > 1:
        alike = names[-1]
        along = float((lines[alike].point - first.point) @ first.direction)
        along -= float((nominal[alike].point - nominal[names[0]].point) @ nominal[names[0]].direction)
    else:
        along = 0.0
    seen = first.moved_along(along)
    return Origin(nominal[names[0]].point, seen.point, seen.point_covariance, turn_covariance)


def _is_crossing(first: LineFit, other: LineFit) -> bool:
    return bool(np.linalg.norm(np.cross(first.direction, other.direction)) > LEAST_ANGLE)


def _foot(first: LineFit, other: LineFit) -> float:
    """How far along the first line, from its point, it comes nearest to the other, m; zero where they run alike."""
    if not _is_crossing(first, other):
        return 0.0
    cosine = float(first.direction @ other.direction)
    towards = first.direction - cosine * other.direction
    return float((other.point - first.point) @ towards / (1 - cosine**2))


def _nominal_line(machine: MachineDescription, name: str) -> LineFit:
    """Line of an axis or the spindle as the file has it, all axes at zero, in the base."""
    body = body_of(machine, name)
    rotation, place = frame_of(machine, body.name)
    rotation, place = _moved(rotation, place, body.location_error)
    none = np.zeros((3, 3))
    return LineFit(place, rotation.apply(np.array(direction_of(machine, name))), none, none, 0.0)


def origin_by_tip(job: Job, rotary: Sequence[str], zero: Points, turn_covariance: Array) -> Origin:
    """The tool tip at zero lies where the file has it.

    Raises:
        InputError: one of the rotary axes moves the tool itself.
    """
    machine = job.file.changed
    of_workpiece = {body.axis for body in branches(machine)[1]}
    for letter in rotary:
        if letter != SPINDLE and letter not in of_workpiece:
            raise InputError(
                f"{job.source}: feature {ZERO}: axis {letter} moves the tool itself, whose tip tells nothing of where "
                f"the axis lies; leave out {ZERO}, or axis {letter}"
            )
    rotation, place = frame_of(machine, machine.tool)
    tip = place + rotation.apply(machine.body(machine.tool).location_error.shift)
    return Origin(tip, zero[0], zero[1], turn_covariance)


def frame_of(machine: MachineDescription, name: str) -> tuple[Rotation, Array]:
    """Frame of a body in the base, all axes at zero, location errors of its carriers included but not its own.

    Gives the rotation, which maps the body's coordinates to the base's, and the origin, m.
    """
    bodies = {body.name: body for body in machine.bodies}
    way: list[Body] = []
    while name in bodies:
        way.append(bodies[name])
        name = bodies[name].parent
    rotation, place = Rotation.identity(), np.zeros(3)
    for number, body in enumerate(way[::-1]):
        steps = [body.pose] if number == len(way) - 1 else [body.pose, body.location_error]
        for step in steps:
            rotation, place = _moved(rotation, place, step)
    return rotation, place


def _moved(rotation: Rotation, place: Array, step: Displacement) -> tuple[Rotation, Array]:
    return rotation * Rotation.from_rotvec(step.rotation), place + rotation.apply(step.shift)


def turned(line: LineFit, turn: Array, turn_covariance: Array | None = None) -> LineFit:
    """The line in a frame turned by (3, 3), whose own covariance (3, 3) rad² adds to that of the direction."""
    direction = turn @ line.direction
    covariance = turn @ line.direction_covariance @ turn.T
    if turn_covariance is not None:
        covariance = covariance + _cross(direction) @ turn_covariance @ _cross(direction).T
    return replace(
        line,
        point=turn @ line.point,
        direction=direction,
        point_covariance=turn @ line.point_covariance @ turn.T,
        direction_covariance=covariance,
        cross_covariance=turn @ line.cross_covariance @ turn.T,
    )


def turn_covariance_of(first: LineFit, second: LineFit) -> Array:
    """(3, 3) covariance of the rotation, rad², of a frame that follows the first line and holds the second."""
    e1 = first.direction
    e3 = np.cross(e1, second.direction)
    e3 = e3 / np.linalg.norm(e3)
    e2 = np.cross(e3, e1)
    by_first = np.outer(e3, e2) - np.outer(e2, e3)
    by_second = np.outer(e1, e3) / float(second.direction @ e2)
    covariance: Array = (
        by_first @ first.direction_covariance @ by_first.T + by_second @ second.direction_covariance @ by_second.T
    )
    return covariance


def _cross(vector: Array) -> Array:
    """(3, 3) matrix of which the product with w is the cross product of `vector` and w."""
    return np.asarray(np.cross(vector, np.eye(3)).T, dtype=np.float64)


def basis_of(machine: MachineDescription, linear: Sequence[str]) -> Array:
    """The frame of the base as columns: the first linear axis is followed exactly, the second lies in the plane."""
    first, second = (np.array(machine.axis(letter).direction) for letter in linear[:2])
    return basis(first, second)


def basis(first: Array, second: Array) -> Array:
    """Orthonormal columns: along `first`, towards `second`, and across both."""
    across = np.cross(first, second)
    across = across / np.linalg.norm(across)
    return np.stack([first, np.cross(across, first), across], axis=1)
