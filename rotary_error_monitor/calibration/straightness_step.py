"""From readings along a mirror to the straightness of an axis in the machine file, and a report in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.known_readings import BESIDE, ReadingPlace, known_readings
from rotary_error_monitor.calibration.placement_doubts import placement_doubts
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.calibration.straightness_doubts import StraightnessUncertainty, find_doubts, unit_doubts
from rotary_error_monitor.calibration.straightness_runs import Measured, Placed, ReadingSettings, measure_straightness
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.metrology.guideway_compensation import RotatedCurve, rotate_monotone
from rotary_error_monitor.metrology.profile_comparison import ProfileComparison, compare_profiles
from rotary_error_monitor.metrology.reference_mirror import ReferenceMirror
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.splicing import SplicedProfile

MOST_TABLE_ROWS = 101
"""Rows of a table in the machine file, so that it can still be read."""


UNKNOWN = (
    "the mirror's flatness is unknown, and a curved mirror looks like a curved guideway: state it, or measure "
    "one placement a second time with the mirror turned over"
)
"""Why a curve may be the mirror's; by force all of it counts as uncertainty."""

LEAST_SLOPE = 1e-9
"""What a slope makes over the table, m, below which it is rounding."""


@dataclass(frozen=True)
class Direct:
    """A direct measurement of the same straightness.

    Attributes:
        source: its file.
        mirror: None for an interferometer.
        reading: how its readings are to be taken.
        layout: of a table as an instrument writes it.
    """

    source: Path
    mirror: ReferenceMirror | None
    reading: ReadingSettings
    layout: ColumnLayout | None = None


@dataclass(frozen=True)
class Asked:
    """What a straightness step is asked for beside the curve.

    Attributes:
        monotone: the slope that keeps the axis which takes the curve out from reversing.
        direct: a direct measurement to hold the spliced one against.
        form: that of the mirror.
        spacing: of the spline's nodes, m; None for what the samples give.
        place: where the instrument read, for what the file's other errors make there.
    """

    monotone: bool = False
    direct: Direct | None = None
    form: bool = False
    spacing: float | None = None
    place: ReadingPlace = field(default_factory=ReadingPlace)


@dataclass(frozen=True)
class StraightnessResult:
    """What a straightness step found; `rotated` is None where no monotone curve was asked for.

    Attributes:
        placements: the runs of each placement, and what they have in common.
        error: range of the deviations from the least squares line, m.
        doubts: how sure that is, and what does not fit.
        spacing: of the readings, m.
        comparison: with a direct measurement; None where there is none.
        table: positions and values as the machine file has them, m.
        written: whether the file was written.
        remarks: what was taken for granted, in words.
    """

    name: str
    spliced: SplicedProfile
    placements: tuple[Placed, ...]
    error: float
    doubts: StraightnessUncertainty
    spacing: float
    rotated: RotatedCurve | None
    comparison: ProfileComparison | None
    table: tuple[Array, Array]
    written: bool
    remarks: tuple[str, ...] = ()

    @property
    def reversal(self) -> float | None:
        """Largest difference between the directions, m; None if all runs go one way."""
        parts = [part.combined.reversal for part in self.placements]
        return max((float(np.abs(each).max()) for each in parts if each is not None), default=None)


def calibrate_straightness(
    job: Job, name: str, mirror: ReferenceMirror | None, reading: ReadingSettings, asked: Asked | None = None
) -> StraightnessResult:
    """Segments of a guideway, spliced, into the table of a straightness error such as EYX; one alone without a mirror.

    With `monotone` the component also has the slope that keeps the axis which takes it out from reversing. Segments,
    runs and directions that contradict one another, readings that stand off, a direct measurement that differs by more
    than both uncertainties explain, and a table over so small a part of the travel that its unit is in doubt are
    written by force only.

    Raises:
        InputError: the name is no straightness of an axis of the machine, the table is wrong, segments do not fit, or
            no two placements show the mirror's form that is asked for.
    """
    asked = asked or Asked()
    axis = _straightness_axis(job.file.machine, name)
    measured = measure_straightness(job.source, axis, mirror, reading, asked.spacing, job.layout)
    parts, spliced = measured.parts, measured.spliced
    if asked.form and spliced.mirror is None:
        raise InputError(
            f"{job.source}: the mirror's form is not shown: measure two placements or more, of a mirror whose flatness "
            "is stated, or one of them both ways up"
        )
    straightness = spliced.straightness()
    positions, values = _table(spliced, straightness.deviations)
    known = _known(job.file.machine, name, positions, asked.place)
    values = np.asarray(values - known, dtype=np.float64)
    doubts = _doubts(axis, parts, mirror, spliced, reading.noise)
    comparison = None if asked.direct is None else _compare(axis, measured, doubts, asked.direct)
    if comparison is not None and comparison.probability < FALSE_ALARM:
        doubts = doubts.beside((_difference(comparison),), comparison.largest)
    kept, rotated = _write_table(job, name, positions, values, monotone=asked.monotone)
    figures = {"straightness": straightness.error, "straightness_uncertainty": doubts.error_uncertainty}
    written = job.finish([name], doubts.uncertainty, figures, doubts.misfits)
    return StraightnessResult(
        name=name,
        spliced=spliced,
        placements=parts,
        error=straightness.error,
        doubts=doubts,
        spacing=max(float(np.median(np.diff(part.combined.positions))) for part in parts),
        rotated=rotated,
        comparison=comparison,
        table=(positions, values),
        written=written,
        remarks=(
            *_remarks(job.file.machine, name, positions, known, asked.place, doubts.uncertainty),
            *_slope_remark(kept, positions, rotated is not None),
        ),
    )


