"""Squareness of linear axes and location of rotary ones, from what a laser tracker saw along and round them.

The tracker stands anywhere. Its frame is turned into that of the machine by the first two linear axes: the first one
counts as it runs, the second one lies in the plane that both are in. Each rotary axis is then held against where the
machine file has it, location errors of what carries it included, all axes at zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.calibration.measurements import read_tracker
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.machine import Body, Displacement, MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.metrology.axis_fits import (
    LineFit,
    LocationErrors,
    estimate_location_errors,
    fit_axis_average_line,
    fit_line_in_space,
)
from rotary_error_monitor.metrology.axis_fits import estimate_squareness as squareness_between
from rotary_error_monitor.metrology.tracker import TrackerNoise, estimate_point_covariance, estimate_points

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
class SquarenessResult:
    """What a squareness step found.

    Attributes:
        squareness: (axis, other, angle, uncertainty), rad.
        locations: of rotary axes by letter.
        reference: what shifts count from: the letter of the first rotary axis, or `zero`; empty without rotary axes.
    """

    squareness: tuple[tuple[str, str, float, float], ...]
    locations: Mapping[str, RotaryLocation]
    reference: str


def calibrate_squareness(job: Job, noise: TrackerNoise) -> SquarenessResult:
    """Tracker readings along axes into squareness errors, and of rotary axes into their location errors.

    Features are named by axis: X, Y, Z for points along a linear axis; C.1, C.2, … for targets that a rotary axis
    carries round while all others stand at zero. Axes are taken in the order of the bodies: the first linear one is the
    reference, each other is squared against those before it. A rotary axis has a tilt; the distance from the first
    rotary axis goes to the later ones. Where readings of the tool tip at zero are there as well (feature `zero`), axes
    that carry the workpiece are located in the machine's coordinates.

    Raises:
        InputError: the table is wrong, a feature is no axis of the machine, fewer than two linear axes were measured,
            or a rotary axis lies far from where the file has it.
    """
    machine = job.file.machine
    tracks, zero = _tracks(job.source, machine, noise)
    lines = _axis_lines(job.source, machine, tracks)
    ordered = [body.axis for body in machine.bodies if body.axis in lines]
    linear = [letter for letter in ordered if letter is not None and machine.axis(letter).kind == "linear"]
    rotary = [letter for letter in ordered if letter is not None and letter not in linear]
    if len(linear) < 2:
        raise InputError(f"{job.source}: features of {len(linear)} linear axes; squareness needs two, such as X and Y")
    found = []
    for k, letter in enumerate(linear):
        for other in linear[: min(k, 2)]:
            square = squareness_between(lines[letter], lines[other])
            found.append((letter, other, square.angle, square.uncertainty))
            job.file.set_squareness(letter, other, square.angle)
    frame = _basis_of(machine, linear) @ _basis(lines[linear[0]].direction, lines[linear[1]].direction).T
    seen = {letter: _turned(lines[letter], frame) for letter in rotary}
    reference = ZERO if zero is not None else (rotary[0] if rotary else "")
    origin = None if zero is None else _origin(job, rotary, (frame @ zero[0], frame @ zero[1] @ frame.T))
    locations = _locate(job, seen, origin)
    worst = max([row[3] for row in found] + [float(each.rotation_uncertainty.max()) for each in locations.values()])
    job.finish(["squareness", *(f"location of {letter}" for letter in locations)], worst, {})
    return SquarenessResult(tuple(found), locations, reference)


def _tracks(
    source: Path, machine: MachineDescription, noise: TrackerNoise
) -> tuple[dict[str, list[Points]], Points | None]:
    """Points with covariances by axis, and the tool tip at zero with its covariance if it was measured."""
    tracks: dict[str, list[Points]] = {}
    zero = None
    for feature, reading in read_tracker(source).items():
        points = estimate_points(*reading), estimate_point_covariance(*reading, noise)
        if feature == ZERO:
            zero = points[0].mean(axis=0), points[1].mean(axis=0) / len(points[0])
        else:
            tracks.setdefault(machine.axis(feature.partition(".")[0]).letter, []).append(points)
    return tracks, zero


def _axis_lines(source: Path, machine: MachineDescription, tracks: Mapping[str, list[Points]]) -> dict[str, LineFit]:
    """Line of each measured axis, in the tracker's frame, running as the axis does."""
    lines = {}
    for letter, found in tracks.items():
        try:
            if machine.axis(letter).kind == "linear":
                lines[letter] = fit_line_in_space(*found[0])
            else:
                lines[letter] = fit_axis_average_line([p for p, _ in found], [c for _, c in found])
        except InputError as error:
            raise InputError(f"{source}: feature {letter}: {error}") from error
    return lines


