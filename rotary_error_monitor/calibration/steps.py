"""The steps of a calibration: measurements in, a changed machine file and a report in words out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.calibration.identification import Identification, check_held_out, identify_machine
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.measurements import (
    Placement,
    read_positioning,
    read_positioning_poses,
    read_probed_poses,
    read_straightness,
)
from rotary_error_monitor.calibration.parameters import Orders, list_parameters
from rotary_error_monitor.calibration.verdict import Verdict, judge_calibration
from rotary_error_monitor.calibration.volume import Limits
from rotary_error_monitor.calibration.yaml_document import Provenance, hash_source
from rotary_error_monitor.description.machine import DIRECTIONS, Axis, MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.guideway_compensation import RotatedCurve, rotate_monotone
from rotary_error_monitor.metrology.positioning import (
    Outlier,
    PositioningFigures,
    PositioningRuns,
    check_standard_test,
    estimate_positioning,
    find_outliers,
    remove_outliers,
)
from rotary_error_monitor.metrology.splicing import Mirror, Segment, SplicedProfile, splice_segments
from rotary_error_monitor.metrology.straightness import combine_runs

Array = NDArray[np.float64]

MOST_TABLE_ROWS = 101
TURN = 2 * math.pi

LARGEST_GAP = 1.2
"""Targets of a rotary axis further apart, rad, do not go all round."""

NEAREST = 1e-4
"""Least distance of a repeated position from others, rad."""

LEAST_COVERED = 0.9
"""Share of the travel that targets should cover."""


@dataclass(frozen=True)
class Job:
    """What every step needs.

    Attributes:
        source: file or bag of measurements.
        file: the machine file to change.
        output: where to write it.
        day: day of the calibration.
    """

    source: Path
    file: MachineFile
    output: Path
    day: date

    def finish(self, names: list[str], uncertainty: float | None, figures: Mapping[str, float]) -> None:
        """Note where the sections are from, and save."""
        provenance = Provenance(self.day, self.source.name, hash_source(self.source), uncertainty, figures)
        self.file.note(names, provenance)
        self.file.save(self.output)


@dataclass(frozen=True)
class PositioningResult:
    """What a positioning step found.

    Attributes:
        name: the error component.
        runs: all readings.
        figures: of the readings, without `outliers` where these were `dropped`.
        outliers: readings that stand off from the others.
        remarks: departures from the standard test, in words.
        uncertainty: largest standard uncertainty of a mean, m or rad.
    """

    name: str
    runs: PositioningRuns
    figures: PositioningFigures
    outliers: tuple[Outlier, ...]
    dropped: bool
    remarks: tuple[str, ...]
    uncertainty: float


def calibrate_positioning(job: Job, letter: str, *, drop_outliers: bool = False) -> PositioningResult:
    """ISO 230-2 test of one axis into the table of its positioning error.

    Outliers are told and count, unless they are to be dropped.

    Raises:
        InputError: the machine has no such axis, the table is wrong, or its targets leave the travel.
    """
    axis = job.file.machine.axis(letter)
    if job.source.suffix == ".csv":
        runs = read_positioning(job.source, rotary=axis.kind == "rotary")
    else:
        runs = read_positioning_poses(job.source, job.file.machine, letter)
    _check_travel(axis, runs.targets, job.source)
    outliers = find_outliers(runs)
    figures = estimate_positioning(remove_outliers(runs, outliers) if drop_outliers else runs)
    name, sign = _own_component(axis)
    forward = sign * figures.forward.mean
    backward = None if figures.backward is None else sign * figures.backward.mean
    positions = _over_travel(axis, runs.targets)
    job.file.set_table(
        name,
        positions,
        _repeated(positions, runs.targets, forward),
        None if backward is None else _repeated(positions, runs.targets, backward),
    )
    ways = [figures.forward] if figures.backward is None else [figures.forward, figures.backward]
    uncertainty = max(float((way.spread / np.sqrt(way.count)).max()) for way in ways)
    noted = {"repeatability": figures.forward.repeatability, "accuracy": figures.forward.accuracy}
    if figures.bidirectional is not None:
        both = figures.bidirectional
        noted = {
            "reversal_error": both.reversal_error,
            "mean_reversal_error": both.mean_reversal_error,
            "repeatability": both.repeatability,
            "systematic_deviation": both.systematic_deviation,
            "accuracy": both.accuracy,
        }
    job.finish([name], uncertainty, noted)
    remarks = check_standard_test(runs)
    share = float(np.ptp(positions)) / (axis.travel[1] - axis.travel[0])
    if share < LEAST_COVERED:
        remarks += (f"the targets cover {share:.0%} of the travel; beyond them the error of the last one holds",)
    if runs.rotary and job.source.suffix != ".csv":
        remarks += ("told from a tool tip: radial error motions and a displaced axis count into the angle",)
    return PositioningResult(name, runs, figures, outliers, drop_outliers, remarks, uncertainty)


def _over_travel(axis: Axis, targets: Array) -> Array:
    """Positions for the table of an axis: the targets, and those of further turns where it was measured all round."""
    low, high = axis.travel
    inside = np.sort(targets % TURN)
    if axis.kind == "linear" or np.diff(inside, append=inside[0] + TURN).max() > LARGEST_GAP:
        return targets
    turns = math.ceil((high - low) / TURN)
    copies = np.append((targets[:, None] + TURN * np.arange(-turns, turns + 1)).ravel(), axis.travel)
    beyond = (copies < targets[0] - NEAREST) | (copies > targets[-1] + NEAREST)
    kept = copies[beyond & (copies >= low) & (copies <= high)]
    return np.sort(np.concatenate([targets, np.unique(np.round(kept / NEAREST)) * NEAREST]))


def _repeated(positions: Array, targets: Array, errors: Array) -> Array:
    """Errors at positions: as measured within the targets, and beyond them the same in every turn."""
    measured = np.interp(positions, targets, errors)
    inside = (positions >= targets[0]) & (positions <= targets[-1])
    return np.where(inside, measured, np.interp(positions, targets, errors, period=TURN))


@dataclass(frozen=True)
class StraightnessResult:
    """What a straightness step found; `rotated` is None where no monotone curve was asked for."""

    name: str
    spliced: SplicedProfile
    error: float
    uncertainty: float
    repeatability: float | None
    reversal: float | None
    rotated: RotatedCurve | None


def calibrate_straightness(
    job: Job, name: str, mirror: Mirror, noise: float, *, monotone: bool = False, spacing: float | None = None
) -> StraightnessResult:
    """Segments of a guideway, spliced, into the table of a straightness error such as EYX.

    With `monotone` the component also has the slope that keeps the axis which takes it out from reversing.

    Raises:
        InputError: the name is no straightness of an axis of the machine, the table is wrong, or segments do not fit.
    """
    axis = _straightness_axis(job.file.machine, name)
    segments, repeatability, reversal = [], [], []
    for placement in read_straightness(job.source).values():
        segment, spread, back = _segment(placement, noise)
        segments.append(segment)
        repeatability += [] if spread is None else [spread]
        reversal += [] if back is None else [back]
    try:
        spliced = splice_segments(segments, mirror, spacing=spacing)
    except InputError as error:
        raise InputError(f"{job.source}: {error}") from error
    _check_travel(axis, spliced.positions, job.source)
    straightness = spliced.straightness()
    positions = np.linspace(spliced.positions[0], spliced.positions[-1], min(MOST_TABLE_ROWS, len(spliced.positions)))
    # To a nanometre: a zero that is none by rounding errors looks odd in a file.
    positions = np.asarray(np.round(positions, 9), dtype=np.float64)
    values = np.interp(positions, spliced.positions, straightness.deviations)
    uncertainty = float(np.sqrt(np.diag(spliced.deviation_covariance()).max()))
    rotated = rotate_monotone(positions, values) if monotone else None
    job.file.set_table(name, positions, values, None)
    if rotated is not None:
        job.file.set_slope(name, math.tan(rotated.angle))
    job.finish([name], uncertainty, {"straightness": straightness.error})
    return StraightnessResult(
        name,
        spliced,
        straightness.error,
        uncertainty,
        max(repeatability, default=None),
        max(reversal, default=None),
        rotated,
    )


def _segment(placement: Placement, noise: float) -> tuple[Segment, float | None, float | None]:
    """One placement: repeated runs averaged, with their largest deviation and reversal part; a single one as it is."""
    runs = placement.runs
    start = min(float(run.positions.min()) for run in runs)
    counts = {sign: sum(run.direction == sign for run in runs) for sign in (1, -1)}
    if 1 in counts.values() or len(runs) == 1:
        positions = np.concatenate([run.positions for run in runs])
        # Runs may differ in height by how the sensor was set; the first one's counts.
        readings = np.concatenate([run.readings - run.readings.mean() for run in runs])
        return Segment(positions, readings, noise, start, placement.turned), None, None
    combined = combine_runs(runs)
    floor = noise / math.sqrt(len(runs))
    spread = max(combined.standard_uncertainty, floor / 2)
    segment = Segment(combined.positions, combined.mean, spread, start, placement.turned)
    reversal = None if combined.reversal is None else float(np.abs(combined.reversal).max())
    return segment, combined.largest_deviation, reversal


@dataclass(frozen=True)
class MachineResult:
    """What identification found, and the verdict on it."""

    identification: Identification
    verdict: Verdict


def calibrate_machine(
    job: Job, orders: Orders, noise: float, required: float, limits: Limits | None = None
) -> MachineResult:
    """All parameters of a machine from probed poses; the file is written whatever the verdict, which stands in it.

    Raises:
        InputError: the poses cannot be read or do not fit the machine.
    """
    machine = job.file.machine
    poses = read_probed_poses(job.source, machine, noise)
    parameters = list_parameters(machine, orders)
    identification = identify_machine(machine, parameters, poses)
    held_out = check_held_out(machine, parameters, poses)
    verdict = judge_calibration(identification, held_out, poses, required=required, limits=limits)
    job.file.set_machine(identification.machine)
    figures = {"held_out_ratio": held_out.ratio, "volumetric_uncertainty": verdict.uncertainty}
    job.finish(["machine"], verdict.uncertainty, figures)
    return MachineResult(identification, verdict)


def _own_component(axis: Axis) -> tuple[str, float]:
    """Name of the positioning error of an axis, and the sign of its direction."""
    own = int(np.argmax(np.abs(axis.direction)))
    kind = own if axis.kind == "linear" else own + 3
    return f"E{DIRECTIONS[kind]}{axis.letter}", math.copysign(1.0, axis.direction[own])


def _straightness_axis(machine: MachineDescription, name: str) -> Axis:
    if len(name) != 3 or name[0] != "E" or name[1] not in "XYZ":
        raise InputError(
            f"'{name}' names no straightness; expected E, one of X Y Z, letter of a linear axis, such as EYX"
        )
    axis = machine.axis(name[2])
    if axis.kind != "linear" or _own_component(axis)[0] == name:
        raise InputError(f"{name} is no straightness of a linear axis; its own direction is its positioning")
    return axis


def _check_travel(axis: Axis, positions: Array, source: Path) -> None:
    low, high = axis.travel
    slack = 1e-3 * (high - low)
    if positions[0] < low - slack or positions[-1] > high + slack:
        raise InputError(
            f"{source}: positions from {positions[0]:g} to {positions[-1]:g} leave the travel of {axis.letter}, "
            f"{low:g} to {high:g} (m or rad): another axis, or another unit?"
        )
