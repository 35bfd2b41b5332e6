"""Steps of a reference before the autocollimator, from a CSV file.

Columns, in any order: `reference_x_UNIT`, `reference_y_UNIT`, and what the instrument reads: `tilt_x_UNIT`,
`tilt_y_UNIT`, or `q1_V` to `q4_V`, the voltages of the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y). Tilts are
about x and y. `step` names the visit of the reference that a reading is of; without it each change of the reference
begins another. `time_s` is when it was taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.metrology.tilt import tilt_from_quadrants
from rotary_error_monitor.metrology.two_axis_steps import StepReadings

UNITS = ("arcsec", "urad", "mrad", "rad", "deg")
LARGEST = 0.1
"""Half of the largest range that a stage file may state, rad."""

VOLTAGES = ("q1_V", "q2_V", "q3_V", "q4_V")
MOST_STEPS = 500
"""Steps: a thousand equations at once take seconds, and calibrations have some dozen."""

EXPECTED = (
    "reference_x_UNIT,reference_y_UNIT with tilt_x_UNIT,tilt_y_UNIT or q1_V,q2_V,q3_V,q4_V, and step and time_s if "
    f"known (UNIT one of {', '.join(UNITS)})"
)


@dataclass(frozen=True)
class Quadrants:
    """How the four voltages become a tilt, as the settings `iio.sensitivity` and `iio.dark` of the node say.

    Attributes:
        sensitivity: tilt per normalised difference, rad.
        dark: (4,) voltages without light, V.
    """

    sensitivity: float = 5e-4
    dark: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


def read_steps(path: Path, quadrants: Quadrants, layout: ColumnLayout | None = None) -> tuple[StepReadings, bool]:
    """Steps in the order of the file, and whether the readings are voltages.

    Raises:
        InputError: what `read_table` raises, a step that comes again or has two settings, times that go back, voltages
            without light, or too many steps.
    """
    table = read_table(path, list(_choices()), EXPECTED, layout)
    reference = _pair(table, "reference")
    names, step = _steps(table, reference)
    if len(names) > MOST_STEPS:
        raise InputError(f"{path}: {len(names)} steps; expected {MOST_STEPS} at most: let the reference stand a while")
    times = table.numbers.get("time_s")
    if times is not None:
        table.refuse(
            np.diff(times, prepend=-np.inf) < 0,
            lambda row: f"time {times[row]:g} s after {times[row - 1]:g} s; expected rows in order of time",
        )
    first = np.concatenate([[0], np.flatnonzero(np.diff(step)) + 1])
    voltages = VOLTAGES[0] in table.numbers
    readings = _from_voltages(table, quadrants) if voltages else _pair(table, "tilt")
    return StepReadings(names, reference[first], step, readings, times, table.lines), voltages


def _choices() -> Iterator[list[Column]]:
    for unit, own, *more in product(UNITS, (*UNITS, ""), ((), ("time_s",)), ((), ("step",))):
        names = [f"reference_{axis}_{unit}" for axis in "xy"]
        names += [f"tilt_{axis}_{own}" for axis in "xy"] if own else []
        columns = [Column(name, LARGEST) for name in names]
        columns += [] if own else [Column(name) for name in VOLTAGES]
        yield [*columns, *(Column(name, text=name == "step") for rest in more for name in rest)]


def _pair(table: Table, what: str) -> Array:
    """(n, 2) rad."""
    names = [next(name for name in table.numbers if name.startswith(f"{what}_{axis}_")) for axis in "xy"]
    return np.stack([table.numbers[name] for name in names], axis=1)


def _steps(table: Table, reference: Array) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of the steps, and (n,) which of them each reading is of."""
    same = np.all(np.diff(reference, axis=0, prepend=reference[:1]) == 0, axis=1)
    words = table.words.get("step")
    if words is None:
        step = np.cumsum(~same).astype(np.int64)
        return tuple(str(number + 1) for number in range(int(step[-1]) + 1)), step
    first: dict[str, int] = {}
    for row, word in enumerate(words):
        if row and word == words[row - 1]:
            if not same[row]:
                raise table.error(
                    row,
                    f"step '{excerpt(word)}' has another reference than on the line before; expected "
                    "one in all of a step, and a name of its own for each step",
                )
        elif word in first:
            line = table.lines[first[word]]
            raise table.error(
                row,
                f"step '{excerpt(word)}' comes again, first on line {line}; expected a name of its "
                "own for each visit of the reference",
            )
        first.setdefault(word, row)
    number = {word: index for index, word in enumerate(first)}
    return tuple(first), np.array([number[word] for word in words], dtype=np.int64)


def _from_voltages(table: Table, quadrants: Quadrants) -> Array:
    voltages = np.stack([table.numbers[name] for name in VOLTAGES], axis=1)
    dark = np.array(quadrants.dark)
    light = (voltages - dark).sum(axis=1)
    if not (light > 0).all():
        row = int(np.argmin(light))
        raise table.error(row, f"voltages {voltages[row].tolist()} V hold no light above the dark {dark.tolist()} V")
    return tilt_from_quadrants(voltages, quadrants.sensitivity, dark)
