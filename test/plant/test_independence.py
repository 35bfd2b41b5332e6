"""Plant and cases are the other side of every comparison: they share no formula with estimator, model and twin."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rotary_error_monitor

PACKAGE = Path(rotary_error_monitor.__file__).parent
FILES = sorted(file for room in ("plant", "cases") for file in (PACKAGE / room).rglob("*.py"))
OWN = ("arrays", "description", "signals", "errors", "plugins", "plant")
FOREIGN = (
    "__future__",
    "abc",
    "collections",
    "dataclasses",
    "functools",
    "hashlib",
    "math",
    "typing",
    "numpy",
    "scipy",
)


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_they_import_only_descriptions_signals_and_errors(file: Path) -> None:
    imports = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imports |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import hides where it goes"
            imports.add(node.module or "")
    own = (*OWN, "cases") if file.is_relative_to(PACKAGE / "cases") else OWN
    for name in imports:
        parts = name.split(".")
        allowed = parts[1] in own if parts[0] == "rotary_error_monitor" else parts[0] in FOREIGN
        assert allowed, f"{file} imports {name}"


@pytest.mark.parametrize(("rooms", "own"), [("plant plant.machine", OWN), ("plant cases.making", (*OWN, "cases"))])
def test_they_pull_in_no_other_room_when_they_are_imported(rooms: str, own: tuple[str, ...]) -> None:
    code = (
        f"import sys, {', '.join(f'rotary_error_monitor.{room}' for room in rooms.split())};"
        "print(*{n.split('.')[1] for n in sys.modules if n.startswith('rotary_error_monitor.')})"
    )
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert {"plant", "description"} <= set(loaded) <= {*own, "files", "libraries", "plugins", "resources", "units"}