def _write_table(
    job: Job, name: str, positions: Array, values: Array, *, monotone: bool
) -> tuple[float, RotatedCurve | None]:
    """Set the table with the slope that it is to have; gives that of the file, and the curve if it is rotated."""
    kept = _slope(job.file.machine, name, positions)
    rotated = rotate_monotone(positions, values) if monotone else None
    job.file.set_table(name, positions, values, None)
    if rotated is not None:
        job.file.set_slope(name, math.tan(rotated.angle))
    elif abs(kept) * np.ptp(positions) > LEAST_SLOPE:
        job.file.set_slope(name, kept)
    return kept, rotated


def _doubts(
    axis: Axis, parts: Sequence[Placed], mirror: ReferenceMirror | None, spliced: SplicedProfile, noise: float
) -> StraightnessUncertainty:
    """How sure a spliced curve is, with what its positions and its mirror leave open."""
    straightness = spliced.straightness()
    doubts = find_doubts(parts, spliced, straightness, noise)
    doubts = doubts.beside(unit_doubts(axis, spliced.positions, None if mirror is None else mirror.length))
    is_turned = len({part.segment.turned for part in parts}) == 2
    open_ = [UNKNOWN] if mirror is not None and mirror.flatness is None and not is_turned else []
    open_ += placement_doubts([part.segment for part in parts], mirror, spliced)
    for misfit in open_:
        # all of the curve may be the mirror's
        doubts = doubts.beside((misfit,), float(np.abs(straightness.deviations).max()))
    return doubts


def _slope(machine: MachineDescription, name: str, positions: Array) -> float:
    """Slope that the file has in a component, of its line of least squares.

    A straightness test says nothing of it, and what was measured of squareness counts with it: it stays.
    """
    number = machine.letters.index(name[2])
    at = np.zeros((len(machine.axes), len(positions)))
    at[number] = positions
    before = arrange_components(machine).at(at, None, None)["XYZ".index(name[1]), number]
    return float(np.polyfit(positions, before, 1)[0])


def _known(machine: MachineDescription, name: str, positions: Array, place: ReadingPlace) -> Array:
    """(n,) what other errors of the file make of the readings, about its line of least squares, m."""
    found = known_readings(machine, name[2], {name: 1.0}, positions, place=place)
    if np.ptp(found) == 0.0:
        return np.zeros_like(found)
    return np.asarray(found - np.polyval(np.polyfit(positions, found, 1), positions), dtype=np.float64)


def _slope_remark(slope: float, positions: Array, is_rotated: bool) -> Iterator[str]:
    if abs(slope) * np.ptp(positions) > LEAST_SLOPE:
        fate = "gives way to that of --monotone: squareness that counts with it is off by that"
        had = f"the slope of {slope * 1e6:+.2f} µrad that the file has in it, which no straightness shows"
        yield f"{had}, {fate if is_rotated else 'stays'}"


def _remarks(
    machine: MachineDescription, name: str, positions: Array, known: Array, place: ReadingPlace, uncertainty: float
) -> Iterator[str]:
    """What other errors of the file make of the readings, and another by elsewhere, where that is worth a word."""
    if float(np.ptp(known)) > uncertainty / 10:
        yield f"the table is without {np.ptp(known) * 1e6:.3g} µm that other errors of the file make of the readings"
    levers = []
    for each in np.eye(3):
        x, y, z = (float(a + BESIDE * b) for a, b in zip(place.beside, each, strict=True))
        levers.append(float(np.ptp(_known(machine, name, positions, replace(place, beside=(x, y, z))) - known)))
    if max(levers) > uncertainty / 10:
        yield (
            f"read at the tool's origin, or as --at and --beside-mm say: {BESIDE * 1e3:g} mm from there angular errors "
            f"of the file make up to {max(levers) * 1e6:.3g} µm of it"
        )


def _table(spliced: SplicedProfile, deviations: Array) -> tuple[Array, Array]:
    """Positions and values for the machine file, m."""
    intervals = len(spliced.nodes) - 1
    rows = intervals * max(1, MOST_TABLE_ROWS // intervals) + 1 if intervals < MOST_TABLE_ROWS else MOST_TABLE_ROWS
    positions = np.linspace(spliced.positions[0], spliced.positions[-1], rows)
    # To a nanometre: a zero that is none by rounding errors looks odd in a file.
    positions = np.asarray(np.round(positions, 9), dtype=np.float64)
    return positions, np.interp(positions, spliced.positions, deviations)


def _compare(axis: Axis, measured: Measured, doubts: StraightnessUncertainty, direct: Direct) -> ProfileComparison:
    other = measure_straightness(direct.source, axis, direct.mirror, direct.reading, layout=direct.layout)
    further = find_doubts(other.parts, other.spliced, other.spliced.straightness(), direct.reading.noise).between
    with told_of(direct.source):
        return compare_profiles(measured.spliced, other.spliced, (doubts.between, further))


def _difference(comparison: ProfileComparison) -> str:
    return (
        f"the direct measurement differs by up to {comparison.largest * 1e6:.3f} µm, at {comparison.at * 1e3:g} mm, "
        f"where both uncertainties explain {comparison.bound * 1e6:.3f} µm (p-value {comparison.probability:.1g}): "
        "another flatness, another position, or a curve that has changed"
    )


def _straightness_axis(machine: MachineDescription, name: str) -> Axis:
    if len(name) != 3 or name[0] != "E" or name[1] not in "XYZ":
        raise InputError(
            f"'{name}' names no straightness; expected E, one of X Y Z, letter of a linear axis, such as EYX"
        )
    axis = machine.axis(name[2])
    if axis.kind != "linear" or name in axis.positioning_shares:
        raise InputError(f"{name} is no straightness of a linear axis; its own direction is its positioning")
    return axis
