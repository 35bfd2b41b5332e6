"""Poses of a program, from a CSV file: X_mm, …, C_deg, …, and if known X_direction, …, temperature_degC."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.measurements import axis_columns_of, check_within_travel, directions_of
from rotary_error_monitor.description.csv_tables import Column, read_table
from rotary_error_monitor.description.machine import MachineDescription


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
    """Poses of a machine from a CSV file.

    Without their columns directions are unknown, and the temperature is the machine's reference temperature.

    Raises:
        InputError: what `read_table` raises, a pose beyond the travel, or a direction that is none.
    """
    axes = axis_columns_of(machine)
    ways = [Column(f"{letter}_direction") for letter in machine.letters]
    warmth = [Column("temperature_degC", 200.0)]
    names = ",".join(column.name for column in axes)
    expected = f"{names}, and if known {','.join(column.name for column in ways)} and {warmth[0].name}"
    table = read_table(path, [axes, [*axes, *ways], [*axes, *warmth], [*axes, *ways, *warmth]], expected)
    positions = np.stack([table.numbers[column.name] for column in axes], axis=1)
    for row, pose in enumerate(positions):
        check_within_travel(f"{path}:{table.lines[row]}", machine, pose)
    return Poses(
        positions,
        directions_of(table, ways) if ways[0].name in table.numbers else np.zeros_like(positions),
        table.numbers.get(warmth[0].name, np.full(len(positions), machine.reference_temperature)),
    )
