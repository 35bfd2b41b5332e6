"""Text files of measurements, packed or not, up to a size."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import pytest

from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import read_table_text, read_text


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "µ\n" * 1000])
def test_packed_and_plain_text_are_read_alike(tmp_path: Path, text: str) -> None:
    (tmp_path / "plain").write_text(text, encoding="utf-8")
    (tmp_path / "packed").write_bytes(gzip.compress(text.encode()))
    assert read_text(tmp_path / "plain", "a text") == text
    assert read_text(tmp_path / "packed", "a text") == text


def test_members_one_after_another_are_one_text(tmp_path: Path) -> None:
    (tmp_path / "packed").write_bytes(gzip.compress(b"a,b\n") + gzip.compress(b"1,2\n") + bytes(512))
    assert read_text(tmp_path / "packed", "a text") == "a,b\n1,2\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (bytes(101), "larger than 100 bytes; a text is expected, of at most that size"),
        (gzip.compress(bytes(101)), "larger than 100 bytes"),
        (gzip.compress(bytes(60)) + gzip.compress(bytes(60)), "larger than 100 bytes"),
        (gzip.compress(b"a,b\n")[:-3], "cannot be unpacked (it ends too early); give the path of a text"),
        (gzip.compress(b"a,b\n") + b"more", "cannot be unpacked ("),
        (gzip.compress(b"a,b\n")[:10] + b"\xff" * 20, "cannot be unpacked ("),
        (b"\xff\xfe", "cannot be read ("),
    ],
)
def test_what_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "measured.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"measured\.csv: {re.escape(message)}"):
        read_text(path, "a text", 100)


def test_long_texts_are_shown_by_their_ends() -> None:
    assert excerpt("a" * 200) == "a" * 200
    assert excerpt("a" * 500 + "b" * 500) == "a" * 100 + " … " + "b" * 100
    assert excerpt(range(3)) == "range(0, 3)"


def test_texts_of_others_are_shown_in_one_line() -> None:
    assert excerpt("µ 5 °C\n[ERROR] fake\x1b[2K\u2028") == r"µ 5 °C\n[ERROR] fake\x1b[2K\u2028"
    assert excerpt("a\nb" * 100).isprintable()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "latin-1"])
def test_tables_as_spreadsheets_save_them(tmp_path: Path, encoding: str) -> None:
    text = "Größe;Error (µm)\n1,5;2\n" * 50
    (tmp_path / "plain").write_bytes(text.encode(encoding))
    (tmp_path / "packed").write_bytes(gzip.compress(text.encode(encoding)))
    assert read_table_text(tmp_path / "plain", "a table") == text
    assert read_table_text(tmp_path / "packed", "a table") == text


@pytest.mark.parametrize("content", [b"\xb5\x00\x01", b"\x89PNG\r\n\x81\x8d", b"\xff\xfea"])
def test_what_is_no_table_of_any_encoding(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "measured.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"measured\.csv: cannot be read \(.*\); give the path of a table"):
        read_table_text(tmp_path / "measured.csv", "a table")
