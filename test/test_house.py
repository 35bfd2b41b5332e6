"""Imports run one way through the house, and each library stays in its room."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import rotary_error_monitor

PACKAGE = Path(rotary_error_monitor.__file__).parent
LEAVES = {"errors", "files", "plugins", "resources", "start"}
CORE = {"description", "signals", *LEAVES}
ROOMS = {
    "description": LEAVES,
    "signals": LEAVES,
    "metrology": CORE,
    "machine": CORE,
    "plant": CORE,
    "security": CORE,
    "pipeline": CORE | {"metrology", "machine"},
    "effects": CORE | {"metrology", "machine"},
    "twin": CORE | {"metrology", "machine", "effects"},
    "gap": CORE | {"metrology", "machine", "effects", "twin", "bags"},
    "kinds": CORE | {"machine", "effects", "twin", "gap"},
    "bags": CORE,
    "blind_check": CORE | {"metrology", "machine", "effects", "twin", "gap", "bags", "plant"},
    "calibration": CORE | {"metrology", "machine", "bags"},
    "report": CORE | {"metrology", "machine", "effects", "twin", "gap", "calibration", "pipeline"},
    "controller": CORE | {"machine"},
    "sources": CORE | {"metrology", "plant"},
    "nodes": CORE
    | {"metrology", "machine", "pipeline", "bags", "sources", "controller", "twin", "effects", "gap", "security"},
    "testing": CORE | {"nodes"},
}
ONLY_IN = {
    "rclpy": {"nodes", "testing"},
    "sensor_msgs": {"nodes", "testing"},
    "geometry_msgs": {"nodes", "testing"},
    "matplotlib": {"report"},
    "cryptography": {"security"},
    "rosbags": {"bags"},
    "mcap": {"bags"},
    "lz4": {"bags"},
    "zstandard": {"bags"},
    "sqlite3": {"bags"},
    "linuxcnc": {"controller"},
    "hal": {"controller"},
}


def modules() -> Iterator[tuple[str, Path]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        inside = path.relative_to(PACKAGE)
        yield inside.parts[0] if len(inside.parts) > 1 else inside.stem, path


@cache
def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; the house spells rooms out"
            assert node.module is not None
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def rooms_of(names: set[str]) -> set[str]:
    parts = [name.split(".") for name in names if name.split(".")[0] == PACKAGE.name]
    return {part[1] for part in parts if len(part) > 1 and part[1] != "__version__"}


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_a_room_imports_only_what_lies_below_it(room):
    paths = [path for name, path in modules() if name == room]
    assert paths, f"room {room} is empty"
    for path in paths:
        foreign = rooms_of(imports(path)) - ROOMS[room] - {room}
        assert not foreign, f"{path.relative_to(PACKAGE)} imports {sorted(foreign)}"


def test_the_plan_names_every_room():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    outside = {"scenario", "commands"}  # whole scenarios join every room
    assert rooms - outside == set(ROOMS)


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_a_library_stays_in_its_room(library):
    for room, path in modules():
        used = {name.split(".")[0] for name in imports(path)}
        assert library not in used or room in ONLY_IN[library], f"{path.relative_to(PACKAGE)} imports {library}"


def test_the_plant_shares_no_formula_with_what_it_tests():
    """Nothing that the plant imports, however far, lies in the rooms of estimator and twin."""
    tested = {"metrology", "machine", "effects", "twin", "gap", "pipeline"}
    seen, waiting = set(), {"plant"}
    while waiting:
        room = waiting.pop()
        seen.add(room)
        for name, path in modules():
            if name == room:
                waiting |= rooms_of(imports(path)) - seen
    assert not seen & tested
