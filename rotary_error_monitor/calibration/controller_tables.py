"""Tables that controllers load: LinuxCNC's COMP_FILE for one axis, and a generic volumetric table.

A COMP_FILE holds one row a nominal position, with a value for travel in positive and one for travel in negative
direction, in mm or degrees, linear between rows. Type 0: where the axis is when it is sent to the nominal position; the
controller moves it by nominal minus that. Type 1: what the controller is to add.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import MOST_LINES, lines_of, read_text
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.units import ARCSEC

MOST_ROWS = 256
"""LinuxCNC refuses longer COMP_FILEs."""

LARGEST = {"linear": 5e-3, "rotary": math.radians(1.0)}
"""Compensation of an axis beyond which its file is another one than it is taken for, m and rad."""

MOST_POINTS = 100_000
"""Points of a volumetric table: each takes 4 kB while it is solved; controllers take some thousand."""


@dataclass(frozen=True)
class AxisCompensation:
    """Positioning error of one axis by direction of travel.

    Attributes:
        letter: the axis.
        rotary: True for rad, else m.
        positions: (n,) rising, m or rad.
        forward, backward: (n,) positioning error, m or rad.
        residue: largest difference between the machine's error and the table, linear between rows, m or rad.
    """

    letter: str
    rotary: bool
    positions: Array
    forward: Array
    backward: Array
    residue: float


def predict_axis_compensation(machine: MachineDescription, letter: str, rows: int = MOST_ROWS) -> AxisCompensation:
    """Positioning error of an axis over its travel, reversal error included, at the reference temperature.

    Rows lie where a measured table has them if there are few enough, else evenly over the travel.

    Raises:
        InputError: no such axis, or more rows than a COMP_FILE takes, or fewer than two.
    """
    if not 2 <= rows <= MOST_ROWS:
        raise InputError(f"{rows} rows; a COMP_FILE takes from 2 to {MOST_ROWS}")
    axis = machine.axis(letter)
    measured = _measured_positions(machine, axis)
    positions = measured if 2 <= len(measured) <= rows else np.linspace(*axis.travel, rows)
    dense = np.linspace(positions[0], positions[-1], 20 * MOST_ROWS)
    columns, residue = [], 0.0
    for direction in (1.0, -1.0):
        at_rows, at_dense = (_own_error(machine, axis, q, direction) for q in (positions, dense))
        columns.append(at_rows)
        residue = max(residue, float(np.abs(np.interp(dense, positions, at_rows) - at_dense).max()))
    return AxisCompensation(letter, axis.kind == "rotary", positions, columns[0], columns[1], residue)


def _measured_positions(machine: MachineDescription, axis: Axis) -> Array:
    """Rising positions of the tables of an axis' positioning error; none where something beside tables is in it."""
    components = [machine.errors[name] for name in axis.positioning_shares if name in machine.errors]
    if any(each.table is None or each.poly or each.harmonic for each in components):
        return np.empty(0)
    tables = [each.table.positions for each in components if each.table is not None]
    return np.unique(np.concatenate([*tables, np.empty(0)]))


def _own_error(machine: MachineDescription, axis: Axis, q: Array, direction: float) -> Array:
    """(n,) errors of an axis along its own direction at positions (n,), by direction of travel, m or rad."""
    number, first = machine.letters.index(axis.letter), 0 if axis.kind == "linear" else 3
    positions = np.zeros((len(machine.axes), len(q)))
    positions[number] = q
    errors = arrange_components(machine).at(positions, np.full_like(positions, direction), None)
    along: Array = np.array(axis.direction) @ errors[first : first + 3, number]
    return along


def comp_file(compensation: AxisCompensation, kind: Literal[0, 1]) -> str:
    """Content of a COMP_FILE of that type (`COMP_FILE_TYPE` in the ini file): nominal, forward, backward; mm or deg.

    Raises:
        InputError: more rows than LinuxCNC takes, a number that is not finite, or an unknown type.
    """
    if kind not in (0, 1):
        raise InputError(f"COMP_FILE_TYPE {kind}; there are 0 (positions) and 1 (trims)")
    if len(compensation.positions) > MOST_ROWS:
        raise InputError(f"{len(compensation.positions)} rows; LinuxCNC takes at most {MOST_ROWS} in a COMP_FILE")
    scale = 180 / math.pi if compensation.rotary else 1e3
    nominal = compensation.positions * scale
    errors = np.stack([compensation.forward, compensation.backward], axis=1) * scale
    columns = nominal[:, None] + errors if kind == 0 else -errors
    if not np.all(np.isfinite(columns)):
        raise InputError(f"positioning error of axis {compensation.letter} is not finite")
    rows = (f"{q:.9f} {forward:.9f} {backward:.9f}" for q, (forward, backward) in zip(nominal, columns, strict=True))
    return "\n".join(rows) + "\n"


