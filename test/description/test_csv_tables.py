"""Tables that are none: each with file, line, and what is wrong in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.calibration.measurements import read_positioning
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.errors import InputError

COLUMNS = [Column("name", text=True), Column("height_um", 1e-3)]


def read(folder: Path, content: str | bytes) -> Table:
    path = folder / "heights.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_table(path, [COLUMNS])


def test_quotes_comments_and_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    table = read(tmp_path, '\ufeff# a comment\n"height_um",name\r\n\n1.5,"a, b"\n -2 , c\n')
    np.testing.assert_allclose(table.numbers["height_um"], [1.5e-6, -2e-6])
    assert table.words["name"] == ("a, b", "c")
    assert table.lines.tolist() == [4, 5]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('name,height_um\n"a,1\nb,2\n', "heights.csv:2: unexpected end of data; expected values with commas between"),
        ("name,height_um\na," + "1" * 200_000, "heights.csv:2: field larger than field limit"),
        ("name,height_um\na," + "1" * 20_000, "heights.csv:2: height_um 1{100} … 1{100} is no finite number"),
        ("name,height_um\na," + "x" * 20_000, "heights.csv:2: height_um 'x{100} … x{100}' is no number"),
        ("name,height_um\na,3_5", "heights.csv:2: height_um '3_5' is no number"),
        ("name,height_um\na,0x10", "heights.csv:2: height_um '0x10' is no number"),
        ("name,height_um\na,1\x00", r"heights.csv:2: height_um '1\\x00' is no number"),
        ("name,height_um\na,nan", "heights.csv:2: height_um nan is no finite number; drop that reading"),
        (
            "name;height_um\na;1,234\nb;5.5",
            "heights.csv:2: 1,234 has a comma where 5.5 of line 3 has a point; write all",
        ),
        ("name;height_um\na;1.234,5", "heights.csv:2: height_um '1.234,5' is no number"),
        (
            "name;height_um\na,1",
            "heights.csv:2: 1 value where the header has 2; the header has semicolons .* row commas",
        ),
        (
            "name,height_um\na;1",
            "heights.csv:2: 1 value where the header has 2; the header has commas .* row semicolons",
        ),
        (
            "name,height_um\na,1,5",
            "heights.csv:2: 3 values where the header has 2; write decimal points, not commas, or",
        ),
        ("name,height_um\na,1;5", "heights.csv:2: height_um '1;5' is no number"),
        ("x" * 5000 + "\n1\n", "heights.csv:1: header x{100} … x{100}; expected name,height_um"),
        (b"\xff\xfea\x00", "heights.csv:1: header a; expected name,height_um"),
        (b"name,height_um\xff\x00", r"heights.csv: cannot be read \(.*; give the path of a CSV file"),
    ],
)
def test_what_is_refused(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, content)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_what_makes_the_header_right_separates_columns(tmp_path: Path, separator: str, decimal: str) -> None:
    """As spreadsheets write them where commas are decimal; words keep their commas."""
    rows = ["# a; comment, of\tall", "name;height_um", "a b;1,5", "2,4;-,25e1", "c;3"]
    text = "\n".join(rows).replace(",", decimal).replace(";", separator)
    table = read(tmp_path, text)
    np.testing.assert_allclose(table.numbers["height_um"], [1.5e-6, -2.5e-6, 3e-6], rtol=1e-15)
    assert table.words["name"] == ("a b", f"2{decimal}4", "c")


def test_a_table_that_is_nearly_empty_is_no_repeated_run(tmp_path: Path) -> None:
    """Each reading at a target and in a cycle of its own: its table would have a gigabyte, and nothing to compare."""
    rows = (f"{k},1,{k},0.1" for k in range(20_000))
    path = tmp_path / "x.csv"
    path.write_text("target_mm,direction,cycle,deviation_um\n" + "\n".join(rows), encoding="utf-8")
    with pytest.raises(InputError, match=r"x.csv: 20000 readings at 20000 targets in 20000 cycles; each cycle"):
        read_positioning(path, rotary=False)
