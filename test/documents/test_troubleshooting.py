"""The page of messages: each is written by the code, and each that a node gives as a warning or worse is on it."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "doc" / "troubleshooting.md").read_text(encoding="utf-8")
LISTED = re.findall(r"^\| `(.+?)` \| (.+) \| (.+) \|$", PAGE, re.MULTILINE)
WELL = {
    "; refused: …",  # follows what is lost, late and refused
    "in effect",
    "in … s",
    "none yet",
    "on and homed",
    "serving on http://…:…",
    "the next one …",
    "under way for … s",
}
"""Texts beside a level of warning or worse that are said where all is well, or only go on from one that is listed."""


def load(name):
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MESSAGES = load("messages")


def pattern(message):
    """What a message looks like once its values are filled in."""
    return ".*".join(map(re.escape, message.split("…")))


@pytest.fixture(scope="module")
def written():
    return MESSAGES.written()


@pytest.mark.parametrize("message", [message for message, *_ in LISTED])
def test_a_listed_message_is_one_that_the_code_writes(message, written):
    assert len(re.findall(r"\w+", message)) >= 1
    found = re.compile(pattern(message), re.DOTALL)
    assert any(found.search(text) for text in written), "no longer written: take it off the page"


def test_each_diagnosis_of_a_node_is_listed():
    assert MESSAGES.diagnostics() - {message for message, *_ in LISTED} - WELL == set()


def test_no_message_is_listed_twice_in_a_section():
    for section in PAGE.split("\n## ")[1:]:
        found = re.findall(r"^\| `(.+?)` \|", section, re.MULTILINE)
        assert found and len(found) == len(set(found)), section.splitlines()[0]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["calibrate", "errors", "no_such"], "no machine '…'; give the path of a YAML file or one of …"),
        (["up", "no_such.yaml"], "…: cannot be read (…); give the path of …"),
        (["check", "no_such", "--stage", str(ROOT / "config" / "stage.yaml")], "…: no such bag; give the folder of …"),
        (["diagnose", "no_such", "--twin", "no_such.yaml", "-o", "out"], "…: cannot be read (…); give the path of …"),
    ],
)
def test_what_a_newcomer_does_wrong_is_listed(words, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    printed = capsys.readouterr().err.strip().removeprefix("rotary_error_monitor: ")
    assert re.fullmatch(pattern(expected), printed)
    assert any(re.fullmatch(pattern(message), printed) for message, *_ in LISTED)