def _locate(job: Job, lines: Mapping[str, LineFit], origin: tuple[Array, Array] | None) -> dict[str, RotaryLocation]:
    """Location errors of rotary axes, one after the other: what carries an axis is set before it.

    `lines` are in the machine's directions. `origin` is where the tracker stands in the machine's coordinates, with its
    covariance; without it the first axis lies where the file has it.
    """
    locations: dict[str, RotaryLocation] = {}
    first = ""
    for letter, line in lines.items():
        machine = job.file.changed
        old = np.array(machine.body_of(letter).location_error.shift)
        rotation, place = frame_of(machine, machine.body_of(letter).name)
        if origin is None:
            origin, first = (place + rotation.apply(old) - line.point, line.point_covariance), letter
        errors = _errors(job, letter, line, origin, (rotation, place))
        shift, spread = errors.shift, errors.shift_uncertainty
        if letter == first:
            shift, spread = old, np.full(3, np.nan)
        elif first:
            towards = rotation.inv().apply(lines[first].direction)
            shift, spread = _along_normal(towards, np.array(machine.axis(letter).direction), old, errors)
        locations[letter] = RotaryLocation(errors.rotation, errors.rotation_uncertainty, shift, spread)
        job.file.set_location(letter, shift, errors.rotation)
    return locations


def _errors(
    job: Job, letter: str, line: LineFit, origin: tuple[Array, Array], frame: tuple[Rotation, Array]
) -> LocationErrors:
    """Location errors of the axis in the frame of its body."""
    back = frame[0].inv().as_matrix()
    local = replace(
        _turned(line, back),
        point=back @ (line.point + origin[0] - frame[1]),
        point_covariance=back @ (line.point_covariance + origin[1]) @ back.T,
    )
    try:
        return estimate_location_errors(local, np.zeros(3), np.array(job.file.machine.axis(letter).direction))
    except InputError as error:
        raise InputError(f"{job.source}: feature {letter}: {error}") from error


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


def _origin(job: Job, rotary: list[str], zero: Points) -> tuple[Array, Array]:
    """Where the tracker stands in the machine's coordinates, by the tool tip at zero, and its covariance."""
    machine = job.file.changed
    of_workpiece = {body.axis for body in branches(machine)[1]}
    for letter in rotary:
        if letter not in of_workpiece:
            raise InputError(
                f"{job.source}: feature {ZERO}: axis {letter} moves the tool itself, whose tip tells nothing of where "
                f"the axis lies; leave out {ZERO}, or axis {letter}"
            )
    _, place = frame_of(machine, machine.tool)
    tip = place + np.array(machine.body(machine.tool).location_error.shift)
    return tip - zero[0], zero[1]


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


def _turned(line: LineFit, turn: Array) -> LineFit:
    """The line in a frame turned by (3, 3)."""
    return LineFit(
        turn @ line.point,
        turn @ line.direction,
        turn @ line.point_covariance @ turn.T,
        turn @ line.direction_covariance @ turn.T,
        line.scatter,
    )


def _basis_of(machine: MachineDescription, linear: list[str]) -> Array:
    """The frame of the base as columns: the first linear axis is followed exactly, the second lies in the plane."""
    first, second = (np.array(machine.axis(letter).direction) for letter in linear[:2])
    return _basis(first, second)


def _basis(first: Array, second: Array) -> Array:
    """Orthonormal columns: along `first`, towards `second`, and across both."""
    across = np.cross(first, second)
    across = across / np.linalg.norm(across)
    return np.stack([first, np.cross(across, first), across], axis=1)
