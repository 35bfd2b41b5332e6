"""Tables of measurements as CSV text: a header that names columns with their units, one row a reading.

Lines that begin with # are comments. What separates columns is what makes the header one that is expected: commas,
semicolons or tabs. Numbers have decimal points; where commas do not separate columns they may be decimal. Every error
names file and line.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.column_layout import (
    SCALES,
    SEPARATORS,
    ColumnLayout,
    cells_of,
    plain_name,
    with_points,
)
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import lines_of, read_table_text

_SEPARATOR_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs"}


@dataclass(frozen=True)
class Column:
    """A column that a table may have.

    Attributes:
        name: such as deviation_um; the part after the last underscore is the unit, if it is one.
        largest: absolute value, in SI, above which the unit must be wrong.
        text: True for words instead of numbers.
    """

    name: str
    largest: float = math.inf
    text: bool = False

    @property
    def scale(self) -> float:
        """Factor to SI."""
        return 1.0 if plain_name(self.name) == self.name else SCALES[self.name.rpartition("_")[2]][1]


@dataclass(frozen=True)
class Table:
    """Rows of a file.

    Attributes:
        path: the file.
        numbers: (n,) values by column, SI.
        words: n texts by column.
        lines: (n,) line of each row, the first line of the file being 1.
    """

    path: Path
    numbers: Mapping[str, Array]
    words: Mapping[str, tuple[str, ...]]
    lines: NDArray[np.int64]

    def error(self, row: int, problem: str) -> InputError:
        """An error that says where in the file it is."""
        return InputError(f"{self.path}:{self.lines[row]}: {problem}")

    def refuse(self, wrong: NDArray[np.bool_], problem: Callable[[int], str]) -> None:
        """Hold that no row is wrong (n,); `problem` says what is so with a row.

        Raises:
            InputError: the first one that is.
        """
        if np.any(wrong):
            row = int(np.argmax(wrong))
            raise self.error(row, problem(row))


def read_table(
    path: Path | str, choices: Sequence[Sequence[Column]], expected: str = "", layout: ColumnLayout | None = None
) -> Table:
    """Table with one of the given sets of columns, in any order; `expected` says them in words where they are many.

    With a `layout` it is somebody else's table, whose columns it names.

    Raises:
        InputError: no such file, an empty one, a header that fits no choice, a row with too few or too many values, or
            a value that is no finite number or too large for its unit.
    """
    path, unit = Path(path), str if layout is None else layout.unit
    columns, rows = _own(path, choices, expected) if layout is None else _foreign(path, choices, layout)
    lines = np.array([number for number, _ in rows], dtype=np.int64)
    cells = {column.name: [row[column.name] for _, row in rows] for column in columns}
    return Table(
        path=path,
        numbers={
            c.name: _numbers(path, lines, replace(c, name=unit(c.name)), cells[c.name]) for c in columns if not c.text
        },
        words={c.name: tuple(cells[c.name]) for c in columns if c.text},
        lines=lines,
    )


Rows = list[tuple[int, dict[str, str]]]
"""Line, and cells by column, of each row of a table."""


def _own(path: Path, choices: Sequence[Sequence[Column]], expected: str) -> tuple[Sequence[Column], Rows]:
    """Columns and rows of a table whose header names one of the choices."""
    separator, rows = _rows(path, choices)
    expected = expected or " or ".join(",".join(column.name for column in columns) for columns in choices)
    if not rows:
        raise InputError(f"{path}:1: the file is empty; expected a header {expected} and rows below it")
    line, header = rows[0][0], [name.strip() for name in rows[0][1]]
    columns = next((c for c in choices if {column.name for column in c} == set(header)), None)
    if columns is None or len(set(header)) != len(header):
        raise InputError(f"{path}:{line}: header {excerpt(','.join(header))}; expected {expected}")
    if len(rows) == 1:
        raise InputError(f"{path}:{line}: a header and no row below it; expected one row for each reading")
    for number, values in rows[1:]:
        if len(values) != len(header):
            hint = _hint(len(values) - len(header), separator, values)
            count = f"{len(values)} value{'s' * (len(values) != 1)}"
            raise InputError(f"{path}:{number}: {count} where the header has {len(header)}{hint}")
    named = [(number, dict(zip(header, map(str.strip, values), strict=True))) for number, values in rows[1:]]
    if separator != ",":
        named = with_points(named, str(path), {column.name for column in columns if column.text})
    return columns, named


def _foreign(path: Path, choices: Sequence[Sequence[Column]], layout: ColumnLayout) -> tuple[Sequence[Column], Rows]:
    """Columns and rows of somebody else's table; columns that the layout has for one of the choices."""
    names = layout.chosen([[column.name for column in columns] for columns in choices])
    columns = next(c for c in choices if [column.name for column in c] == list(names))
    text = read_table_text(path, "a table of measurements")
    words = {plain_name(column.name) for column in columns if column.text}
    header, rows = layout.read(list(lines_of(text)), str(path), words)
    if not rows:
        raise InputError(f"{path}:{header}: a header and no row below it; expected one row for each reading")
    return columns, [(number, {c.name: row[plain_name(c.name)] for c in columns}) for number, row in rows]


