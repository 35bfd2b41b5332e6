"""Poses of a machine from CSV files and bags: those of a program, and those at which a probe told the deviation.

Headers (columns in any order):
    program  X_mm,Y_mm,…,C_deg,… and if known X_direction,…,temperature_degC
    probed   X_mm,Y_mm,…,C_deg,…,temperature_degC,dx_um,dy_um,dz_um; directions as X_direction, … if known
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.calibration.copies import refuse_copies
from rotary_error_monitor.calibration.identification import ProbedPoses
from rotary_error_monitor.calibration.known_readings import ReadingPlace
from rotary_error_monitor.calibration.measurements import ANGLE, LENGTH, LINEAR_ERROR, TRAVEL_SLACK
from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.topics import pose_topics
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.machine.kinematics import arrange_machine, axis_columns, stand
from rotary_error_monitor.metrology.positioning import PositioningRuns
from rotary_error_monitor.metrology.unread_temperature import believed_readings

SAME_POSITION = 1e-6
"""Commanded positions nearer than this are the same, m or rad."""

LEAST_LEVER = 0.05
"""Least distance of the tool tip from a rotary axis whose angle it shows, m: a micrometre is 20 µrad there."""


@dataclass(frozen=True)
class Poses:
    """Commanded poses of a machine.

    Attributes:
        positions: (n, axes) m or rad.
        direction: (n, axes) sign of the travel by which each position was reached, 0 where unknown.
        temperature: (n,) °C.
    """

    positions: Array
    direction: Array
    temperature: Array

    def __len__(self) -> int:
        """How many there are."""
        return len(self.positions)


def read_poses(path: Path, machine: MachineDescription) -> Poses:
    """Poses of a program for a machine, from a CSV file.

    Without their columns directions are unknown, and the temperature is the machine's reference temperature.

    Raises:
        InputError: what `read_table` raises, a pose beyond the travel, or a direction that is none.
    """
    axes, ways = _axis_columns(machine)
    warmth = [Column("temperature_degC", 200.0)]
    names = ",".join(column.name for column in axes)
    expected = f"{names}, and if known {','.join(column.name for column in ways)} and {warmth[0].name}"
    table = read_table(path, [axes, [*axes, *ways], [*axes, *warmth], [*axes, *ways, *warmth]], expected)
    return _poses_of(table, machine, path)


def read_probed_poses(
    path: Path | str, machine: MachineDescription, noise: float, layout: ColumnLayout | None = None
) -> ProbedPoses:
    """Poses and the tool's deviation at each, from a bag (a folder or an mcap file) or a CSV file.

    A pose that has no temperature, or one beyond the machine's limits, has that between its neighbours; where no pose
    has one it is the reference. What was beyond the limits is among the remarks.

    `noise` is the standard deviation of one component of a deviation, m.

    Raises:
        InputError: the file or bag cannot be read, lacks an axis of the machine, or has poses without a probe.
    """
    path = Path(path)
    if layout is None and path.suffix != ".csv":
        return _poses_of_bag(path, machine, noise)
    return _poses_of_table(path, machine, noise, layout)


def _axis_columns(machine: MachineDescription) -> tuple[list[Column], list[Column]]:
    """Columns of a table that holds poses: X_mm of a linear axis, C_deg of a rotary one, and X_direction of either."""
    axes = [Column(f"{a.letter}_{a.shown[1]}", LENGTH if a.kind == "linear" else ANGLE) for a in machine.axes]
    return axes, [Column(f"{letter}_direction") for letter in machine.letters]


def _poses_of(table: Table, machine: MachineDescription, path: Path) -> Poses:
    """The poses of a table, of which directions and temperature may be absent."""
    axes, ways = _axis_columns(machine)
    positions = np.stack([table.numbers[column.name] for column in axes], axis=1)
    for row, pose in enumerate(positions):
        check_within_travel(f"{path}:{table.lines[row]}", machine, pose)
    return Poses(
        positions,
        _directions_of(table, ways) if ways[0].name in table.numbers else np.zeros_like(positions),
        table.numbers.get("temperature_degC", np.full(len(positions), machine.reference_temperature)),
    )


def _poses_of_table(path: Path, machine: MachineDescription, noise: float, layout: ColumnLayout | None) -> ProbedPoses:
    axes, ways = _axis_columns(machine)
    rest = [Column("temperature_degC", 200.0), *(Column(f"d{letter}_um", LINEAR_ERROR) for letter in "xyz")]
    table = read_table(path, [[*axes, *ways, *rest], [*axes, *rest]], layout=layout)
    poses = _poses_of(table, machine, path)
    deviations = np.stack([table.numbers[column.name] for column in rest[1:]], axis=1)
    named = {f"pose {row + 1}": [row] for row in range(len(deviations))}
    refuse_copies(table, named, np.concatenate([poses.positions, poses.direction], axis=1), deviations, noise)
    temperature, remarks = _temperatures(poses.temperature, machine)
    return ProbedPoses(poses.positions, poses.direction, temperature, deviations, noise, remarks, table.lines)


def _directions_of(table: Table, columns: Sequence[Column]) -> Array:
    """(n, axes) directions of travel from these columns of a table.

    Raises:
        InputError: one of them is other than 1, -1 and 0.
    """
    direction = np.stack([table.numbers[column.name] for column in columns], axis=1)
    for row, axis in np.argwhere(~np.isin(direction, (-1, 0, 1)))[:1]:
        raise table.error(row, f"{columns[axis].name} {direction[row, axis]:g}; expected 1, -1, or 0 where unknown")
    return direction


def _poses_of_bag(path: Path, machine: MachineDescription, noise: float) -> ProbedPoses:
    reader = BagReader(path)
    pose, tool_probe, thermometer = pose_topics()
    reader.check_topics([pose, tool_probe])
    contents = reader.read([name for name in (pose, tool_probe, thermometer) if name in reader.topics])
    joints = {content.stamp_ns: content for content in contents[pose]}
    warmth = {
        each.stamp_ns: each.temperature for each in contents.get(thermometer, []) if isinstance(each, Temperature)
    }
    rows: list[tuple[Array, Array, float, Array]] = []
    for probe in contents[tool_probe]:
        assert isinstance(probe, PointStamped)
        if not np.all(np.abs(probe.point) <= LINEAR_ERROR):
            raise InputError(
                f"{path}: {tool_probe}, stamp {probe.stamp_ns} ns: deviation {probe.point.tolist()} m is beyond "
                f"±{LINEAR_ERROR:g} m: is it in m, and minus the ideal position?"
            )
        position, direction = _axes_of(joints.get(probe.stamp_ns), machine, f"{path}: probe at {probe.stamp_ns} ns")
        rows.append((position, direction, warmth.get(probe.stamp_ns, np.nan), probe.point))
    positions, directions, read, deviations = (np.array(column) for column in zip(*rows, strict=True))
    temperature, remarks = _temperatures(read, machine)
    return ProbedPoses(positions, directions, temperature, deviations, noise, remarks)


def _temperatures(read: Array, machine: MachineDescription) -> tuple[Array, tuple[str, ...]]:
    """(n,) temperature of each pose of readings (n,) that may be nan, and what was not believed of these."""
    believed, doubt = believed_readings(read, machine.limits.temperature)
    there, number = np.isfinite(believed), np.arange(len(read))
    filled = (
        np.interp(number, number[there], believed[there])
        if there.any()
        else np.full(len(read), machine.reference_temperature)
    )
    return filled, (doubt,) if doubt else ()


def _axes_of(state: Content | None, machine: MachineDescription, where: str) -> tuple[Array, Array]:
    if not isinstance(state, JointState):
        raise InputError(f"{where}: no {pose_topics()[0]} with the same stamp")
    missing = [letter for letter in machine.letters if letter not in state.names]
    if missing:
        raise InputError(
            f"{where}: no position of axis {', '.join(missing)}; the joint state names {', '.join(state.names)}"
        )
    order = [state.names.index(letter) for letter in machine.letters]
    check_within_travel(where, machine, state.position[order])
    direction = np.sign(state.velocity[order]) if len(state.velocity) else np.zeros(len(order))
    return state.position[order], direction


def check_within_travel(where: str, machine: MachineDescription, pose: Array) -> None:
    """Hold that a pose (axes,), m or rad, is one that the machine can take; `where` it was given, for the message.

    Raises:
        InputError: an axis is beyond its travel.
    """
    for axis, value in zip(machine.axes, pose, strict=True):
        low, high = axis.travel
        slack = TRAVEL_SLACK * (high - low)
        if not low - slack <= value <= high + slack:
            scale, unit = axis.shown[0], "mm" if axis.kind == "linear" else "degrees"
            raise InputError(
                f"{where}: axis {axis.letter} at {value * scale:g} {unit} is beyond its travel, {low * scale:g} to "
                f"{high * scale:g} {unit}: is it in another unit?"
            )


def read_positioning_poses(
    path: Path | str, machine: MachineDescription, letter: str
) -> tuple[PositioningRuns, ReadingPlace]:
    """Bidirectional runs of one axis from a bag of probed poses in which no other axis moves, and where it stood.

    The deviation is the tool's along the way that the axis moves it; of a rotary axis, over the tool's distance from
    the axis, so that what moves the tool along besides (radial error motions, a displaced axis) counts in. The cycle is
    how often the axis has come to the target from that side.

    Raises:
        InputError: what `read_probed_poses` raises, another axis that moves, an unknown direction, or a tool tip too
            near to the axis of rotation.
    """
    axis, number = machine.axis(letter), machine.letters.index(letter)
    poses = read_probed_poses(path, machine, 1e-6)
    others = np.delete(poses.positions, number, axis=1)
    if np.ptp(others, axis=0).max(initial=0.0) > SAME_POSITION:
        raise InputError(f"{path}: other axes than {letter} move; a positioning test moves one axis")
    if np.any(poses.direction[:, number] == 0):
        at = int(np.argmax(poses.direction[:, number] == 0))
        raise InputError(f"{path}: pose {at + 1} does not say from which side axis {letter} came (velocity +1 or -1)")
    targets, place = np.unique(np.round(poses.positions[:, number] / SAME_POSITION), return_inverse=True)
    deviations = _own_deviations(path, machine, number, poses)
    runs: dict[int, Array] = {}
    for sign in (1, -1):
        rows = [deviations[(place == k) & (poses.direction[:, number] == sign)] for k in range(len(targets))]
        runs[sign] = np.full((len(targets), max(len(row) for row in rows)), np.nan)
        for values, row in zip(runs[sign], rows, strict=True):
            values[: len(row)] = row
    with told_of(path):
        backward = runs[-1] if runs[-1].size else None
        found = PositioningRuns(targets * SAME_POSITION, runs[1], backward, axis.kind == "rotary")
    stood = dict(zip(machine.letters, map(float, poses.positions[0]), strict=True))
    return found, ReadingPlace(stood, temperature=float(poses.temperature.mean()), whole=True)


def _own_deviations(path: Path | str, machine: MachineDescription, number: int, poses: ProbedPoses) -> Array:
    """(n,) deviations as one axis alone would have to move to make them, m or rad."""
    model = arrange_machine(machine)
    along = axis_columns(model, stand(model, poses.positions.T, None))[0][:, number].T
    square = (along**2).sum(axis=1)
    if square.min() < LEAST_LEVER**2:
        raise InputError(
            f"{path}: the tool tip is {math.sqrt(square.min()) * 1e3:.1f} mm from axis {machine.letters[number]}, too "
            f"near to see its angle; probe at {LEAST_LEVER * 1e3:g} mm or more, or give a CSV file of deviations"
        )
    return np.asarray((poses.deviations * along).sum(axis=1) / square, dtype=np.float64)
