"""From readings along a mirror to the straightness of an axis in the machine file, and a report in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.calibration.measurements import Placement, read_straightness
from rotary_error_monitor.calibration.steps import Job, check_travel, own_component, share_of_travel
from rotary_error_monitor.description.machine import Axis, MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.guideway_compensation import RotatedCurve, rotate_monotone
from rotary_error_monitor.metrology.overlaps import contradicting
from rotary_error_monitor.metrology.repeated_runs import RepeatedRuns, combine_runs
from rotary_error_monitor.metrology.run_agreement import (
    disagreeing_directions,
    disagreeing_runs,
    unrepeated_doubt,
)
from rotary_error_monitor.metrology.splicing import Mirror, Segment, SplicedProfile, splice_segments
from rotary_error_monitor.metrology.straightness import Straightness
from rotary_error_monitor.metrology.unresolved import find_unresolved

Array = NDArray[np.float64]

MOST_TABLE_ROWS = 101
"""Rows of a table in the machine file, so that it can still be read."""

LEAST_OF_TRAVEL = 0.01
"""Part of the travel that readings cover at least: metres taken for mm cover a thousandth."""

SMALL_PART = 0.1
"""Readings that cover less than this of both their mirror and the travel are taken for positions in another unit, such
as inches: pieces of a travel are as long as the mirror that they are measured along."""


@dataclass(frozen=True)
class StraightnessResult:
    """What a straightness step found; `rotated` is None where no monotone curve was asked for.

    Attributes:
        error, error_uncertainty: range of the deviations from the least squares line and its standard uncertainty, m.
        uncertainty: largest standard uncertainty of a deviation, m.
        between: its part by what lies between the readings, m.
        spacing: of the readings, m.
        repeatability: largest deviation of a reading from the mean of its direction, m; None without repeated runs.
        reversal: largest difference between the directions, m; None if all runs go one way.
        misfits: what does not fit, in words.
        written: whether the file was written.
    """

    name: str
    spliced: SplicedProfile
    error: float
    error_uncertainty: float
    uncertainty: float
    between: float
    spacing: float
    repeatability: float | None
    reversal: float | None
    rotated: RotatedCurve | None
    misfits: tuple[str, ...]
    written: bool


@dataclass(frozen=True)
class Reading:
    """How the readings of a straightness test are to be taken.

    Attributes:
        noise: standard deviation of one, m.
        position_noise: standard deviation of the position of a stop, m.
        drop_outliers: leave out readings that stand off from those of other runs.
    """

    noise: float
    position_noise: float = 0.0
    drop_outliers: bool = False


def calibrate_straightness(
    job: Job, name: str, mirror: Mirror, reading: Reading, *, monotone: bool = False, spacing: float | None = None
) -> StraightnessResult:
    """Segments of a guideway, spliced, into the table of a straightness error such as EYX.

    With `monotone` the component also has the slope that keeps the axis which takes it out from reversing. Segments,
    runs and directions that contradict one another, readings that stand off, and a table over so small a part of the
    travel that its unit is in doubt are written by force only.

    Raises:
        InputError: the name is no straightness of an axis of the machine, the table is wrong, or segments do not fit.
    """
    axis = _straightness_axis(job.file.machine, name)
    try:
        parts = [_segment(placement, reading) for placement in read_straightness(job.source, job.layout).values()]
        spliced = splice_segments([part.segment for part in parts], mirror, spacing=spacing)
    except InputError as error:
        raise (error if str(job.source) in str(error) else InputError(f"{job.source}: {error}")) from error
    check_travel(axis, spliced.positions, job.source)
    straightness = spliced.straightness()
    intervals = len(spliced.nodes) - 1
    rows = intervals * max(1, MOST_TABLE_ROWS // intervals) + 1 if intervals < MOST_TABLE_ROWS else MOST_TABLE_ROWS
    positions = np.linspace(spliced.positions[0], spliced.positions[-1], rows)
    # To a nanometre: a zero that is none by rounding errors looks odd in a file.
    positions = np.asarray(np.round(positions, 9), dtype=np.float64)
    values = np.interp(positions, spliced.positions, straightness.deviations)
    doubts = _doubts(parts, spliced, straightness, reading.noise)
    doubts = replace(doubts, misfits=(*_unit_doubts(axis, spliced.positions, mirror.length), *doubts.misfits))
    rotated = rotate_monotone(positions, values) if monotone else None
    job.file.set_table(name, positions, values, None)
    if rotated is not None:
        job.file.set_slope(name, math.tan(rotated.angle))
    figures = {"straightness": straightness.error, "straightness_uncertainty": doubts.error_uncertainty}
    written = job.finish([name], doubts.uncertainty, figures, doubts.misfits)
    combined = [part.combined for part in parts]
    return StraightnessResult(
        name,
        spliced,
        straightness.error,
        doubts.error_uncertainty,
        doubts.uncertainty,
        doubts.between,
        max(float(np.median(np.diff(one.positions))) for one in combined),
        max((one.largest_deviation for one in combined if one.uncertainty is not None), default=None),
        max((float(np.abs(one.reversal).max()) for one in combined if one.reversal is not None), default=None),
        rotated,
        doubts.misfits,
        written,
    )


@dataclass(frozen=True)
class _Placed:
    """A placement's `runs`, how many, what they have in common, and that without the readings that stand off."""

    segment: Segment
    runs: int
    combined: RepeatedRuns
    without: RepeatedRuns