def _rows(path: Path, choices: Sequence[Sequence[Column]]) -> tuple[str, list[tuple[int, list[str]]]]:
    """What separates columns, and line number and values of each row that is no comment and not empty.

    A row is a line.
    """
    text = read_table_text(path, "a CSV file")
    lines = [
        (number, line)
        for number, line in enumerate(lines_of(text), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    separator = _separator(lines[0][1], choices) if lines else ","
    rows = []
    for number, line in lines:
        try:
            rows += [(number, values) for values in csv.reader([line], delimiter=separator, strict=True)]
        except csv.Error as error:
            between = _SEPARATOR_NAMES[separator]
            raise InputError(
                f"{path}:{number}: {error}; expected values with {between} between, a row a line"
            ) from error
    return separator, rows


def _separator(header: str, choices: Sequence[Sequence[Column]]) -> str:
    """What separates the columns of a header so that it is one of the choices; a comma where nothing does."""
    known = [{column.name for column in columns} for columns in choices]
    return next((each for each in SEPARATORS if set(cells_of(header, each)) in known), ",")


def _hint(more: int, separator: str, values: Sequence[str]) -> str:
    """What may be wrong with a row that has `more` values than the header, or fewer."""
    if more > 0 and separator == ",":
        return "; write decimal points, not commas, or put semicolons between columns"
    other = next((each for each in SEPARATORS if each != separator and any(each in value for value in values)), "")
    if more < 0 and other:
        return f"; the header has {_SEPARATOR_NAMES[separator]} between columns, this row {_SEPARATOR_NAMES[other]}"
    return ""


def _numbers(path: Path, lines: NDArray[np.int64], column: Column, cells: list[str]) -> Array:
    for line, cell in zip(lines, cells, strict=True):
        _check_number(f"{path}:{line}", column.name, cell)
    values = np.array(cells, dtype=np.float64) * column.scale
    for wrong, problem in (
        (~np.isfinite(values), "is no finite number; drop that reading"),
        (np.abs(values) > column.largest, f"is beyond ±{column.largest / column.scale:g}: is it in another unit?"),
    ):
        if np.any(wrong):
            at = int(np.argmax(wrong))
            raise InputError(f"{path}:{lines[at]}: {column.name} {excerpt(cells[at])} {problem}")
    return values


def _check_number(where: str, name: str, cell: str) -> None:
    try:
        float(cell)
        is_number = "_" not in cell  # which Python reads over: 3_5 would be 35
    except ValueError:
        is_number = False
    if not is_number:
        hint = "is empty; drop that reading" if not cell else "is no number"
        if re.fullmatch(r"[+-]?\d+,\d*", cell):
            hint = "has a decimal comma; write a point"
        raise InputError(f"{where}: {name} '{excerpt(cell)}' {hint}")
