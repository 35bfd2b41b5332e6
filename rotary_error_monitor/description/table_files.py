"""CSV files beside a stage file with measured curves of ring and mirror, which the stage file names."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.description.periodic_tables import FEWEST, MOST, WHOLE, problems
from rotary_error_monitor.description.quantities import LARGEST_TILT
from rotary_error_monitor.description.sections import place_named
from rotary_error_monitor.description.yaml_files import YamlContent
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists
from rotary_error_monitor.units import TURN

GRADUATION = ("encoder", "graduation_table")
FLATNESS = ("mirror", "flatness_table")

COLUMNS: Mapping[tuple[str, str], Mapping[str, str]] = {
    GRADUATION: {"graduation": "values"},
    FLATNESS: {"tilt_x": "x", "tilt_y": "y"},
}
"""Where a section may name a file: its columns, without their units, by the fields of the table that they are."""

_ANGLES, _UNITS = ("deg", "rad"), ("arcsec", "urad", "mrad", "rad")

_LARGEST_DOUBT = 1e-3
"""Standard uncertainty, rad, above which the unit must be wrong: that of no value that is subtracted."""


def with_tables(found: YamlContent, name: str) -> YamlContent:
    """What a file holds, with each table that its section `name` gives as `{file: …}` read from that file.

    A name is taken relative to the folder of the file that holds it.

    Raises:
        InputError: a file is named beside other numbers, cannot be read, or holds no such table; it names file and
            line.
    """
    section = found.content.get(name) if isinstance(found.content, Mapping) else None
    if not isinstance(section, Mapping):
        return found
    content = dict(section)
    for place, columns in COLUMNS.items():
        part, field = place
        above = content.get(part)
        stated = above.get(field) if isinstance(above, Mapping) else None
        if not isinstance(stated, Mapping) or "file" not in stated:
            continue
        where = place_named(found, (name, *place))
        if set(stated) != {"file"} or not isinstance(stated["file"], str) or not stated["file"]:
            expected = f"{{file: NAME.csv}} or {{angles, {', '.join(columns.values())}, uncertainties}}"
            raise InputError(f"{where}: {excerpt(dict(stated))}; expected: {expected}")
        content[part] = {**content[part], field: read_curve(Path(found.origin).parent / stated["file"], place, where)}
    return replace(found, content={**found.content, name: content})


def read_curve(path: Path, place: tuple[str, str], where: str = "") -> dict[str, Any]:
    """Fields of a table from a CSV file; `where` it is named goes before what is wrong with the file as a whole.

    Raises:
        InputError: there is no such file, or its rows are no curve over one turn; it names file and line.
    """
    columns = COLUMNS[place]
    lead = f"{where}: " if where else ""
    if not (exists(path) and path.is_file()):
        raise InputError(f"{lead}{path}: no such file; expected a CSV file, its name relative to the stage file")
    table = read_table(path, _choices(tuple(columns)), _expected(tuple(columns)))
    fields = {_plain(name): values for name, values in table.numbers.items()}
    count = len(table.lines)
    if not FEWEST <= count <= MOST + 1:
        raise InputError(f"{path}: {count} rows; expected {FEWEST} to {MOST} angles over a turn")
    doubts = fields.get("uncertainty", np.zeros(0))
    table.refuse(doubts < 0, lambda row: "a standard uncertainty below 0")
    read: dict[str, Any] = {"angles": fields["angle"].tolist()}
    read |= {field: fields[name].tolist() for name, field in columns.items()}
    if doubts.size:
        read["uncertainties"] = doubts.tolist()
    _check(table, read, tuple(columns.values()))
    return read


def _check(table: Table, read: Mapping[str, list[float]], fields: Sequence[str]) -> None:
    columns = {field: tuple(read[field]) for field in fields}
    for row, problem in problems(read["angles"], columns, read.get("uncertainties", ())):
        raise table.error(row, problem)


def _plain(name: str) -> str:
    """The name of a column without its unit."""
    return name.rpartition("_")[0]


def _choices(values: tuple[str, ...]) -> list[list[Column]]:
    """Sets of columns: angle, values of one unit, and their uncertainty or not."""
    largest = {"deg": TURN + WHOLE, "rad": TURN + WHOLE}
    doubts = [None, *(Column(f"uncertainty_{unit}", _LARGEST_DOUBT) for unit in _UNITS)]
    return [
        [
            Column(f"angle_{angle}", largest[angle]),
            *(Column(f"{value}_{unit}", LARGEST_TILT) for value in values),
            *([] if doubt is None else [doubt]),
        ]
        for angle, unit, doubt in itertools.product(_ANGLES, _UNITS, doubts)
    ]


def _expected(values: tuple[str, ...]) -> str:
    header = ",".join(f"{value}_arcsec" for value in values)
    return (
        f"angle_deg,{header} and, if it is known, uncertainty_arcsec (angle_rad, and {', '.join(_UNITS)} for the "
        "others, do as well)"
    )
