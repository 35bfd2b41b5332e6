"""The ways of a sample and of a bag through the house are those that `doc/architecture.md` tells."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest
from house import PACKAGE, tree_of

DOCUMENT = (Path(__file__).parents[1] / "doc" / "architecture.md").read_text(encoding="utf-8")
TITLES = "The way of a sample", "The way of a bag"
WAYS = {title: DOCUMENT.partition(f"## {title}\n")[2].partition("\n## ")[0] for title in TITLES}
ARROW = re.compile(r"^([\w/]+\.py) -> ([\w/]+\.py): (.+)$", re.MULTILINE)
START = re.compile(r"(nodes|commands|notebook|linuxcnc_controller/link|kinds/\w+/kind)\b")
"""Files that no other one calls: programs, what notebooks call, and entry points."""


class Step(NamedTuple):
    """One arrow: a file and another one, of which it calls what is named."""

    source: str
    target: str
    names: tuple[str, ...]


def steps(way: str) -> list[Step]:
    return [Step(source, target, tuple(names.split(", "))) for source, target, names in ARROW.findall(way)]


def defined(path: Path) -> set[str]:
    """Functions and classes of a file, and methods as `Class.method`."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    top = [node for node in tree_of(path).body if isinstance(node, kinds | ast.ClassDef)]
    classes = [node for node in top if isinstance(node, ast.ClassDef)]
    methods = {f"{each.name}.{part.name}" for each in classes for part in each.body if isinstance(part, kinds)}
    return {node.name for node in top} | methods


def called(path: Path) -> set[str]:
    """Functions and classes that a file calls or derives from, by module and name; methods as `.method`."""
    tree, found = tree_of(path), set()
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    origin = {alias.asname or alias.name: f"{node.module}.{alias.name}" for node in imports for alias in node.names}
    for node in ast.walk(tree):
        used = [node.func] if isinstance(node, ast.Call) else node.bases if isinstance(node, ast.ClassDef) else []
        for each in used:
            if isinstance(each, ast.Name) and each.id in origin:
                found.add(origin[each.id])
            elif isinstance(each, ast.Attribute):
                found.add(f".{each.attr}")
    return found


def wrong(step: Step) -> list[str]:
    """What of an arrow the code has otherwise."""
    missing = [name for name in (step.source, step.target) if not (PACKAGE / name).is_file()]
    if missing:
        return [f"there is no {name}" for name in missing]
    there, calls = defined(PACKAGE / step.target), called(PACKAGE / step.source)
    module = f"{PACKAGE.name}.{step.target.removesuffix('.py').replace('/', '.')}"
    found = [f"{step.target} has no {name}" for name in step.names if name not in there]
    for name in step.names:
        method = name.partition(".")[2]
        if name in there and (f".{method}" if method else f"{module}.{name}") not in calls:
            found.append(f"{step.source} does not call {name} of {step.target}")
    return found


@pytest.mark.parametrize("title", WAYS)
def test_each_step_is_a_call_in_the_code(title):
    told = steps(WAYS[title])
    assert len(told) > 20
    assert [each for step in told for each in wrong(step)] == []


@pytest.mark.parametrize("title", WAYS)
def test_a_way_goes_on_where_it_has_come_to(title):
    reached: set[str] = set()
    for step in steps(WAYS[title]):
        assert step.source in reached or START.match(step.source), f"nothing leads to {step.source}"
        reached |= {step.source, step.target}
    told = ARROW.sub("", WAYS[title])
    assert set(re.findall(r"`((?:\w+/)*\w+\.py)`", told)) <= reached, "the text names files that are on no arrow"


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ("signals/streams.py -> signals/admission.py: Admission", []),
        ("signals/streams.py -> signals/admission.py: Admission.no", ["signals/admission.py has no Admission.no"]),
        ("signals/streams.py -> signals/entry.py: Admission", ["there is no signals/entry.py"]),
        (
            "signals/admission.py -> signals/streams.py: SampleStream",
            ["signals/admission.py does not call SampleStream of signals/streams.py"],
        ),
    ],
)
def test_a_step_that_is_not_in_the_code_is_told(step, told):
    assert wrong(*steps(step)) == told
