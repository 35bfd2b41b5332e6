"""Where rotary axes and the spindle lie, from their lines as a tracker saw them, and a point that ties both frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Body, Displacement, Vector
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.machine.location_names import SPINDLE
from rotary_error_monitor.machine.topology import branches, way
from rotary_error_monitor.metrology.axis_fits import LineFit, estimate_location_errors, estimate_squareness

Points = tuple[Array, Array]

ZERO = "zero"
"""Feature of readings of the tool tip with all axes at zero: it ties the tracker to the machine's coordinates."""

LEAST_ANGLE = 0.1
"""Rotary axes at a smaller angle, rad, count as parallel: they have a distance in two directions, not one."""

ALONG = 0.99
"""Part of a direction from which it is that of the axis itself: along it nothing was measured of its place."""


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
    """

    place: Array
    seen: Array


@dataclass(frozen=True)
class SeenAxes:
    """What the tracker saw, in its own frame.

    Attributes:
        lines: by letter of the axis, and of the spindle.
        linear, rotary: their names in the order of the bodies; the spindle counts as rotary.
        zero: (3,) the tool tip with all axes at zero, m, and its covariance (3, 3); None where it was not measured.
    """

    lines: Mapping[str, LineFit]
    linear: Sequence[str]
    rotary: Sequence[str]
    zero: Points | None

    @property
    def reference(self) -> str:
        """What places count from: `zero`, or the first rotary axis; empty without either."""
        return ZERO if self.zero is not None else next(iter(self.rotary), "")

    def shifted(self) -> Iterator[SeenAxes]:
        """The same with each uncertain number off by its standard uncertainty, one by one and uncorrelated."""
        for name, line in self.lines.items():
            cross = line.cross_covariance
            whole = np.block([[line.point_covariance, cross], [cross.T, line.direction_covariance]])
            for step in _deviations(whole):
                moved = replace(line, point=line.point + step[:3], direction=line.direction + step[3:])
                yield replace(self, lines={**self.lines, name: moved})
        if self.zero is not None:
            for step in _deviations(self.zero[1]):
                yield replace(self, zero=(self.zero[0] + step, self.zero[1]))


def _deviations(covariance: Array) -> Array:
    """(k, n) steps of one standard deviation, whose outer products add up to a covariance (n, n)."""
    variances, axes = np.linalg.eigh(covariance)
    is_some = variances > 1e-12 * variances.max(initial=0.0)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))).T[is_some])


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


def machine_frame(machine: MachineDescription, seen: SeenAxes) -> Array:
    """(3, 3) that turns directions of the tracker into those of the machine: by its first two linear axes."""
    first, second = (seen.lines[letter].direction for letter in seen.linear[:2])
    return basis_of(machine, seen.linear) @ basis(first, second).T


def find_origin(machine: MachineDescription, seen: SeenAxes) -> Origin | None:
    """What ties the tracker's places to the machine's; None without a rotary axis or spindle.

    With the tool tip at zero it is that. Otherwise the first rotary axis lies where the file has it, and along it so
    does the foot of an axis that crosses it. Without an axis that crosses, the first target of one that runs alike
    counts as at the origin of its body: a target at the spindle's nose, say. With one axis alone its own does.
    """
    if not seen.rotary:
        return None
    frame = machine_frame(machine, seen)
    if seen.zero is not None:
        rotation, place = frame_of(machine, machine.tool)
        tip = place + rotation.apply(machine.body(machine.tool).location_error.shift)
        return Origin(tip, frame @ seen.zero[0])
    names = list(seen.rotary)
    lines = {name: turned(seen.lines[name], frame) for name in names}
    first, nominal = lines[names[0]], {name: _nominal_line(machine, name) for name in names}
    crossing = [name for name in names[1:] if _is_crossing(first, lines[name])]
    along = 0.0
    if crossing:
        along = _foot(first, lines[crossing[0]]) - _foot(nominal[names[0]], nominal[crossing[0]])
    elif len(names) > 1:
        alike = names[-1]
        along = float((lines[alike].point - first.point) @ first.direction)
        along -= float((nominal[alike].point - nominal[names[0]].point) @ nominal[names[0]].direction)
    return Origin(nominal[names[0]].point, first.point + along * first.direction)


def check_tip(source: Path, machine: MachineDescription, seen: SeenAxes) -> None:
    """Hold that a tool tip at zero tells where the rotary axes lie.

    Raises:
        InputError: one of them moves the tool itself.
    """
    of_workpiece = {body.axis for body in branches(machine)[1]}
    for letter in seen.rotary if seen.zero is not None else ():
        if letter != SPINDLE and letter not in of_workpiece:
            raise InputError(
                f"{source}: feature {ZERO}: axis {letter} moves the tool itself, whose tip tells nothing of where "
                f"the axis lies; leave out {ZERO}, or axis {letter}"
            )


def locate(job: Job, seen: SeenAxes) -> dict[str, RotaryLocation]:
    """Location errors of rotary axes and the spindle, one after the other: what carries an axis is set before it.

    Squareness is in the file already. The place of the reference stays, and so does that of a spindle which the
    reference does not carry. Uncertainty is that of all lines together: what carries an axis is not known exactly.

    Raises:
        InputError: an axis lies far from where the file has it.
    """
    machine = job.file.changed
    found, known = _placed(job.source, machine, seen)
    squares = {name: (np.zeros(3), np.zeros(3)) for name in found}
    for changed in seen.shifted() if found else ():
        moved, _ = _placed(job.source, _squared(machine, seen, changed), changed)
        for name, (shift, turn) in squares.items():
            shift += (np.array(moved[name].shift) - found[name].shift) ** 2
            turn += (np.array(moved[name].rotation) - found[name].rotation) ** 2
    locations = {}
    for name, error in found.items():
        shift, turn = (np.sqrt(square) for square in squares[name])
        rotation = np.array(error.rotation)
        spread = np.where(known[name], shift, np.nan)
        locations[name] = RotaryLocation(rotation, turn, np.array(error.shift), spread)
        job.file.set_location(name, np.array(error.shift), rotation)
    return locations


def _squared(machine: MachineDescription, before: SeenAxes, after: SeenAxes) -> MachineDescription:
    """The machine with the squareness of its linear axes changed as their lines have."""
    for k, letter in enumerate(before.linear):
        for other in before.linear[: min(k, 2)]:
            angles = [estimate_squareness(seen.lines[letter], seen.lines[other]).angle for seen in (before, after)]
            normal = np.cross(machine.axis(letter).direction, machine.axis(other).direction)
            x, y, z = -(angles[1] - angles[0]) * normal
            turn = Displacement(rotation=(float(x), float(y), float(z)))
            machine = machine.with_location_error(machine.body_of(letter).name, turn)
    return machine


def _placed(
    source: Path, machine: MachineDescription, seen: SeenAxes
) -> tuple[dict[str, Displacement], dict[str, NDArray[np.bool_]]]:
    """Location errors by name, and which components of their shifts were seen, each axis upon those before it."""
    found, known = dict[str, Displacement](), dict[str, NDArray[np.bool_]]()
    origin = find_origin(machine, seen)
    if origin is None:
        return found, known
    frame, reference = machine_frame(machine, seen), seen.reference
    lines = {name: turned(seen.lines[name], frame) for name in seen.rotary}
    for name, line in lines.items():
        body, direction = body_of(machine, name), np.array(direction_of(machine, name))
        old = np.array(body.location_error.shift)
        rotation, place = frame_of(machine, body.name)
        local = replace(line, point=origin.place + line.point - origin.seen - place)
        with told_of(f"{source}: feature {name}"):
            errors = estimate_location_errors(turned(local, rotation.inv().as_matrix()), np.zeros(3), direction)
        # along the axis nothing is seen of its place: that stays
        shift, is_seen = errors.shift + (old @ direction) * direction, np.abs(direction) < ALONG
        if name == reference or (name == SPINDLE and (reference == ZERO or not carries(machine, reference, name))):
            shift, is_seen = old, np.zeros(3, dtype=np.bool_)
        elif reference in lines:
            shift, is_seen = _along_normal(rotation.inv().apply(lines[reference].direction), direction, old, shift)
        known[name] = is_seen
        found[name] = Displacement(_vector(shift), _vector(errors.rotation))
        changed = replace(body, location_error=found[name])
        machine = replace(machine, bodies=tuple(changed if each is body else each for each in machine.bodies))
    return found, known


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _along_normal(first: Array, direction: Array, old: Array, shift: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Shift where only the distance from an axis along `first` was measured, and which components show it."""
    normal = np.cross(first, direction)
    size = float(np.linalg.norm(normal))
    if size < LEAST_ANGLE:
        return shift, np.abs(direction) < ALONG
    normal = normal / size
    return old + (shift - old) @ normal * normal, np.abs(normal) > LEAST_ANGLE


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


