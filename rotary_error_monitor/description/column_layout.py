"""Which column of somebody else's table is what, and in which unit: for files as instruments write them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from rotary_error_monitor.errors import InputError, excerpt

SCALES: Mapping[str, tuple[str, float]] = {
    "m": ("length", 1.0),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "nm": ("length", 1e-9),
    "in": ("length", 0.0254),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "urad": ("angle", 1e-6),
    "deg": ("angle", math.pi / 180),
    "arcsec": ("angle", math.pi / 648000),
    "degC": ("temperature", 1.0),
}
"""Quantity of a unit and its factor to SI (temperatures stay in °C)."""

SEPARATORS = ",;\t"
"""What may stand between columns; where it is no comma, numbers may have decimal commas."""

BLANKS = " "
"""Any number of blanks, which may as well where there are no headers."""

_WITH_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_WITH_POINT = re.compile(r"[+-]?(\d+\.\d*|\.\d+)([eE][+-]?\d+)?")

_NUMBER = re.compile(r"#[1-9]\d{0,2}")
"""Number of a column without a header: instruments write tens of columns at most."""

COMMENTS = "#", "//"
"""What begins a comment in a list of points without headers."""

DIRECTIONS = {
    "+": "1",
    "forward": "1",
    "fwd": "1",
    "positive": "1",
    "-": "-1",
    "backward": "-1",
    "bwd": "-1",
    "reverse": "-1",
    "rev": "-1",
    "negative": "-1",
}
"""What instruments write for a direction of travel, in small letters."""


MICRO = "\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}"
"""Two characters that look alike, of which headers have one and keyboards the other."""


def plain_name(column: str) -> str:
    """The name of a column without the unit at its end, if there is one."""
    head, mark, unit = column.rpartition("_")
    return head if mark and unit in SCALES else column


@dataclass(frozen=True)
class ColumnLayout:
    """Columns of a table by what they are.

    Attributes:
        headers: what stands above each column, by the plain name of the column that it is; or, where nothing does, #
            and its number, the first being 1.
        units: units that the file has, by the same names; of those that are not here that of the package's own files.
    """

    headers: Mapping[str, str]
    units: Mapping[str, str]

    @classmethod
    def of(cls, words: Sequence[str]) -> ColumnLayout:
        """Layout from words such as `target=Pos,mm`.

        Raises:
            InputError: a word is none of these, or two are of one column.
        """
        headers: dict[str, str] = {}
        units: dict[str, str] = {}
        for word in words:
            name, mark, value = word.partition("=")
            header, comma, unit = value.replace(*MICRO).rpartition(",")
            if not comma or unit not in SCALES:
                header, unit = value.replace(*MICRO), ""
            if not mark or not name or not header:
                raise InputError(
                    f"--columns: '{excerpt(word)}'; expected what it is, =, the column's header and, after a comma, "
                    f"its unit ({', '.join(SCALES)}), such as target=Pos,mm"
                )
            if name in headers or header in headers.values():
                raise InputError(f"--columns: '{excerpt(word)}': {name} or {header} stands twice; give each once")
            headers[name] = header
            if unit:
                units[name] = unit
        if len({bool(_NUMBER.fullmatch(header)) for header in headers.values()}) > 1:
            raise InputError(
                "--columns: headers and numbers of columns are mixed; give headers, or # and a number for all"
            )
        return cls(headers, units)

    @property
    def numbered(self) -> bool:
        """Whether columns are told by their numbers, in a table without headers."""
        return all(_NUMBER.fullmatch(header) for header in self.headers.values())

    def chosen(self, choices: Sequence[Sequence[str]]) -> Sequence[str]:
        """Names of that set of columns, with their units, which the layout has all of.

        Raises:
            InputError: there is none, or a unit is of another quantity.
        """
        known = [{plain_name(name) for name in names} for names in choices]
        found = next((names for names, plain in zip(choices, known, strict=True) if plain == set(self.headers)), None)
        if found is None:
            sets = dict.fromkeys(", ".join(map(plain_name, names)) for names in choices)
            raise InputError(f"--columns names {', '.join(self.headers)}; expected {' or '.join(sets)}")
        for name in found:
            own, given = name.rpartition("_")[2], self.units.get(plain_name(name))
            if given is None:
                continue
            quantity = SCALES[own][0] if own in SCALES and plain_name(name) != name else "number without a unit"
            if SCALES[given][0] != quantity:
                fitting = [unit for unit, (kind, _) in SCALES.items() if kind == quantity]
                expected = f"one of {', '.join(fitting)}" if fitting else "none"
                raise InputError(
                    f"--columns: {plain_name(name)} is a {quantity}; its unit is not {given} but {expected}"
                )
        return found

    def unit(self, name: str) -> str:
        """The name of a column with the unit that the file has."""
        plain = plain_name(name)
        return f"{plain}_{self.units[plain]}" if plain in self.units else name

    def read(
        self, lines: Sequence[str], origin: str, words: Collection[str] = ()
    ) -> tuple[int, list[tuple[int, dict[str, str]]]]:
        """Number of the line with the headers, and below it the number and the cells of each row by plain name.

        Lines before the headers and empty ones are passed over, other columns left out; in a table without headers,
        comments and lines before the first that has all columns. Decimal commas become points where they do not
        separate columns, but in the columns of `words`; and words for a direction its sign.

        Raises:
            InputError: no line has all headers, a row has fewer columns than that, or numbers have decimal points as
                well as decimal commas; the message names the line.
        """
        header, separator, places = self._numbers(lines, origin) if self.numbered else self._header(lines, origin)
        rows = []
        for number, line in enumerate(lines[header:], start=header + 1):
            if not line.strip() or (self.numbered and line.lstrip().startswith(COMMENTS)):
                continue
            cells = cells_of(line, separator)
            if len(cells) <= max(places.values()):
                wanted = excerpt(", ".join(self.headers.values()))
                raise InputError(f"{origin}:{number}: {len(cells)} columns; expected one for each of {wanted}")
            row = {name: cells[place] for name, place in places.items()}
            rows.append((number, {name: _signed(name, cell) for name, cell in row.items()}))
        return header, rows if separator == "," else with_points(rows, origin, words)

    def _header(self, lines: Sequence[str], origin: str) -> tuple[int, str, dict[str, int]]:
        """Number of the line with the headers, what separates columns, and the place of each by its plain name."""
        for number, line in enumerate(lines, start=1):
            for separator in SEPARATORS:
                cells = cells_of(line, separator)
                if set(self.headers.values()) <= set(cells):
                    twice = [each for each in self.headers.values() if cells.count(each) > 1]
                    if twice:
                        raise InputError(f"{origin}:{number}: two columns are called {excerpt(twice[0])}; rename one")
                    return number, separator, {name: cells.index(each) for name, each in self.headers.items()}
        raise InputError(
            f"{origin}: no line has the headers {excerpt(', '.join(self.headers.values()))} that --columns names, "
            "separated by commas, semicolons or tabs; give them as the file has them"
        )

    def _numbers(self, lines: Sequence[str], origin: str) -> tuple[int, str, dict[str, int]]:
        """Number of the line before the first row, what separates columns, and the place of each by its plain name."""
        places = {name: int(header[1:]) - 1 for name, header in self.headers.items()}
        for number, line in enumerate(lines):
            if line.lstrip().startswith(COMMENTS):
                continue
            for separator in (*SEPARATORS, BLANKS):
                if len(cells_of(line, separator)) > max(places.values()):
                    return number, separator, places
        raise InputError(
            f"{origin}: no line has {max(places.values()) + 1} columns, which --columns asks for, separated by commas, "
            "semicolons, tabs or blanks"
        )


def cells_of(line: str, separator: str) -> list[str]:
    """Cells of a line without the blanks around them; none of one whose quotes do not end."""
    if separator == BLANKS:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line.replace(*MICRO)], delimiter=separator), [])]
    except csv.Error:  # of a line of words that is no row
        return []


def _signed(name: str, cell: str) -> str:
    """The cell; of a direction in words its sign."""
    return DIRECTIONS.get(cell.lower(), cell) if name.endswith("direction") else cell


def with_points(
    rows: Sequence[tuple[int, dict[str, str]]], origin: str, words: Collection[str] = ()
) -> list[tuple[int, dict[str, str]]]:
    """Number of the line and cells by name of each row, numbers with points where they had decimal commas.

    In columns of `words` commas stay.

    Raises:
        InputError: numbers have decimal points as well: a comma may then be one of thousands.
    """
    cells = [(line, cell) for line, row in rows for name, cell in row.items() if name not in words]
    comma = next(((line, cell) for line, cell in cells if _WITH_COMMA.fullmatch(cell)), None)
    point = next(((line, cell) for line, cell in cells if _WITH_POINT.fullmatch(cell)), None)
    if comma is None:
        return list(rows)
    if point is not None:
        raise InputError(
            f"{origin}:{comma[0]}: {excerpt(comma[1])} has a comma where {excerpt(point[1])} of line {point[0]} has a "
            "point; write all with decimal points, and none between thousands"
        )
    return [
        (line, {name: _pointed(cell) if name not in words else cell for name, cell in row.items()})
        for line, row in rows
    ]


def _pointed(cell: str) -> str:
    return cell.replace(",", ".") if _WITH_COMMA.fullmatch(cell) else cell
