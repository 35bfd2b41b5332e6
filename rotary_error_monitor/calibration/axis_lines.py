"""Squareness of linear axes and location of rotary ones, from what a laser tracker saw along and round them.

The tracker stands anywhere. Its frame is turned into that of the machine by the first two linear axes: the first one
counts as it runs, the second one lies in the plane that both are in. Each rotary axis is then held against where the
machine file has it, location errors of what carries it included, all axes at zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from rotary_error_monitor.calibration.axis_doubts import implausible_lengths, left_handed, less_sure
from rotary_error_monitor.calibration.machine_file import SQUARENESS, location_name
from rotary_error_monitor.calibration.measurements import read_tracker
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine import Body, Displacement, MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.metrology.axis_fits import (
    LineFit,
    LocationErrors,
    estimate_location_errors,
    find_outlying_points,
    fit_axis_average_line,
    fit_line_in_space,
)
from rotary_error_monitor.metrology.axis_fits import estimate_squareness as squareness_between
from rotary_error_monitor.metrology.tracker import TrackerNoise, estimate_point_covariance, estimate_points

Array = NDArray[np.float64]
Points = tuple[Array, Array]

ZERO = "zero"
"""Feature of readings of the tool tip with all axes at zero: it ties the tracker to the machine's coordinates."""

FALSE_ALARM = 1e-3
"""Probability that clean readings are found to hold one that stands off."""

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
        scatter: (axis, how many times the stated noise its points scatter), where that is more than chance makes it.
        misfits: what does not fit, in words.
        written: whether the file was written.
    """

    squareness: tuple[tuple[str, str, float, float], ...]
    locations: Mapping[str, RotaryLocation]
    reference: str
    scatter: tuple[tuple[str, float], ...]
    misfits: tuple[str, ...]
    written: bool


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
    tracks, zero = _tracks(job.source, machine, noise, job.layout)
    fitted = _axis_lines(job.source, machine, tracks)
    lines = {letter: _as_scattered(line) for letter, line in fitted.items()}
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
    unsure = _turn_covariance(*(_turned(lines[letter], frame) for letter in linear[:2]))
    seen = {letter: _turned(lines[letter], frame, unsure) for letter in rotary}
    reference = ZERO if zero is not None else (rotary[0] if rotary else "")
    origin = None if zero is None else _origin(job, rotary, (frame @ zero[0], frame @ zero[1] @ frame.T), unsure)
    if origin is None and rotary:
        origin = _origin_by_axis(machine, rotary[0], seen[rotary[0]], unsure)
    locations = {} if origin is None else _locate(job, seen, origin, reference)
    worst = max([row[3] for row in found] + [float(each.rotation_uncertainty.max()) for each in locations.values()])
    mirrored = left_handed(machine, fitted)
    doubts = less_sure(job.file, worst, _angles_before(machine, found, locations))
    misfits = (*mirrored, *implausible_lengths(machine, tracks), *_stray_points(fitted), *doubts)
    if mirrored:  # angles of exchanged axes, or of the wrong sign
        worst = math.hypot(worst, 2 * max(abs(row[2]) for row in found))
    written = job.finish([SQUARENESS, *map(location_name, locations)], worst, {}, misfits)
    scatter = tuple((letter, line.ratio) for letter, line in fitted.items() if _scatters(line))
    return SquarenessResult(tuple(found), locations, reference, scatter, misfits, written)


def _angles_before(
    machine: MachineDescription,
    squareness: Sequence[tuple[str, str, float, float]],
    locations: Mapping[str, RotaryLocation],
) -> dict[str, tuple[float, float]]:
    """By name under `calibration` the largest angle in the file, and the uncertainty of the new ones, rad."""
    tilts = {body.axis: float(np.abs(body.location_error.rotation).max()) for body in machine.bodies}
    parts = {SQUARENESS: (max(tilts[letter] for letter, *_ in squareness), max(row[3] for row in squareness))}
    for letter, found in locations.items():
        parts[location_name(letter)] = tilts[letter], float(found.rotation_uncertainty.max())
    return parts


def _as_scattered(line: LineFit) -> LineFit:
    """The line with the uncertainty that its points' scatter shows, where that is more than the stated noise."""
    square = max(1.0, line.ratio) ** 2
    return replace(
        line,
        point_covariance=line.point_covariance * square,
        direction_covariance=line.direction_covariance * square,
    )