def frame_of(machine: MachineDescription, name: str) -> tuple[Rotation, Array]:
    """Frame of a body in the base, all axes at zero, location errors of its carriers included but not its own.

    Gives the rotation, which maps the body's coordinates to the base's, and the origin, m.
    """
    carriers = way(machine, name)
    rotation, place = Rotation.identity(), np.zeros(3)
    for body in carriers:
        steps = [body.pose] if body is carriers[-1] else [body.pose, body.location_error]
        for step in steps:
            rotation, place = _moved(rotation, place, step)
    return rotation, place


def _moved(rotation: Rotation, place: Array, step: Displacement) -> tuple[Rotation, Array]:
    return rotation * Rotation.from_rotvec(step.rotation), place + rotation.apply(step.shift)


def turned(line: LineFit, turn: Array) -> LineFit:
    """The line in a frame turned by (3, 3)."""
    return replace(
        line,
        point=turn @ line.point,
        direction=turn @ line.direction,
        point_covariance=turn @ line.point_covariance @ turn.T,
        direction_covariance=turn @ line.direction_covariance @ turn.T,
        cross_covariance=turn @ line.cross_covariance @ turn.T,
    )


def basis_of(machine: MachineDescription, linear: Sequence[str]) -> Array:
    """The frame of the base as columns: the first linear axis is followed exactly, the second lies in the plane."""
    first, second = (np.array(machine.axis(letter).direction) for letter in linear[:2])
    return basis(first, second)


def basis(first: Array, second: Array) -> Array:
    """Orthonormal columns: along `first`, towards `second`, and across both."""
    across = np.cross(first, second)
    across = across / np.linalg.norm(across)
    return np.stack([first, np.cross(across, first), across], axis=1)