def read_comp_file(path: Path, axis: Axis, kind: Literal[0, 1]) -> AxisCompensation:
    """The positioning error that a COMP_FILE of that type takes out.

    Raises:
        InputError: there is no such file, it has fewer than 2 rows or more than LinuxCNC takes, or a row that is no
            three numbers, rises not, or cannot be in mm or degrees; the message names the line.
    """
    rows: list[list[float]] = []
    rotary, unit = axis.kind == "rotary", "degrees" if axis.kind == "rotary" else "mm"
    scale = math.pi / 180 if rotary else 1e-3
    text = read_text(path, "a COMP_FILE", most_lines=MOST_LINES)
    for number, line in enumerate(lines_of(text), start=1):
        if not line.strip():
            continue
        row = _numbers(line)
        if row is None:
            raise InputError(
                f"{path}:{number}: {excerpt(line.strip())}; expected nominal position, value for travel in positive "
                f"and in negative direction, in {unit}, with spaces between"
            )
        trims = row[1:] if kind == 1 else [value - row[0] for value in row[1:]]
        if max(map(abs, trims)) * scale > LARGEST[axis.kind]:
            raise InputError(
                f"{path}:{number}: it moves the axis by {max(trims, key=abs):g} {unit}; is the file of COMP_FILE_TYPE "
                f"{1 - kind}, or of another unit?"
            )
        if rows and row[0] <= rows[-1][0]:
            raise InputError(f"{path}:{number}: {row[0]:g} after {rows[-1][0]:g} {unit}; nominal positions must rise")
        rows.append(row)
    if not 2 <= len(rows) <= MOST_ROWS:
        raise InputError(f"{path}: {len(rows)} rows; a COMP_FILE has 2 to {MOST_ROWS}")
    found = np.array(rows) * scale
    errors = -found[:, 1:] if kind == 1 else found[:, 1:] - found[:, :1]
    return AxisCompensation(axis.letter, rotary, found[:, 0], errors[:, 0], errors[:, 1], 0.0)


def _numbers(line: str) -> list[float] | None:
    """Three finite numbers of a line; None where it has others."""
    try:
        values = [float(word) for word in line.split()]
    except ValueError:
        return None
    return values if len(values) == 3 and all(map(math.isfinite, values)) and "_" not in line else None


@dataclass(frozen=True)
class CompensationChange:
    """How far two compensations of an axis are apart.

    Attributes:
        largest: difference of the positioning errors where it is largest, later less earlier, m or rad.
        position: there, m or rad.
        direction: there, 1 or -1.
        rms: root mean square over the travel of the later one, both directions, m or rad.
        uncovered: part of that travel in which the earlier one has no rows.
        rotary: True for rad.
    """

    largest: float
    position: float
    direction: int
    rms: float
    uncovered: float
    rotary: bool


def compare_compensations(before: AxisCompensation, after: AxisCompensation) -> CompensationChange:
    """What changed over the rows of the later one: linear between rows, constant beyond them, as LinuxCNC has it."""
    low, high = after.positions[0], after.positions[-1]
    inside = before.positions[(before.positions >= low) & (before.positions <= high)]
    corners = np.union1d(after.positions, inside)
    apart = np.stack(
        [
            np.interp(corners, after.positions, new) - np.interp(corners, before.positions, old)
            for new, old in ((after.forward, before.forward), (after.backward, before.backward))
        ]
    )
    way, place = np.unravel_index(int(np.argmax(np.abs(apart))), apart.shape)
    # of a course linear between its corners the square has this mean between two of them (Simpson)
    squares = (apart[:, :-1] ** 2 + apart[:, :-1] * apart[:, 1:] + apart[:, 1:] ** 2) / 3
    rms = math.sqrt(float((squares * np.diff(corners)).sum() / (2 * (high - low))))
    covered = max(0.0, min(high, before.positions[-1]) - max(low, before.positions[0]))
    return CompensationChange(
        float(apart[way, place]),
        float(corners[place]),
        1 if way == 0 else -1,
        rms,
        1 - covered / float(high - low),
        after.rotary,
    )


def volumetric_table(machine: MachineDescription, counts: Mapping[str, int]) -> str:
    """A table of axis corrections over a grid of axes, as CSV: positions, then what each axis is to add.

    Columns X_mm … C_deg …, then dX_um … dC_arcsec …; the first axis changes slowest. `counts` has the number of grid
    points by axis letter; the other axes stand at 0, or at the end of their travel that is nearest to 0. Corrections
    are those of the exact model: they put the tool where the ideal machine has it.

    Raises:
        InputError: no grid axis, one that the machine lacks, fewer than two points, more than `MOST_POINTS` in all, or
            a pose without correction.
    """
    if not counts or min(counts.values()) < 2:
        raise InputError(f"grid {dict(counts)}; expected two points or more of at least one axis")
    if (points := math.prod(counts.values())) > MOST_POINTS:
        raise InputError(f"a grid of {points:.7g} points; at most {MOST_POINTS} are solved, give fewer along an axis")
    lines = {letter: np.linspace(*machine.axis(letter).travel, count) for letter, count in counts.items()}
    grids = np.meshgrid(*(lines.get(axis.letter, np.array([axis.home])) for axis in machine.axes), indexing="ij")
    positions = np.stack([grid.ravel() for grid in grids], axis=1)
    result = solve_axis_corrections(arrange_machine(machine), positions)
    if not result.converged.all():
        pose = ", ".join(f"{q:g}" for q in positions[int(np.argmin(result.converged))])
        raise InputError(f"no correction at {', '.join(machine.letters)} = {pose}; narrow the grid")
    where = np.array([axis.shown[0] for axis in machine.axes])
    what = np.array([1e6 if axis.kind == "linear" else ARCSEC for axis in machine.axes])
    header = [f"{axis.letter}_{axis.shown[1]}" for axis in machine.axes]
    header += [f"d{a.letter}_{'um' if a.kind == 'linear' else 'arcsec'}" for a in machine.axes]
    rows = np.concatenate([positions * where, result.corrections * what], axis=1) + 0.0
    return "\n".join([",".join(header), *(",".join(f"{value:.6f}" for value in row) for row in rows)]) + "\n"