def _scatters(line: LineFit) -> bool:
    freedom = 2 * len(line.departures) - 4  # of points with two directions across a line
    return bool(chi2.sf(line.ratio**2 * freedom, freedom) < FALSE_ALARM)


def _stray_points(lines: Mapping[str, LineFit]) -> tuple[str, ...]:
    """Axes of which single readings stand off from the others, in words."""
    misfits = []
    for letter, line in lines.items():
        strays = find_outlying_points(line, FALSE_ALARM / len(lines))
        if len(strays):
            misfits.append(
                f"axis {letter}: {len(strays)} reading(s) stand off from the others, number {strays[0] + 1} by "
                f"{line.departures[strays[0]]:.1f} standard deviations of the stated noise; drop or repeat them"
            )
    return tuple(misfits)


def _tracks(
    source: Path, machine: MachineDescription, noise: TrackerNoise, layout: ColumnLayout | None
) -> tuple[dict[str, list[Points]], Points | None]:
    """Points with covariances by axis, and the tool tip at zero with its covariance if it was measured."""
    tracks: dict[str, list[Points]] = {}
    zero = None
    for feature, reading in read_tracker(source, layout).items():
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


@dataclass(frozen=True)
class _Origin:
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


def _locate(job: Job, lines: Mapping[str, LineFit], origin: _Origin, reference: str) -> dict[str, RotaryLocation]:
    """Location errors of rotary axes, one after the other: what carries an axis is set before it.

    `lines` are in the machine's directions; the place of the axis `reference` stays.
    """
    locations: dict[str, RotaryLocation] = {}
    for letter, line in lines.items():
        machine = job.file.changed
        old, direction = np.array(machine.body_of(letter).location_error.shift), machine.axis(letter).direction
        rotation, place = frame_of(machine, machine.body_of(letter).name)
        located = origin.located(line)
        local = _turned(replace(located, point=located.point - place), rotation.inv().as_matrix())
        try:
            errors = estimate_location_errors(local, np.zeros(3), np.array(direction))
        except InputError as error:
            raise InputError(f"{job.source}: feature {letter}: {error}") from error
        shift, spread = errors.shift, errors.shift_uncertainty
        if letter == reference:
            shift, spread = old, np.full(3, np.nan)
        elif reference in lines:
            towards = rotation.inv().apply(lines[reference].direction)
            shift, spread = _along_normal(towards, np.array(direction), old, errors)
        locations[letter] = RotaryLocation(errors.rotation, errors.rotation_uncertainty, shift, spread)
        job.file.set_location(letter, shift, errors.rotation)
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


def _origin_by_axis(machine: MachineDescription, letter: str, line: LineFit, turn_covariance: Array) -> _Origin:
    """The first rotary axis lies where the file has it."""
    rotation, place = frame_of(machine, machine.body_of(letter).name)
    shift = rotation.apply(machine.body_of(letter).location_error.shift)
    return _Origin(place + shift, line.point, line.point_covariance, turn_covariance)


def _origin(job: Job, rotary: list[str], zero: Points, turn_covariance: Array) -> _Origin:
    """The tool tip at zero lies where the file has it."""
    machine = job.file.changed
    of_workpiece = {body.axis for body in branches(machine)[1]}
    for letter in rotary:
        if letter not in of_workpiece:
            raise InputError(
                f"{job.source}: feature {ZERO}: axis {letter} moves the tool itself, whose tip tells nothing of where "
                f"the axis lies; leave out {ZERO}, or axis {letter}"
            )
    rotation, place = frame_of(machine, machine.tool)
    tip = place + rotation.apply(machine.body(machine.tool).location_error.shift)
    return _Origin(tip, zero[0], zero[1], turn_covariance)


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


def _turned(line: LineFit, turn: Array, turn_covariance: Array | None = None) -> LineFit:
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
    )


def _turn_covariance(first: LineFit, second: LineFit) -> Array:
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


def _basis_of(machine: MachineDescription, linear: list[str]) -> Array:
    """The frame of the base as columns: the first linear axis is followed exactly, the second lies in the plane."""
    first, second = (np.array(machine.axis(letter).direction) for letter in linear[:2])
    return _basis(first, second)


def _basis(first: Array, second: Array) -> Array:
    """Orthonormal columns: along `first`, towards `second`, and across both."""
    across = np.cross(first, second)
    across = across / np.linalg.norm(across)
    return np.stack([first, np.cross(across, first), across], axis=1)