def _segment(placement: Placement, reading: Reading) -> _Placed:
    runs = placement.runs
    combined, without = (
        combine_runs(runs, noise=reading.noise, position_noise=reading.position_noise, drop_outliers=drop)
        for drop in (False, True)
    )
    if reading.drop_outliers:
        combined = without
    stated = reading.noise * np.sqrt(combined.weights)
    noise = stated
    if combined.uncertainty is not None:
        # repeated runs tell the noise themselves; readings that hardly change may hide it; where neighbours go
        # together, a spline that averages about two of them averages less
        noise = np.maximum(combined.uncertainty * math.sqrt(1 + combined.correlation), stated / 2)
    start = min(float(run.positions.min()) for run in runs)
    segment = Segment(combined.positions, combined.mean, noise, start, placement.turned)
    return _Placed(segment, len(runs), combined, without)


@dataclass(frozen=True)
class _Doubts:
    """How sure a result is; fields as of `StraightnessResult`."""

    uncertainty: float
    error_uncertainty: float
    between: float
    misfits: tuple[str, ...]


def _doubts(parts: Sequence[_Placed], spliced: SplicedProfile, straightness: Straightness, noise: float) -> _Doubts:
    covariance = spliced.deviation_covariance()
    between = _between(parts)
    misfits, doubt = _contradictions(parts, spliced, between)
    disagreements, moved = _disagreements(parts, noise)
    doubt = max(doubt, moved, *(unrepeated_doubt(part.combined, noise) for part in parts))
    largest = float(np.diag(covariance).max())
    high, low = int(np.argmax(straightness.deviations)), int(np.argmin(straightness.deviations))
    across = float(covariance[high, high] + covariance[low, low] - 2 * covariance[high, low])
    # errors of neighbours that go together are opposite between a curve's two extremes
    across = max(across, 2 * largest) * (1 + max(part.combined.correlation for part in parts))
    return _Doubts(
        uncertainty=math.hypot(math.sqrt(largest), between, doubt),
        # what lies between the readings makes the range larger at both ends
        error_uncertainty=math.hypot(math.sqrt(across), 2 * between, math.sqrt(2) * doubt),
        between=between,
        misfits=(*disagreements, *misfits),
    )


def _between(parts: Sequence[_Placed]) -> float:
    """Standard deviation of what lies between the stops of all placements, m."""
    found = [
        find_unresolved(part.segment.positions, part.segment.readings, np.square(part.segment.noise)) for part in parts
    ]
    count = max(1, sum(one.count for one in found))
    return max(math.sqrt(sum(one.square for one in found) / count), max(one.largest for one in found))


def _contradictions(parts: Sequence[_Placed], spliced: SplicedProfile, between: float) -> tuple[tuple[str, ...], float]:
    """What does not fit, in words, and how far it may move the result, m."""
    misfits, doubt = [], 0.0
    for number, part in enumerate(parts, start=1):
        outliers = part.combined.outliers
        if part.combined is part.without or not outliers:
            continue
        worst = outliers[0]
        misfits.append(
            f"segment {number}: {len(outliers)} reading(s) stand off from those of other runs, by up to "
            f"{worst.excess * 1e6:+.3f} µm or {worst.ratio:.1f} standard deviations; --drop-outliers leaves them out"
        )
        moved = np.interp(part.combined.positions, part.without.positions, part.without.mean) - part.combined.mean
        doubt = max(doubt, float(np.abs(moved - np.median(moved)).max()))
    for overlap in contradicting(spliced.overlaps, unresolved=between):
        pair = f"segments {overlap.segments[0] + 1} and {overlap.segments[1] + 1}"
        misfits.append(
            f"{pair} differ by {overlap.difference * 1e6:.3f} µm in their overlap, where noise explains "
            f"{overlap.expected * 1e6:.3f} µm (p-value {overlap.probability_beside(between**2):.1g})"
        )
        doubt = max(doubt, overlap.difference)
    return tuple(misfits), doubt


def _disagreements(parts: Sequence[_Placed], noise: float) -> tuple[tuple[str, ...], float]:
    """Runs and directions that contradict one another, in words, and how far they may move the result, m."""
    misfits, doubt = [], 0.0
    for number, part in enumerate(parts, start=1):
        for what, found, advice in (
            (
                "runs of one direction scatter by",
                disagreeing_runs(part.combined, part.runs, noise),
                "a run of another sign or unit, a drift, or noise larger than stated",
            ),
            (
                "forward and backward differ by",
                disagreeing_directions(part.combined, noise),
                "one direction of another sign or unit, or a drift",
            ),
        ):
            if found is not None:
                misfits.append(
                    f"segment {number}: {what} {found.size * 1e6:.3f} µm, where noise of {noise * 1e6:g} µm and a "
                    f"plausible repeatability or reversal explain {found.expected * 1e6:.3f} µm (p-value "
                    f"{found.probability:.1g}): {advice}"
                )
                doubt = max(doubt, found.moved)
    return tuple(misfits), doubt


def _unit_doubts(axis: Axis, positions: Array, mirror: float) -> tuple[str, ...]:
    """Positions that cover so little that their unit is in doubt, in words."""
    share, of_mirror = share_of_travel(axis, positions), float(np.ptp(positions)) / mirror
    if share >= LEAST_OF_TRAVEL and max(share, of_mirror) >= SMALL_PART:
        return ()
    return (
        f"the positions, {positions[0] * 1e3:g} to {positions[-1] * 1e3:g} mm, cover {share:.2%} of the travel of "
        f"{axis.letter} and {of_mirror:.2%} of the mirror's length: are they in another unit?",
    )


def _straightness_axis(machine: MachineDescription, name: str) -> Axis:
    if len(name) != 3 or name[0] != "E" or name[1] not in "XYZ":
        raise InputError(
            f"'{name}' names no straightness; expected E, one of X Y Z, letter of a linear axis, such as EYX"
        )
    axis = machine.axis(name[2])
    if axis.kind != "linear" or own_component(axis)[0] == name:
        raise InputError(f"{name} is no straightness of a linear axis; its own direction is its positioning")
    return axis
