"""Commands, steps and options that sentences name in passing, of pages, messages and remedies: they exist."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module

import pytest
from checkout import ROOT

from rotary_error_monitor.cli import COMMANDS

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "doc").glob("*.md"))]
SOURCES = sorted((ROOT / "rotary_error_monitor").rglob("*.py"))


@cache
def parser_of(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    import_module(f"rotary_error_monitor.commands.{command.replace('-', '_')}").add(parser)
    return parser


def steps_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return next((dict(a.choices) for a in parser._actions if isinstance(a, argparse._SubParsersAction)), {})


def named(text: str) -> Iterator[tuple[str, list[str]]]:
    """Commands between backquotes, with the words behind them; of `calibrate` without the program as well."""
    for span in re.findall(r"`([^`\n]+)`", text):
        words = re.sub(r"[\"'(),]", " ", span).split()
        if words[:1] == ["rotary_error_monitor"] and len(words) > 1 and re.fullmatch(r"[a-z][a-z-]*", words[1]):
            yield span, words[1:]
        elif words[:1] == ["calibrate"] and len(words) > 1:
            yield span, words


def wrong(words: list[str]) -> str:
    """What of a command does not exist; empty where all does."""
    command, *rest = words
    if command not in COMMANDS:
        return f"no command {command}"
    parser = parser_of(command)
    if steps := steps_of(parser):
        step = next(iter(rest), "")
        if step not in steps:
            return f"no step {step} of {command}" if re.fullmatch(r"[a-z-]+", step) else ""
        parser = steps[step]
    known = {option for action in parser._actions for option in action.option_strings}
    return ", ".join(f"no option {word} of {command}" for word in rest if word.startswith("-") and word not in known)


@pytest.mark.parametrize("paths", [PAGES, SOURCES], ids=["pages", "sources"])
def test_what_is_named_exists(paths) -> None:
    found = [(path.name, span, words) for path in paths for span, words in named(path.read_text(encoding="utf-8"))]
    assert len(found) > 20
    assert [(name, span, wrong(words)) for name, span, words in found if wrong(words)] == []
