"""The steps of a calibration: measurements in, a changed machine file and a report in words out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.known_readings import BESIDE, ReadingPlace, known_readings, largest_lever
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.machine_poses import read_positioning_poses
from rotary_error_monitor.calibration.measurements import read_positioning
from rotary_error_monitor.calibration.quietness import quiet_angle, quiet_length
from rotary_error_monitor.calibration.yaml_document import hash_source
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.metrology.positioning import (
    Outlier,
    PositioningFigures,
    PositioningRuns,
    check_standard_test,
    estimate_positioning,
    find_jumps,
    find_outliers,
    remove_outliers,
)
from rotary_error_monitor.metrology.positioning_bounds import PositioningBounds, bound_positioning
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.units import ARCSEC, TURN

LARGEST_GAP = 1.2
"""Targets of a rotary axis further apart, rad, do not go all round."""

NEAREST = 1e-4
"""Least distance of a repeated position from others, rad."""

LEAST_COVERED = 0.9
"""Share of the travel that targets should cover."""


LEAST_TARGETS = 0.02
"""Share of the travel that targets cover at least: radians taken for degrees cover 1.7 %, metres taken for mm 0.1 %."""


@dataclass(frozen=True)
class Job:
    """What every step needs.

    Attributes:
        source: file or bag of measurements.
        file: the machine file to change.
        output: where to write it.
        day: day of the calibration.
        force: write what does not fit as well.
        layout: which column of the source is what, of a table as an instrument writes it.
    """

    source: Path
    file: MachineFile
    output: Path
    day: date
    force: bool = False
    layout: ColumnLayout | None = None

    @property
    def is_table(self) -> bool:
        """Whether the source is a table; else it is a bag."""
        return self.layout is not None or self.source.suffix == ".csv"

    def finish(
        self, names: list[str], uncertainty: float | None, figures: Mapping[str, float], misfits: Sequence[str] = ()
    ) -> bool:
        """Note where the sections are from, and save; nothing is written where something does not fit, but by force.

        Gives whether the file was written.
        """
        return self.finish_parts(dict.fromkeys(names, (uncertainty, figures)), misfits)

    def finish_parts(
        self, parts: Mapping[str, tuple[float | None, Mapping[str, float]]], misfits: Sequence[str] = ()
    ) -> bool:
        """The same of sections that each have an uncertainty and figures of their own, by name."""
        if misfits and not self.force:
            return False
        remark, known = "; ".join(misfits) or None, hash_source(self.source)
        for name, (uncertainty, figures) in parts.items():
            provenance = Calibrated(self.day.isoformat(), self.source.name, known, uncertainty, figures, remark)
            self.file.note([name], provenance)
        self.file.save(self.output, self.source)
        return True


@dataclass(frozen=True)
class PositioningResult:
    """What a positioning step found.

    Attributes:
        name: the error component; of an axis that is inclined to x, y and z each in which it moves.
        runs: all readings.
        figures: of the readings, without `outliers` where these were `dropped`.
        bounds: 95 % intervals of the figures.
        instrument: standard uncertainty of the instrument that they count, m or rad; 0 if none was given.
        outliers: readings that stand off from the others.
        remarks: departures from the standard test, in words.
        uncertainty: largest standard uncertainty of a mean, the instrument's with it, m or rad.
        misfits: what does not fit, in words.
        written: whether the file was written.
    """

    name: str
    runs: PositioningRuns
    figures: PositioningFigures
    bounds: PositioningBounds
    instrument: float
    outliers: tuple[Outlier, ...]
    dropped: bool
    remarks: tuple[str, ...]
    uncertainty: float
    misfits: tuple[str, ...]
    written: bool


def calibrate_positioning(
    job: Job,
    letter: str,
    *,
    drop_outliers: bool = False,
    instrument: float = 0.0,
    place: ReadingPlace | None = None,
) -> PositioningResult:
    """ISO 230-2 test of one axis into the table of its positioning error.

    Outliers are told. A test that holds such as clean readings hardly ever do is written without them, or by force.
    `instrument` is the standard uncertainty of the instrument's difference between two positions, m or rad; where it
    read, and at what temperature, is the `place`, which a bag tells itself. What the file's other errors make there of
    the readings is in the figures, and not in the table.

    Raises:
        InputError: the machine has no such axis, the table is wrong, or its targets leave the travel.
    """
    axis, place = job.file.machine.axis(letter), place or ReadingPlace()
    if job.is_table:
        runs = read_positioning(job.source, rotary=axis.kind == "rotary", layout=job.layout)
    else:
        runs, place = read_positioning_poses(job.source, job.file.machine, letter)
    check_travel(axis, runs.targets, job.source)
    outliers = find_outliers(runs)
    used = remove_outliers(runs, outliers) if drop_outliers else runs
    figures, bounds = estimate_positioning(used), bound_positioning(used, instrument)
    known = _known(job.file.machine, axis, runs.targets, place)
    positions, components = _set_tables(job.file, axis, figures, known), axis.positioning_shares
    uncertainty = math.hypot(_largest_uncertainty(figures), instrument)
    misfits = () if drop_outliers else _outlying_readings(find_outliers(runs, false_alarm=FALSE_ALARM), runs)
    if misfits:
        uncertainty = math.hypot(uncertainty, _moved_by(outliers, figures))
    share = share_of_travel(axis, positions)
    if share < LEAST_TARGETS and (axis.kind == "linear" or np.ptp(positions) < TURN / 2):
        misfits += (f"the targets cover {share:.2%} of the travel of {letter}: are they in another unit?",)
    misfits += (*_jumps(runs), *_too_quiet(figures, runs))
    lost = _across(job.file.machine, axis, positions)
    written = job.finish([*components], uncertainty, _noted(figures, bounds), misfits)
    remarks = (
        *check_standard_test(runs),
        *_positioning_remarks(job, runs, share, lost, [*components], uncertainty),
        *_ahead(bounds),
        *_known_remarks(job.file.machine, axis, runs.targets, known, place, uncertainty),
    )
    return PositioningResult(
        ", ".join(components),
        *(runs, figures, bounds, instrument, outliers, drop_outliers, remarks, uncertainty, misfits, written),
    )


def _known(machine: MachineDescription, axis: Axis, targets: Array, place: ReadingPlace) -> tuple[Array, Array]:
    """What other errors of the file make of readings at targets (n,), forward and backward, m or rad.

    An angle that an instrument reads has nothing of them; one that is told from a tool tip has.
    """
    if axis.kind == "rotary" and not place.whole:
        return np.zeros_like(targets), np.zeros_like(targets)
    shares = axis.positioning_shares
    forward, backward = (
        known_readings(machine, axis.letter, shares, targets, direction=way, place=place) for way in (1.0, -1.0)
    )
    return forward, backward


def _set_tables(file: MachineFile, axis: Axis, figures: PositioningFigures, known: tuple[Array, Array]) -> Array:
    """Write means without what is `known` of them to the components of an axis, and give the positions of the table."""
    targets = figures.targets
    positions = _over_travel(axis, targets)
    forward = _repeated(positions, targets, figures.forward.mean - known[0])
    backward = None if figures.backward is None else _repeated(positions, targets, figures.backward.mean - known[1])
    for name, share in axis.positioning_shares.items():
        file.set_table(name, positions, share * forward, None if backward is None else share * backward)
    return positions


def _positioning_remarks(
    job: Job, runs: PositioningRuns, share: float, lost: float, names: list[str], uncertainty: float
) -> Iterator[str]:
    """What a table of so large a share of the travel leaves open; `lost` is across the axis, m or rad."""
    if share < LEAST_COVERED:
        yield f"the targets cover {share:.0%} of the travel; beyond them the error of the last one holds"
    if lost > uncertainty:
        size = f"{lost * ARCSEC:.3g} arcsec" if runs.rotary else f"{lost * 1e6:.3g} µm"
        yield f"up to {size} across the axis, which the file had in {', '.join(names)}, is in the history now"
    if runs.rotary and not job.is_table:
        yield "told from a tool tip: radial error motions and a displaced axis count into the angle"


def _ahead(bounds: PositioningBounds) -> tuple[str, ...]:
    """A remark on an axis that goes too far where play would hold it back."""
    if bounds.bidirectional is None or bounds.bidirectional.mean_reversal_error[0] <= 0:
        return ()
    return (
        "from below it stands further than from above, and play makes the contrary: a controller that compensates too "
        "much, or directions of the other side?",
    )


def _known_remarks(
    machine: MachineDescription,
    axis: Axis,
    targets: Array,
    known: Sequence[Array],
    place: ReadingPlace,
    uncertainty: float,
) -> Iterator[str]:
    """What other errors of the file make of the readings (n,) in each direction, and what was assumed for it."""
    scale, unit = (ARCSEC, "arcsec") if axis.kind == "rotary" else (1e6, "µm")
    size = max(float(np.ptp(each)) for each in known)
    if size > uncertainty / 10:
        yield f"the table is without {size * scale:.3g} {unit} that other errors of the file make of the readings"
    if axis.kind == "rotary" or place.whole:
        return
    lever = largest_lever(machine, axis.letter, axis.positioning_shares, targets, place)
    if lever > uncertainty / 10:
        yield (
            f"read at the tool's origin{_beside(place)}: {BESIDE * 1e3:g} mm beside it angular errors of the file make "
            f"up to {lever * 1e6:.3g} µm of it (--beside-mm, --at)"
        )
    warmer = abs(axis.expansion) * float(np.ptp(targets))
    if warmer > uncertainty / 10:
        degrees = machine.reference_temperature if place.temperature is None else place.temperature
        taken = " is taken for its temperature" if place.temperature is None else ""
        yield f"axis {axis.letter} at {degrees:g} °C{taken}: each kelvin makes {warmer * 1e6:.3g} µm (--temperature-c)"


def _beside(place: ReadingPlace) -> str:
    if not any(place.beside):
        return ""
    return " and ({:g}, {:g}, {:g}) mm from it".format(*(1e3 * each for each in place.beside))


def _too_quiet(figures: PositioningFigures, runs: PositioningRuns) -> tuple[str, ...]:
    """Runs that repeat better than any instrument for such axes does, in words."""
    ways = [figures.forward] if figures.backward is None else [figures.forward, figures.backward]
    scatter = max(float(way.spread.max()) for way in ways)
    errors = max(float(np.abs(way.mean).max()) for way in ways)
    doubt = quiet_angle(scatter, errors) if runs.rotary else quiet_length(scatter, errors, float(np.ptp(runs.targets)))
    return () if doubt is None else (f"runs scatter by {doubt}",)


def _largest_uncertainty(figures: PositioningFigures) -> float:
    """Largest standard uncertainty of the mean at a target, by the scatter of the runs, m or rad."""
    ways = [figures.forward] if figures.backward is None else [figures.forward, figures.backward]
    return max(float((way.spread / np.sqrt(way.count)).max()) for way in ways)


def _noted(figures: PositioningFigures, bounds: PositioningBounds) -> dict[str, float]:
    """Figures for the machine file with their 95 % intervals; those of one direction where there is but one."""
    names = ["repeatability", "systematic_deviation", "accuracy"]
    found: object = figures.forward
    intervals: object = bounds.forward
    if figures.bidirectional is not None:
        names = ["reversal_error", "mean_reversal_error", *names]
        found, intervals = figures.bidirectional, bounds.bidirectional
    noted = {name: float(getattr(found, name)) for name in names}
    for name in names:
        noted[f"{name}_low"], noted[f"{name}_high"] = getattr(intervals, name)
    return noted


def _outlying_readings(outliers: Sequence[Outlier], runs: PositioningRuns) -> tuple[str, ...]:
    if not outliers:
        return ()
    scale, unit = (ARCSEC, "arcsec") if runs.rotary else (1e6, "µm")
    worst = outliers[0]
    return (
        f"{len(outliers)} reading(s) stand off from the others at their target, by up to {worst.excess * scale:+.3f} "
        f"{unit} or {worst.ratio:.1f} standard deviations; --drop-outliers leaves them out",
    )


def _jumps(runs: PositioningRuns) -> tuple[str, ...]:
    """Steps within a cycle after which readings stay elsewhere, in words."""
    found = find_jumps(runs, false_alarm=FALSE_ALARM)
    if not found:
        return ()
    worst, (scale, unit) = found[0], (ARCSEC, "arcsec") if runs.rotary else (1e6, "µm")
    length, name = (180 / math.pi, "deg") if runs.rotary else (1e3, "mm")
    places = " and ".join(f"{runs.targets[at] * length:g} {name} ({way:+d})" for at, way in (worst.before, worst.after))
    return (
        f"cycle {worst.cycle + 1}: readings step by {worst.size * scale:+.3f} {unit} between {places}, by "
        f"{worst.ratio:.1f} standard deviations of what they do there in other cycles: was the beam broken, or did an "
        "optic slip? Measure the cycle again",
    )


def _moved_by(outliers: Sequence[Outlier], figures: PositioningFigures) -> float:
    """How far outliers move the mean of a target at most, m or rad."""
    moved: dict[tuple[int, int], float] = {}
    for outlier in outliers:
        way = figures.forward if outlier.direction > 0 or figures.backward is None else figures.backward
        key = outlier.target, outlier.direction
        moved[key] = moved.get(key, 0.0) + abs(outlier.excess) / float(way.count[outlier.target])
    return max(moved.values(), default=0.0)


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


def _across(machine: MachineDescription, axis: Axis, positions: Array) -> float:
    """Largest error across an axis' own direction in the components of its positioning error, m or rad."""
    shares, at = axis.positioning_shares, np.zeros((len(machine.axes), len(positions)))
    place = machine.letters.index(axis.letter)
    at[place] = positions
    errors = arrange_components(machine).at(at, np.zeros_like(at), None)[:, place]
    along = np.array([*shares.values()])
    own = errors[[DIRECTIONS.index(name[1]) for name in shares]]
    return float(np.abs(own - np.outer(along, along @ own)).max())


def share_of_travel(axis: Axis, positions: Array) -> float:
    """Part of an axis' travel that rising positions (n,) span."""
    return float(positions[-1] - positions[0]) / (axis.travel[1] - axis.travel[0])


def check_travel(axis: Axis, positions: Array, source: Path) -> None:
    """Hold that rising positions (n,) lie within the travel of an axis.

    Raises:
        InputError: they do not.
    """
    low, high = axis.travel
    slack = 1e-3 * (high - low)
    if positions[0] < low - slack or positions[-1] > high + slack:
        raise InputError(
            f"{source}: positions from {positions[0]:g} to {positions[-1]:g} leave the travel of {axis.letter}, "
            f"{low:g} to {high:g} (m or rad): another axis, or another unit?"
        )
