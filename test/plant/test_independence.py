"""The plant is the other side of every comparison: it shares no formula with estimator, model and twin."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rotary_error_monitor.plant

PLANT = Path(rotary_error_monitor.plant.__file__).parent
FILES = sorted(PLANT.rglob("*.py"))
OWN = ("description", "signals", "errors", "plant")
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


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PLANT)))
def test_plant_imports_only_descriptions_signals_and_errors(file: Path) -> None:
    imports = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imports |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import hides where it goes"
            imports.add(node.module or "")
    for name in imports:
        parts = name.split(".")
        allowed = parts[1] in OWN if parts[0] == "rotary_error_monitor" else parts[0] in FOREIGN
        assert allowed, f"{file} imports {name}"


def test_plant_pulls_in_no_other_room_when_it_is_imported() -> None:
    code = (
        "import sys, rotary_error_monitor.plant, rotary_error_monitor.plant.faults, rotary_error_monitor.plant.machine;"
        "print(*{n.split('.')[1] for n in sys.modules if n.startswith('rotary_error_monitor.')})"
    )
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert {"plant", "description"} <= set(loaded) <= {*OWN, "files", "resources"}
