"""Imports run one way through the house, and each library stays in its room."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import pytest
from house import PACKAGE, imports, modules, tree_of

from rotary_error_monitor.description.wire import TIME_COLUMN, load_wire
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.corrections import OFFSET
from rotary_error_monitor.signals import blocks

DOCUMENT = (Path(__file__).parents[1] / "doc" / "architecture.md").read_text(encoding="utf-8")
"""The plan of the house: a row a room, with what it imports and which libraries are its own."""

LEAVES = {"arrays", "errors", "files", "libraries", "plugins", "resources", "start", "units", "unwinding"}
CORE = {"description", "signals", *LEAVES}
ROWS = re.findall(r"^\| `(\w+)` \| (.+) \| (.*) \| (.*) \|$", DOCUMENT, re.MULTILINE)
ROOMS = {
    room: (set() if room in CORE else CORE) | LEAVES | set(filter(None, below.split(", ")))
    for room, _, below, _ in ROWS
    if below != "all"
}
LIBRARIES = sorted({library for *_, own in ROWS for library in own.split(", ") if library})
ONLY_IN = {library: {room for room, *_, own in ROWS if library in own.split(", ")} for library in LIBRARIES}


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


def test_the_plan_names_every_room_as_it_calls_itself():
    told = {room: what for room, what, *_ in ROWS}
    found = {path.parent.name: path.read_text(encoding="utf-8") for path in PACKAGE.glob("*/__init__.py")}
    assert {room: (ast.get_docstring(ast.parse(text)) or "").split("\n")[0] for room, text in found.items()} == told
    # What is started as a whole joins every room.
    assert set(told) - set(ROOMS) == {"commands", "mock_cell", "linuxcnc_demonstration", "reproduction"}


def test_the_picture_shows_every_room_and_no_arrow_back():
    (picture,) = re.findall(r"```mermaid\n(.*?)```", DOCUMENT, re.DOTALL)
    shown = {(a, b) for line in picture.splitlines() for a, b in arrows(line)}
    assert {room for pair in shown for room in pair} == {room for room, *_ in ROWS}
    assert not [(a, b) for a, b in shown if b in ROOMS and a not in ROOMS[b]]


def arrows(line: str) -> Iterator[tuple[str, str]]:
    """Pairs of `a & b --> c --> d`."""
    steps = [re.findall(r"\w+", step) for step in line.split("-->")] if "-->" in line else []
    yield from ((a, b) for below, above in pairwise(steps) for a in below for b in above)


def test_files_that_the_plan_names_are_there():
    named = set(re.findall(r"`((?:\w+/)+\w+\.py)`", DOCUMENT))
    assert len(named) > 20
    roots = PACKAGE, PACKAGE.parent
    assert not [name for name in named if not any((root / name).is_file() for root in roots)]
    links = re.findall(r"\]\((\w+\.md)\)", DOCUMENT)
    assert links and all((PACKAGE.parent / "doc" / link).is_file() for link in links)


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_a_library_stays_in_its_room(library):
    for room, path in modules():
        used = {name.split(".")[0] for name in imports(path)}
        assert library not in used or room in ONLY_IN[library], f"{path.relative_to(PACKAGE)} imports {library}"


def test_the_plant_shares_no_formula_with_what_it_tests():
    """Nothing that the plant imports, however far, lies in the rooms of estimator and twin."""
    tested = {"metrology", "machine", "effects", "twin", "gap", "pipeline"}
    seen, waiting = set(), {"plant", "cases"}
    while waiting:
        room = waiting.pop()
        seen.add(room)
        for name, path in modules():
            if name == room:
                waiting |= rooms_of(imports(path)) - seen
    assert not seen & tested


WITHIN = PACKAGE / "kinds"
APART = ["mount", "quadrature"]
"""Kinds that nothing but their own folder knows: of stage and machine the cell knows as much."""

ELSEWHERE = {"sources": "quadrature", "linuxcnc_controller": "mount"}
"""Rooms in which a word of a kind means something else: counters of Linux, and its command."""


def classes_of(kind: str) -> set[str]:
    trees = [tree_of(path) for path in (WITHIN / kind).rglob("*.py")]
    return {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def test_the_method_names_no_kind():
    """The diagnosis knows rows and columns, whatever they are of."""
    kinds = sorted(path.parent.name for path in WITHIN.glob("*/__init__.py"))
    assert kinds == ["machine", "mount", "quadrature", "stage"]
    classes = set().union(*map(classes_of, kinds))
    assert {"StageProblem", "MachineProblem"} <= classes
    for path in (PACKAGE / "gap").rglob("*.py"):
        assert not classes & set(re.findall(r"\w+", path.read_text(encoding="utf-8"))), path.name
        assert not {name for name in imports(path) if name.startswith(f"{PACKAGE.name}.twin.stage")}, path.name


def test_only_its_own_folder_names_a_kind():
    """A kind is found by its entry point: neither its name nor a class of it stands anywhere else in the package."""
    classes = set().union(*(classes_of(kind) for kind in APART))
    classes -= {"AxisBacklash"}  # machine tools have an effect of this name, too
    assert {"MountProblem", "QuadratureEffect"} <= classes
    for room, path in modules():
        if room == "kinds":
            continue
        text = path.read_text(encoding="utf-8")
        named = {kind for kind in APART if re.search(rf"(?i)(?<![a-z]){kind}s?(?![a-z])", text)}
        assert not named - {ELSEWHERE.get(room)}, f"{path.relative_to(PACKAGE)} names {sorted(named)}"
        assert not classes & set(re.findall(r"\w+", text)), path.relative_to(PACKAGE)


def test_a_kind_imports_the_core_and_no_other_kind():
    for path in WITHIN.rglob("*.py"):
        others = {name.split(".")[2] for name in imports(path) if name.startswith(f"{PACKAGE.name}.kinds.")}
        assert others <= {path.parent.name}, path.relative_to(PACKAGE)


@pytest.mark.parametrize("room", ["effects", "gap", "kinds", "twin"])
def test_what_an_effect_needs_is_a_field_of_its_class(room):
    """Nobody asks by a name in quotation marks, which no type check sees."""
    for name, path in modules():
        calls = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
        asked = [node for node in calls if isinstance(node.func, ast.Name) and node.func.id in ("getattr", "hasattr")]
        quoted = [node for node in asked if isinstance(node.args[1], ast.Constant)]
        assert name != room or not quoted, f"{path.relative_to(PACKAGE)}:{quoted[0].lineno}"


def test_topic_names_stand_in_the_wire_contract_alone():
    for _, path in modules():
        texts = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Constant)]
        named = [node for node in texts if isinstance(node.value, str) and re.match(r"/(stage|machine)/", node.value)]
        assert not named, f"{path.relative_to(PACKAGE)}:{named[0].lineno} names {named[0].value}"


LISTED_KINDS = sorted(path.stem for path in (PACKAGE / "description" / "sensor_kinds").glob("[a-z]*.py"))
"""Kinds of listed sensors: each is a file of the same name in a few rooms."""

ORDINARY = {"force", "thermometer"}
"""Kinds whose name is an ordinary word: a stream or a column of another sensor may be called so."""

ALLOWED = {("description/sensor_section.py", "axial_probe")}
"""Where a kind stands for all of its like: a section that states no fields has those of displacement probes."""


def kinds_named(path: Path) -> set[str]:
    """Kinds of listed sensors that a file imports or names in a text that is no docstring."""
    inside, tree = str(path.relative_to(PACKAGE)), tree_of(path)
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in told]
    words = {word for node in texts if isinstance(node.value, str) for word in re.findall(r"[a-z_]+", node.value)}
    modules = {part for name in imports(path) if "sensor" in name or "plant" in name for part in name.split(".")}
    named = {kind for kind in LISTED_KINDS if kind in modules or (kind not in ORDINARY and kind in words)}
    return {kind for kind in named if path.stem != kind and (inside, kind) not in ALLOWED}


def test_only_files_of_its_name_name_a_kind_of_listed_sensor():
    """So another kind changes no file: it adds files of its name, and those of `msg_defs/`."""
    assert len(LISTED_KINDS) > 4
    named = {str(path.relative_to(PACKAGE)): kinds_named(path) for _, path in modules()}
    assert {name: kinds for name, kinds in named.items() if kinds} == {}


TWICE = {
    "TIME_COLUMN": "neither of `description` and `signals` imports the other; a test holds them equal",
    "PACKAGE": "what starts first imports nothing of the package",
    "ROTARY": "letters of ISO 841, to two rooms that do not know one another",
    **dict.fromkeys(("BLUE", "GREEN", "PURPLE"), "the live page loads no plotting"),
}
"""Constants that stand in two files, and why."""


def test_a_name_that_is_a_constant_stands_in_one_file():
    """Such as that of a stream: whoever needs it imports it."""
    found: dict[tuple[str, str], list[str]] = {}
    for _, path in modules():
        for node in (node for node in tree_of(path).body if isinstance(node, ast.Assign)):
            for name, value in assigned(node):
                if isinstance(value, ast.Constant) and isinstance(value.value, str) and name not in TWICE:
                    found.setdefault((name.lstrip("_"), value.value), []).append(str(path.relative_to(PACKAGE)))
    assert {name: where for name, where in found.items() if len(where) > 1} == {}


def assigned(node: ast.Assign) -> Iterator[tuple[str, ast.expr]]:
    """Names with their values, those of a tuple each by itself."""
    for target in node.targets:
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            yield from ((ast.unparse(each), value) for each, value in zip(target.elts, node.value.elts, strict=True))


CONTRACT = ("sensors", "description/wire.py")
"""Where names of columns may stand beside `msg_defs/`."""

COLUMNS = {topic.key: {TIME_COLUMN, *topic.columns} for topic in load_wire(None, sensors=()) if topic.is_sample_block}
ANY_COLUMN = set().union(*COLUMNS.values())
STATE = {*OFFSET, *(each.name for each in fields(ErrorMotion)), *COMPONENTS}
"""Names that the numbers themselves have, in code as on the wire."""


def fields_named(node: ast.AST) -> set[str]:
    """Columns of one topic that code names: as a collection of nothing else, or to a block or a topic."""
    named: set[str] = set()
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        named = texts_of(*(each for each in node.elts if not isinstance(each, ast.Starred)))
        of_one = named <= ANY_COLUMN and any(named <= columns for columns in COLUMNS.values())
        return named if of_one and not named <= STATE else set()
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in ("column", "field"):
        named = texts_of(*node.args)
    if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
        named = texts_of(node.left) if ast.unparse(node.comparators[0]).endswith((".names", ".columns")) else set()
    return named & ANY_COLUMN


def texts_of(*nodes: ast.expr) -> set[str]:
    """The texts that these are; what stands for any other expression is no name of a column."""
    return {node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else "" for node in nodes}


def test_names_of_columns_stand_in_the_wire_contract_and_the_sensors_alone():
    """Everywhere else they are asked for by what they are of."""
    named = []
    for room, path in modules():
        if room in CONTRACT or str(path.relative_to(PACKAGE)) in CONTRACT:
            continue
        tree = tree_of(path)
        # A section of a file tells places in it, which may be called like a column.
        places = {id(part) for node in ast.walk(tree) if isinstance(node, ast.Yield) for part in ast.walk(node)}
        for node in ast.walk(tree):
            if id(node) not in places and (found := fields_named(node)):
                named.append(f"{path.relative_to(PACKAGE)}:{node.lineno} names {sorted(found)}")
    assert named == []
    assert TIME_COLUMN == blocks.TIME_COLUMN


@pytest.mark.parametrize(
    ("code", "is_named"),
    [
        ('("angle",)', True),
        ('["velocity", "angle"]', True),
        ('(*OFFSET, "joint_age")', True),
        ('block.column("force_x")', True),
        ('"doubts" in block.names', True),
        ('("temperature", "time")', False),
        ('("theta", "exc", "eyc")', False),
        ('(angle, "velocity")', False),
        ('Parameter("angle", "rad")', False),
    ],
)
def test_a_name_of_a_column_is_told_from_other_words(code, is_named):
    assert any(map(fields_named, ast.walk(ast.parse(code)))) == is_named


def below(path: Path) -> set[Path]:
    """Files of the package that a file imports, be it in a function or for types alone."""
    parts = [name.split(".")[1:] for name in imports(path) if name.split(".")[0] == PACKAGE.name]
    named = [part[:count] for part in parts for count in (len(part) - 1, len(part)) if count]
    return {file for part in named if (file := PACKAGE.joinpath(*part).with_suffix(".py")).is_file()}


def test_no_files_import_one_another_in_a_circle():
    done: set[Path] = set()

    def visit(path: Path, way: tuple[Path, ...]) -> None:
        assert path not in way, f"circle: {[str(each.relative_to(PACKAGE)) for each in (*way, path)]}"
        if path not in done:
            for each in sorted(below(path)):
                visit(each, (*way, path))
            done.add(path)

    for _, path in modules():
        visit(path, ())
