"""Measurements from CSV files, into the arrays that metrology takes; poses are read in `machine_poses.py`,
what a tracker saw in `tracker_features.py`.

Headers (columns in any order):
    positioning, linear  target_mm,direction,cycle,deviation_um    or reading_mm instead of deviation_um
    positioning, rotary  target_deg,direction,cycle,deviation_arcsec    or reading_deg
    straightness         segment,run,direction,position_mm,reading_um    and mirror (1, -1 turned over) if it was turned
    mirror               distance_mm,height_um
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.copies import refuse_copies
from rotary_error_monitor.calibration.quietness import FINEST_ANGLE, FINEST_LENGTH
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.positioning import PositioningRuns, estimate_deviations
from rotary_error_monitor.metrology.repeated_runs import Run

LENGTH = 100.0
"""Longest axis, m."""

ANGLE = 100 * 2 * math.pi
LINEAR_ERROR = 1e-3
ANGULAR_ERROR = math.radians(0.5)
LEAST_GAP = 5.0
"""Steps this much longer than the median step are gaps."""

TRAVEL_SLACK = 1e-3
"""Part of its travel by which a pose of an axis may be beyond it."""

EMPTIEST = 10.0
"""Places in the table of targets and cycles for each reading: more are no runs over the same targets."""

FEWEST_STOPS = 5
"""Positions that a segment is read at: a cubic takes four, and one more tells what it misses."""


def read_positioning(path: Path | str, *, rotary: bool, layout: ColumnLayout | None = None) -> PositioningRuns:
    """Bidirectional runs of one axis from a CSV file; targets that a cycle did not visit become NaN.

    With a `layout` from a table as an instrument writes it.

    Raises:
        InputError: what `read_table` raises, a direction other than 1 and -1, a run whose targets do not go one way, or
            a cycle that is another one once more.
    """
    common = [Column("direction"), Column("cycle")]
    if rotary:
        target = Column("target_deg", ANGLE)
        measured = [Column("deviation_arcsec", ANGULAR_ERROR), Column("reading_deg", ANGLE)]
    else:
        target = Column("target_mm", LENGTH)
        measured = [Column("deviation_um", LINEAR_ERROR), Column("reading_mm", LENGTH)]
    table = read_table(path, [[target, *common, column] for column in measured], layout=layout)
    targets = table.numbers[target.name]
    if measured[0].name in table.numbers:
        deviations = table.numbers[measured[0].name]
    else:
        deviations = estimate_deviations(targets, table.numbers[measured[1].name], rotary=rotary)
        _check_size(table, deviations, measured[0])
    _check_runs(table, targets, target)
    cycle, places = table.numbers["cycle"], np.stack([targets, table.numbers["direction"]], axis=1)
    named = {f"cycle {each:g}": np.flatnonzero(cycle == each).tolist() for each in np.unique(cycle)}
    refuse_copies(table, named, places, deviations, FINEST_ANGLE if rotary else FINEST_LENGTH)
    values = np.unique(targets)
    cycles = np.unique(table.numbers["cycle"])
    if len(values) * len(cycles) > EMPTIEST * len(targets):
        raise InputError(
            f"{table.path}: {len(targets)} readings at {len(values)} targets in {len(cycles)} cycles; each cycle "
            "visits the targets: are they the commanded positions, and is the cycle its number?"
        )
    place = np.searchsorted(values, targets), np.searchsorted(cycles, table.numbers["cycle"])
    filled = {}
    for sign in (1, -1):
        rows = table.numbers["direction"] == sign
        filled[sign] = np.full((len(values), len(cycles)), np.nan)
        filled[sign][place[0][rows], place[1][rows]] = deviations[rows]
    if not np.any(table.numbers["direction"] == 1):
        raise table.error(0, "no forward run (direction 1)")
    backward = filled[-1] if np.any(table.numbers["direction"] == -1) else None
    try:
        return PositioningRuns(values, filled[1], backward, rotary)
    except InputError as error:
        raise InputError(f"{table.path}:{table.lines[-1]}: in the table that ends here, {error}") from error


def _check_size(table: Table, deviations: Array, column: Column) -> None:
    unit = column.name.rpartition("_")[2]
    table.refuse(
        np.abs(deviations) > column.largest,
        lambda row: (
            f"the reading is {deviations[row] / column.scale:g} {unit} off its target: are both in the unit of "
            "the header?"
        ),
    )


def _check_runs(table: Table, targets: Array, column: Column) -> None:
    """Each run (cycle and direction) visits ascending or descending targets, each once."""
    last: dict[tuple[float, float], tuple[float, int]] = {}
    for row, (direction, cycle, target) in enumerate(
        zip(table.numbers["direction"], table.numbers["cycle"], targets, strict=True)
    ):
        if direction not in (1, -1):
            raise table.error(row, f"direction {direction:g}; expected 1 (approached in positive direction) or -1")
        before = last.get((cycle, direction))
        last[cycle, direction] = target, row
        if before is None:
            continue
        name, shown = f"cycle {cycle:g}, direction {direction:+g}", (before[0] / column.scale, target / column.scale)
        if target == before[0]:
            first = f"first on line {table.lines[before[1]]}"
            raise table.error(
                row, f"target {shown[1]:g} comes twice in {name}; {first}; give one reading, or the mean of several"
            )
        if (target - before[0]) * direction < 0:
            way = "ascend" if direction > 0 else "descend"
            raise table.error(
                row,
                f"{name}: target {shown[1]:g} after {shown[0]:g}; targets of this direction {way}, in the order in "
                "which they were visited: are rows sorted otherwise, or is the direction or cycle another one?",
            )


@dataclass(frozen=True)
class Placement:
    """Runs along one placement of the mirror; `turned`: the mirror is turned over about its long axis."""

    runs: tuple[Run, ...]
    turned: bool = False


def read_straightness(
    path: Path | str, axis: Axis | None = None, layout: ColumnLayout | None = None
) -> dict[str, Placement]:
    """Placements by name of the segment, in the order of the file, from a CSV file; within the travel of an axis.

    With a `layout` from a table as an instrument writes it.

    Raises:
        InputError: what `read_table` raises, a position beyond the travel, a run that does not go one way, a gap in
            one, a mirror that is turned within a segment, a segment of too few positions, or a run that is another one
            once more.
    """
    columns = [
        Column("segment", text=True),
        Column("run", text=True),
        Column("direction"),
        Column("position_mm", LENGTH),
        Column("reading_um", LINEAR_ERROR),
    ]
    table = read_table(path, [columns, [*columns, Column("mirror")]], layout=layout)
    if axis is not None:
        _check_positions(table, axis)
    sides = table.numbers.get("mirror", np.ones(len(table.lines)))
    groups: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(table.words["segment"], table.words["run"], strict=True)):
        groups.setdefault(key, []).append(row)
    named = {f"segment {segment}, run {run}": rows for (segment, run), rows in groups.items()}
    places = np.stack([table.numbers["position_mm"], table.numbers["direction"], sides], axis=1)
    refuse_copies(table, named, places, table.numbers["reading_um"], FINEST_LENGTH)
    segments: dict[str, Placement] = {}
    for (segment, run), rows in groups.items():
        positions = table.numbers["position_mm"][rows]
        directions = table.numbers["direction"][rows]
        _check_pass(table, rows, positions, directions, f"segment {segment}, run {run}")
        before = segments.get(segment, Placement((), bool(sides[rows[0]] == -1)))
        _check_sides(table, rows, sides, segment, before.turned)
        passed = Run(positions, table.numbers["reading_um"][rows], int(directions[0]))
        segments[segment] = Placement((*before.runs, passed), before.turned)
    for segment, placement in segments.items():
        stops = len(np.unique(np.concatenate([run.positions for run in placement.runs])))
        if stops < FEWEST_STOPS:
            last = max(row for (name, _), rows in groups.items() if name == segment for row in rows)
            raise table.error(
                last, f"segment {segment} ends here with {stops} position(s); a curve takes {FEWEST_STOPS} at least"
            )
    return segments


def _check_positions(table: Table, axis: Axis) -> None:
    positions, (low, high) = table.numbers["position_mm"], axis.travel
    slack = TRAVEL_SLACK * (high - low)
    table.refuse(
        (positions < low - slack) | (positions > high + slack),
        lambda row: (
            f"position {positions[row] * 1e3:g} mm leaves the travel of {axis.letter}, {low * 1e3:g} to "
            f"{high * 1e3:g} mm: another axis, or another unit?"
        ),
    )


def _check_sides(table: Table, rows: list[int], sides: Array, segment: str, turned: bool) -> None:
    for row in rows:
        if sides[row] not in (1, -1):
            raise table.error(row, f"mirror {sides[row]:g}; expected 1 or -1 (turned over about its long axis)")
        if (sides[row] == -1) != turned:
            raise table.error(row, f"segment {segment}: mirror {sides[row]:g} among others; name a segment of its own")


def read_mirror_profile(path: Path | str) -> Array:
    """(k, 2) calibrated form of a mirror, rising distance from its start and height, m, from a CSV file.

    Raises:
        InputError: what `read_table` raises, or distances that do not rise.
    """
    table = read_table(path, [[Column("distance_mm", LENGTH), Column("height_um", LINEAR_ERROR)]])
    distance = table.numbers["distance_mm"]
    table.refuse(
        np.diff(distance, prepend=-np.inf) <= 0,
        lambda row: f"distance {distance[row] * 1e3:g} mm after {distance[row - 1] * 1e3:g} mm; they must rise",
    )
    return np.stack([distance, table.numbers["height_um"]], axis=1)


def _check_pass(table: Table, rows: list[int], positions: Array, directions: Array, name: str) -> None:
    for k, direction in enumerate(directions):
        if direction not in (1, -1):
            raise table.error(rows[k], f"{name}: direction {direction:g}; expected 1 or -1")
        if direction != directions[0]:
            turned = f"direction {direction:g} after {directions[0]:g}"
            raise table.error(rows[k], f"{name}: {turned}; the way back is a run of its own, with a number of its own")
    steps = np.diff(positions) * directions[0]
    if np.any(steps <= 0):
        at = int(np.argmax(steps <= 0))
        raise table.error(
            rows[at + 1],
            f"{name}: position {positions[at + 1] * 1e3:g} mm after {positions[at] * 1e3:g} mm does not go on in "
            f"direction {directions[0]:+g}",
        )
    if len(steps) > 2 and steps.max() > LEAST_GAP * np.median(steps):
        at = int(np.argmax(steps))
        raise table.error(
            rows[at + 1],
            f"{name}: a gap of {steps[at] * 1e3:g} mm before this sample, {np.median(steps) * 1e3:g} mm is usual; "
            f"are rows missing? Samples may be {LEAST_GAP:g} times as far apart as is usual, at most",
        )
