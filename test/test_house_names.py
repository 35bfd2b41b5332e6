"""A name means one thing, and is imported from one place."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

from house import PACKAGE, modules, tree_of

import rotary_error_monitor

OFFERED = PACKAGE / "__init__.py"
"""What the package offers to notebooks; its docstring tells it."""


@cache
def imported(path: Path) -> dict[str, tuple[str, str, bool]]:
    """Names that a file imports by `from`: the module, the name there, and whether `as` says the same name again."""
    nodes = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.ImportFrom)]
    return {
        alias.asname or alias.name: (node.module or "", alias.name, alias.name == alias.asname)
        for node in nodes
        for alias in node.names
    }


def test_no_file_hands_on_what_another_one_defines():
    handed_on = {path: [name for name, (*_, again) in imported(path).items() if again] for _, path in modules()}
    assert set(handed_on.pop(OFFERED)) == set(rotary_error_monitor.__all__) - {"__version__"}
    assert {str(path.relative_to(PACKAGE)): names for path, names in handed_on.items() if names} == {}


IMPORT = re.compile(rf"^\s*from ({PACKAGE.name}[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)


def test_tests_and_examples_import_a_name_from_the_file_that_defines_it():
    """In the package the type check sees to that."""
    files = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for _, path in modules()}
    root = Path(__file__).parents[1]
    found = [
        f"{path.relative_to(root)} has {name} from {module}"
        for path in (*root.glob("test/**/*.py"), *root.glob("doc/**/*.py"))
        for module, names in IMPORT.findall(path.read_text(encoding="utf-8"))
        for name in re.findall(r"\w+", names)
        if module in files and name in imported(files[module])
    ]
    assert found == []


SEEN_TWICE = re.compile(r"cases/faults/|effects/|kinds/\w+/effects\.py")
"""A fault in the true world and the effect as which a diagnosis finds it have one name; so have effects of machines
that share nothing but the shop floor, such as backlash, each found by the folder of its kind.
"""


def test_a_public_class_name_means_one_thing():
    found: dict[str, list[str]] = {}
    for _, path in modules():
        inside = str(path.relative_to(PACKAGE))
        view = SEEN_TWICE.match(inside)
        for node in (node for node in tree_of(path).body if isinstance(node, ast.ClassDef)):
            found.setdefault(node.name, []).append(view[0] if view else inside)
    twice = {name: places for name, places in found.items() if len(places) > 1 and not name.startswith("_")}
    views = {name for name, places in twice.items() if all(map(SEEN_TWICE.match, places)) and not repeated(places)}
    assert len(views) > 30
    assert {name: places for name, places in twice.items() if name not in views} == {}


def repeated(places: list[str]) -> bool:
    return len({*places}) < len(places)


def types(path: Path) -> set[str]:
    """Names that a file gives to types such as `NDArray[np.float64]`."""
    nodes = [
        node for node in tree_of(path).body if isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript)
    ]
    return {target.id for node in nodes for target in node.targets if isinstance(target, ast.Name)}


def test_types_of_arrays_stand_in_one_file():
    arrays = PACKAGE / "arrays.py"
    shared = types(arrays)
    assert {"Array", "Times"} <= shared
    assert {str(path): again for _, path in modules() if path != arrays and (again := types(path) & shared)} == {}


LVDT = {
    "a section of the stage file, the stream, node and kind of sensor of that name": (
        "description/stage.py",
        "description/stage_section.py",
        "description/streams.py",
        "nodes/lvdt.py",
        "sensors/lvdt.py",
        "sources/vector3.py",
    ),
    "names of effects, of faults in the true world and of their departures": (
        "blind_check/cases.py",
        "cases/case_faults.py",
        "cases/departures/draws.py",
        "cases/departures/readings.py",
        "cases/draws.py",
        "cases/faults/instruments.py",
        "effects/lvdt.py",
    ),
    "words of the command line, where people choose a reference by its name": (
        "cli.py",
        "commands/compare.py",
        "commands/questions.py",
    ),
    "a paper that was verified with one": ("reproduction/lou2019.py", "reproduction/lou2019_figures.py"),
}
"""Files that name the LVDT, be it in words for a reader, by why they do."""


def test_only_these_files_name_the_lvdt():
    """It is one instrument of many that the estimate can be held against: all else asks for the reference, or asks the
    description and the sensors for what it needs to know of an instrument.
    """
    texts = {str(path.relative_to(PACKAGE)): path.read_text(encoding="utf-8") for _, path in modules()}
    named = {name for name, text in texts.items() if "lvdt" in f"{name} {text}".lower()}
    assert named == {name for names in LVDT.values() for name in names}
