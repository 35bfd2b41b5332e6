"""The page doc/offset.md: its commands run in their order and print what it shows."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "doc" / "offset.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(sh|text)\n(.*?)```", PAGE, re.DOTALL)


def printed(command: str) -> str:
    name, *words = shlex.split(command)
    assert name == "rotary_error_monitor"
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        assert main(words) == 0, command
    return text.getvalue()


def test_commands_print_what_the_page_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "doc" / "examples", tmp_path / "doc" / "examples")
    monkeypatch.chdir(tmp_path)
    said, shown = "", 0
    for language, text in BLOCKS:
        if language == "sh":
            said = "".join(map(printed, text.splitlines()))
        else:
            assert [line for line in text.splitlines() if line not in said.splitlines()] == []
            shown += 1
    assert shown == 3
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        *(f"offset.{ending}" for ending in ("html", "csv", "json", "png"))
    }
    columns = (tmp_path / "offset.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    named = re.findall(r"`((?:exact|first_order|\w+_location|\w+_motion)_d\w+)`", PAGE)
    assert len(named) >= 4
    assert set(named) <= set(columns)
