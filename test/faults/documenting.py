"""Rows of `doc/faults.md`: each stands at the test that shows it, and the page is made of them.

make faults-doc    writes the page anew
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "doc" / "faults.md"

GROUPS = {
    "heads": "Encoder heads",
    "autocollimator": "Autocollimator",
    "sensors": "Displacement probes",
    "command": "Commanded angle",
    "messages": "Messages and their stamps",
    "description": "Descriptions",
    "joints": "Joint states and temperature",
    "corrections": "Corrections and the controller",
    "processes": "Processes, clocks and parameters",
    "network": "Network",
    "files": "Recordings and files",
}
"""Chapters of the page, in their order."""

_OUT = "ROWS_OF_FAULTS"
"""Variable that names the file to which a run of pytest writes the rows that it collected."""

Test = TypeVar("Test", bound=Callable[..., object])


@dataclass(frozen=True)
class Row:
    """A fault and its stated behaviour.

    Attributes:
        group: chapter, a key of `GROUPS`.
        fault: what goes wrong.
        seen: by whom, and how it is said.
        done: what the package does about it.
        published: what goes out meanwhile.
        recovery: when it is as before.
        test: that shows it, path and name.
    """

    group: str
    fault: str
    seen: str
    done: str
    published: str
    recovery: str
    test: str = ""


def shows(*rows: Row) -> Callable[[Test], Test]:
    """Decorator: the test shows these rows; they come to the page."""

    def note(test: Test) -> Test:
        test.rows = (*getattr(test, "rows", ()), *rows)  # type: ignore[attr-defined]
        return test

    return note


@cache
def collected() -> list[Row]:
    """Rows of all tests, in the order of files and lines, as pytest collects them."""
    files = [path for path in sorted((ROOT / "test").rglob("test_*.py")) if "@shows(" in path.read_text("utf-8")]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "rows.json"
        arguments = ["--collect-only", "-q", "-p", "faults.documenting", "-p", "no:cacheprovider", *map(str, files)]
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *arguments],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT / "test"), _OUT: str(out)},
            capture_output=True,
            text=True,
            check=False,
        )
        if not out.exists():
            raise RuntimeError(f"pytest collected nothing:\n{done.stdout}{done.stderr}")
        return [Row(**row) for row in json.loads(out.read_text(encoding="utf-8"))]


def pytest_collection_finish(session: pytest.Session) -> None:
    """As a plugin of pytest: write the rows of what was collected to the file that the environment names."""
    if _OUT not in os.environ:
        return
    found: dict[str, list[Row]] = {}
    for item in session.items:
        rows = getattr(getattr(item, "function", None), "rows", ())
        if rows:
            found.setdefault(item.nodeid.split("[")[0], list(rows))
    content = [{**vars(row), "test": test} for test, rows in found.items() for row in rows]
    Path(os.environ[_OUT]).write_text(json.dumps(content), encoding="utf-8")
