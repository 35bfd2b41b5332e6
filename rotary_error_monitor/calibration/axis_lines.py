"""Squareness of linear axes, location of rotary ones and the spindle, from what a laser tracker saw of them.

The tracker stands anywhere. Its frame is turned into that of the machine by the first two linear axes: the first one
counts as it runs, the second one lies in the plane that both are in. Each rotary axis is then held against where the
machine file has it, location errors of what carries it included, all axes at zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.axis_doubts import implausible_lengths, left_handed, less_sure
from rotary_error_monitor.calibration.axis_location import (
    ZERO,
    Points,
    RotaryLocation,
    SeenAxes,
    body_of,
    check_tip,
    find_origin,
    locate,
    machine_frame,
    turned,
)
from rotary_error_monitor.calibration.axis_table import AxisRelation, relate_axes
from rotary_error_monitor.calibration.known_slopes import KnownSlope, known_slopes
from rotary_error_monitor.calibration.machine_file import SQUARENESS, location_name
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.calibration.tracker_features import Feature, check_circle, check_line, read_tracker
from rotary_error_monitor.description.machine import SHIFT_UNCERTAINTY, MachineDescription
from rotary_error_monitor.description.quantities import LARGEST_TILT
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.machine.location_names import SPINDLE
from rotary_error_monitor.metrology.axis_fits import (
    LineFit,
    find_outlying_points,
    fit_axis_average_line,
    fit_line_in_space,
)
from rotary_error_monitor.metrology.axis_fits import estimate_squareness as squareness_between
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.tracker import TrackerNoise, estimate_point_covariance

FALSE_ALARM = 1e-3
"""Probability that clean readings are found to hold one that stands off."""


@dataclass(frozen=True)
class SquarenessResult:
    """What a squareness step found.

    Attributes:
        squareness: (axis, other, angle, uncertainty), rad.
        locations: of rotary axes by letter, and of the spindle.
        relations: how the axes lie beside each other, by themselves and not against the file.
        reference: what shifts count from: the letter of the first rotary axis, or `zero`; empty without rotary axes.
        scatter: (axis, how many times the stated noise its points scatter), where that is more than chance makes it.
        misfits: what does not fit, in words.
        written: whether the file was written.
        known: what the file's errors make of the lines of linear axes, which squareness is without, by letter.
    """

    squareness: tuple[tuple[str, str, float, float], ...]
    locations: Mapping[str, RotaryLocation]
    relations: tuple[AxisRelation, ...]
    reference: str
    scatter: tuple[tuple[str, float], ...]
    misfits: tuple[str, ...]
    written: bool
    known: Mapping[str, KnownSlope] = field(default_factory=dict)


def calibrate_squareness(
    job: Job, noise: TrackerNoise, reflector: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> SquarenessResult:
    """Tracker readings along axes into squareness errors, and of rotary axes and spindle into their location errors.

    Features are named by axis: X, Y, Z for points along a linear axis; C.1, C.2, … for targets that a rotary axis
    carries round while all others stand at zero, and spindle.1, … for those that the spindle does. Axes are taken in
    the order of the bodies: the first linear one is the reference, each other is squared against those before it. A
    rotary axis has a tilt; the distance from the first rotary axis goes to the later ones. Where readings of the tool
    tip at zero are there as well (feature `zero`), axes that carry the workpiece are located in the machine's
    coordinates. Of the lines of linear axes that is taken off which the file's error components make of them for a
    `reflector` there, m, in the frame of the tool (of the workpiece, where the axis carries that).

    Raises:
        InputError: the table is wrong, a feature is no axis of the machine, fewer than two linear axes were measured,
            or a rotary axis lies far from where the file has it.
    """
    machine = job.file.machine
    features = read_tracker(job.source, job.layout)
    tracks, zero = _tracks(features, machine, noise)
    as_seen = _axis_lines(job.source, machine, tracks)
    lines = {letter: _as_scattered(line) for letter, line in as_seen.items()}
    linear, rotary = _in_order(machine, lines)
    if len(linear) < 2:
        raise InputError(f"{job.source}: features of {len(linear)} linear axes; squareness needs two, such as X and Y")
    measured = SeenAxes(lines, linear, rotary, zero)
    check_tip(job.source, machine, measured)
    points = {letter: tracks[letter][0][0] for letter in linear}
    known = known_slopes(machine, {letter: lines[letter] for letter in linear}, points, np.array(reflector))
    frame = machine_frame(machine, measured)
    fitted = _unexplained(job.source, as_seen, tracks, known, frame)
    seen = replace(measured, lines={letter: _as_scattered(line) for letter, line in fitted.items()})
    found = _square(job, linear, seen.lines)
    _check_circles(features, rotary)  # after the lines, which tell angles in another unit better
    as_they_lie = {name: turned(line, frame) for name, line in lines.items()}
    relations = relate_axes(machine, as_they_lie, find_origin(machine, measured))
    locations = locate(job, seen)
    mirrored = left_handed(machine, fitted)
    parts = _angles_before(machine, found, locations)
    doubts = less_sure(job.file, parts)
    along = {name: points for name, points in tracks.items() if name != SPINDLE}
    misfits = (*mirrored, *implausible_lengths(machine, along), *_stray_points(fitted), *doubts)
    # angles of exchanged axes, or of the wrong sign
    wrong = 2 * max(abs(row[2]) for row in found) if mirrored else 0.0
    figures = {location_name(name): _shift_figures(each) for name, each in locations.items()}
    written = job.finish_parts(
        {name: (math.hypot(own, wrong), figures.get(name, {})) for name, (_, own) in parts.items()}, misfits
    )
    scatter = tuple((letter, line.ratio) for letter, line in fitted.items() if _scatters(line))
    return SquarenessResult(tuple(found), locations, relations, seen.reference, scatter, misfits, written, known)


def _unexplained(
    source: Path,
    lines: Mapping[str, LineFit],
    tracks: Mapping[str, list[Points]],
    known: Mapping[str, KnownSlope],
    frame: Array,
) -> dict[str, LineFit]:
    """Lines through points without what the file's errors make of them; `frame` turns directions into the machine's."""
    result = dict(lines)
    for letter, each in known.items():
        points, covariances = tracks[letter][0]
        with told_of(f"{source}: feature {letter}"):
            line = fit_line_in_space(points - each.departures @ frame, covariances)
        across = each.doubt**2 * (np.eye(3) - np.outer(line.direction, line.direction))
        result[letter] = replace(line, direction_covariance=line.direction_covariance + across)
    return result


def _square(job: Job, linear: Sequence[str], lines: Mapping[str, LineFit]) -> list[tuple[str, str, float, float]]:
    """Squareness of each linear axis to the two first before it: axis, other, angle and uncertainty, rad.

    Raises:
        InputError: an angle is larger than a machine file may have.
    """
    found = []
    for k, letter in enumerate(linear):
        for other in linear[: min(k, 2)]:
            square = squareness_between(lines[letter], lines[other])
            if abs(square.angle) > LARGEST_TILT:
                raise InputError(
                    f"{job.source}: features {letter} and {other} stand {math.degrees(square.angle):+.2f}° from "
                    f"square; expected {math.degrees(LARGEST_TILT):.2f}° at most: are angles and distances in the "
                    "units of the header, and do the points belong to these axes?"
                )
            found.append((letter, other, square.angle, square.uncertainty))
            job.file.set_squareness(letter, other, square.angle)
    return found


def _in_order(machine: MachineDescription, lines: Mapping[str, LineFit]) -> tuple[list[str], list[str]]:
    """Linear axes of which there are lines, and rotary ones with the spindle, both in the order of the bodies."""
    linear, rotary = list[str](), list[str]()
    for body in machine.bodies:
        if body.axis is not None and body.axis in lines:
            (linear if machine.axis(body.axis).kind == "linear" else rotary).append(body.axis)
        if body.name == machine.spindle and SPINDLE in lines:
            rotary.append(SPINDLE)
    return linear, rotary


def _shift_figures(location: RotaryLocation) -> dict[str, float]:
    """What is noted of a place that was seen: the standard uncertainty of its shift, m."""
    seen = location.shift_uncertainty[~np.isnan(location.shift_uncertainty)]
    return {SHIFT_UNCERTAINTY: float(seen.max())} if len(seen) else {}


def _angles_before(
    machine: MachineDescription,
    squareness: Sequence[tuple[str, str, float, float]],
    locations: Mapping[str, RotaryLocation],
) -> dict[str, tuple[float, float]]:
    """By name under `calibration` the largest angle in the file, and the uncertainty of the new ones, rad."""
    names = {letter for letter, *_ in squareness} | set(locations)
    tilts = {name: float(np.abs(body_of(machine, name).location_error.rotation).max()) for name in names}
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
        cross_covariance=line.cross_covariance * square,
    )


def _scatters(line: LineFit) -> bool:
    freedom = 2 * len(line.departures) - 4  # of points with two directions across a line
    return bool(chi_square_tail(line.ratio**2 * freedom, freedom) < FALSE_ALARM)


def _stray_points(lines: Mapping[str, LineFit]) -> tuple[str, ...]:
    """Axes of which single readings stand off from the others, in words."""
    misfits = []
    for letter, line in lines.items():
        name = letter if letter == SPINDLE else f"axis {letter}"
        strays = find_outlying_points(line, FALSE_ALARM / len(lines))
        if len(strays):
            misfits.append(
                f"{name}: {len(strays)} reading(s) stand off from the others, number {strays[0] + 1} by "
                f"{line.departures[strays[0]]:.1f} standard deviations of the stated noise; drop or repeat them"
            )
    return tuple(misfits)


def _tracks(
    features: Mapping[str, Feature], machine: MachineDescription, noise: TrackerNoise
) -> tuple[dict[str, list[Points]], Points | None]:
    """Points with covariances by axis, and the tool tip at zero with its covariance if it was measured.

    Raises:
        InputError: a feature is none of the machine, or of a linear axis and not one line.
    """
    tracks: dict[str, list[Points]] = {}
    zero = None
    for name, feature in features.items():
        reading = feature.distance, feature.elevation, feature.azimuth
        points = feature.points, estimate_point_covariance(*reading, noise)
        if name == ZERO:
            zero = points[0].mean(axis=0), points[1].mean(axis=0) / len(points[0])
            continue
        letter = name.partition(".")[0]
        try:
            body_of(machine, letter)
        except InputError as error:
            raise feature.error(0, f"feature {name}: {error}") from error
        if letter != SPINDLE and machine.axis(letter).kind == "linear":
            if letter in tracks:
                raise feature.error(0, f"feature {name}: a linear axis is one feature; call all of its points {letter}")
            check_line(name, feature)
        tracks.setdefault(letter, []).append(points)
    return tracks, zero


def _check_circles(features: Mapping[str, Feature], rotary: Sequence[str]) -> None:
    """Hold that each target of a rotary axis or the spindle went round one circle.

    Raises:
        InputError: one did not.
    """
    for name, feature in features.items():
        if name.partition(".")[0] in rotary:
            check_circle(name, feature)


def _axis_lines(source: Path, machine: MachineDescription, tracks: Mapping[str, list[Points]]) -> dict[str, LineFit]:
    """Line of each measured axis, in the tracker's frame, running as the axis does."""
    lines = {}
    for letter, found in tracks.items():
        with told_of(f"{source}: feature {letter}"):
            if letter != SPINDLE and machine.axis(letter).kind == "linear":
                lines[letter] = fit_line_in_space(*found[0])
            else:
                lines[letter] = fit_axis_average_line([p for p, _ in found], [c for _, c in found])
    return lines
