"""Whatever a section allows is a description that can be used, or refused with its line; all else is refused."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from described_stages import DUMPER, stage_of
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from motion_numbers import numbers_of
from pushed_inputs import push_block

from rotary_error_monitor.description.listed_sensors import is_input, quantity
from rotary_error_monitor.description.machine import (
    MachineDescription,
    load_machine,
    machine_from_mapping,
    machine_mapping,
)
from rotary_error_monitor.description.machine_section import MachineSection
from rotary_error_monitor.description.sensor_places import HEAD_WIDTH
from rotary_error_monitor.description.stage import StageDescription, load_stage, stage_mapping
from rotary_error_monitor.description.stage_section import PARAMETERS, StageSection
from rotary_error_monitor.description.wire import load_wire, markdown_table
from rotary_error_monitor.description.wire_section import WireSection
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.kinds.mount.description import MountDescription, load_mount, mount_machine
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription, load_quadrature
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.stream_limits import stream_limits
from rotary_error_monitor.signals.blocks import block_from_samples

from . import drawn

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "config"
START = 1_763_700_000_000_000_000
LOADERS: dict[str, Callable[[Path], Any]] = {
    "stage": load_stage,
    "machine": load_machine,
    "mount": load_mount,
    "quadrature": load_quadrature,
    "wire": lambda path: load_wire(folder=path.parent),
}
SHIPPED = {
    "stage": [CONFIG / "stage.yaml"],
    "machine": sorted((CONFIG / "machines").glob("*.yaml")),
    "mount": sorted((CONFIG / "mounts").glob("*.yaml")),
    "quadrature": [CONFIG / "quadrature.yaml"],
    "wire": sorted((ROOT / "msg_defs").glob("*.yaml")),
}
MANY = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("described")


def load(kind: str, content: Any, folder: Path) -> Any:
    """The description, or None where the file was refused as it should be."""
    path = folder / f"{kind}.yaml"
    for other in folder.iterdir():
        other.unlink()
    path.write_text(yaml.dump(content, Dumper=DUMPER, sort_keys=False, allow_unicode=True), encoding="utf-8")
    try:
        return LOADERS[kind](path)
    except InputError as error:
        said = str(error)
        assert said.startswith(str(folder)) and len(said) < 1500 and "\n" not in said, said
        return None


@st.composite
def stages(draw: st.DrawFn) -> Any:
    """What the section allows, with the uncertainty of parameters that there are, and readings that can be."""
    section = draw(drawn.contents(StageSection))
    for sensor in section.get("sensors", {}).values():
        fields, _ = quantity(sensor["kind"])
        largest = min(0.5 * sensor["range"], 100.0)  # of a thermometer in K; of others the range is below that anyway
        zeros = [largest * draw(st.floats(-1.0, 1.0)) for _ in fields]
        sensor["zero"] = zeros if len(fields) > 1 else zeros[0]
        for name in ("noise", "resolution"):
            sensor[name] = min(sensor[name], 0.5 * sensor["range"])
    heads = section.get("encoder", {}).get("heads", {})
    if heads:  # no two at one place, at a ring before which so many have room
        ring = section["encoder"]
        ring["disc_radius"] = max(ring["disc_radius"], HEAD_WIDTH / 2 / math.tan(0.1 * math.pi / len(heads)))
    for number, head in enumerate(heads.values()):
        head["azimuth"] = 2 * math.pi / len(heads) * (number + draw(st.floats(0.0, 0.9)))
    for number, sensor in enumerate(section.get("sensors", {}).values()):
        if "radius" in sensor or "height" in sensor:
            name = "radius" if "radius" in sensor else "height"
            sensor[name] = 1.5 * number + draw(st.floats(0.0, 1.0))
    probes = [row for row in section.get("sensors", {}).values() if "radius" in row or "height" in row]
    for sensor in probes:
        sensor.pop("target", None)
    if "targets" in section:  # each is seen by a probe, which says nothing of its form
        seen = dict(zip(section["targets"], probes, strict=False))
        section["targets"] = {name: section["targets"][name] for name in seen}
        for name, sensor in seen.items():
            sensor["target"] = name
            sensor.pop("form", None)
    collimator = section.get("autocollimator", {})
    for axis, (cubic, zero) in enumerate(
        zip(collimator.get("cubic", ()), collimator.get("zero", (0, 0)), strict=False)
    ):
        most = collimator["range"] + abs(zero / collimator.get("gain", 1.0))  # up to there readings rise
        collimator["cubic"][axis] = max(cubic, -0.1 / max(most, 1e-5) ** 2)
    poses = [name for name, row in section.get("sensors", {}).items() if not is_input(row["kind"])]
    assume("encoder" in section or "autocollimator" in section or poses)
    forces = [name for name, row in section.get("sensors", {}).items() if row["kind"] == "force"]
    section.get("environment", {}).pop("force", None)
    if len(forces) > 1:  # then the file has to name one, or up to four
        named = draw(st.lists(st.sampled_from(forces), min_size=1, max_size=4, unique=True))
        section["environment"] = {"reference_temperature": 20.0, **section.get("environment", {}), "force": named}
    if "encoder" not in section:
        section.get("calibration", {}).pop("encoder", None)
    there = [part for part in PARAMETERS if part != "encoder" or part in section]
    names = [f"{part}.{name}" for part in there for name in PARAMETERS[part]]
    names += [f"sensors.{name}.gain" for name in poses]
    if "uncertainty" in section:
        section["uncertainty"] = {draw(st.sampled_from(names)): size for size in section["uncertainty"].values()}
    return {"stage": section}


@MANY
@given(content=stages())
def test_every_stage_that_does_not_contradict_itself_can_be_used(content: Any, folder: Path) -> None:
    stage = load("stage", content, folder)
    assert isinstance(stage, StageDescription)
    assert stage_of(stage_mapping(stage)) == stage
    try:
        estimator = Estimator(stage)
    except InputError:
        return
    times = START + np.arange(20) * 1_000_000
    for name in estimator.inputs:
        fields = stream_limits(stage)[name][0]
        push_block(estimator, name, block_from_samples(times, fields, np.zeros((20, len(fields)))))
    for motion in estimator.finish():
        assert np.isfinite(numbers_of(motion)).all()


@st.composite
def machines(draw: st.DrawFn) -> Any:
    """What the section allows, and does not contradict itself."""
    section = draw(drawn.contents(MachineSection))
    letters = list(section.get("axes", "XYZCA"))
    travels = {x: axis["travel"] for x, axis in section["axes"].items()} if "axes" in section else section["travel"]
    for letter, travel in travels.items():
        linear = section["axes"][letter]["kind"] == "linear" if "axes" in section else letter in "XYZ"
        most = 100.0 if linear else 1000.0
        travel[:] = sorted(min(max(end, -most), most - 1.0) for end in travel)
        travel[1] += 1.0 if travel[1] - travel[0] < 1e-3 else 0.0
    if temperatures := section.get("limits", {}).get("temperature"):
        temperatures[:] = [min(temperatures) - 1.0, max(temperatures)]
        temperatures[0] = max(temperatures[0], -50.0)
        temperatures[1] = max(temperatures[1], -49.0)
    if "reference_temperature" in section or temperatures:
        low, high = temperatures or (5.0, 45.0)
        section["reference_temperature"] = min(max(section.get("reference_temperature", 20.0), low), high)
    errors = section.get("errors", {})
    section["errors"] = {name[:2] + draw(st.sampled_from(letters)): row for name, row in errors.items()}
    for name, row in section["errors"].items():
        if table := row.get("table"):
            low, high = travels[name[2]]
            table["positions"] = sorted({min(max(place, low), high) for place in table["positions"]} | {low, high})
            for column in ("values", "forward", "backward"):
                if column in table:
                    table[column] = (table[column] * len(table["positions"]))[: len(table["positions"])]
    if "bodies" in section:
        _mend_tree(draw, section, letters)
    return {"machine": section}


def _mend_tree(draw: st.DrawFn, section: Any, letters: list[str]) -> None:
    for axis in section["axes"].values():
        vector = np.array(axis["direction"])
        length = float(np.linalg.norm(vector))
        axis["direction"] = (vector / length).tolist() if length > 1e-9 else [0.0, 0.0, 1.0]
    bodies = [{key: row[key] for key in row if key != "axis"} for row in section["bodies"]]
    bodies += [{} for _ in range(len(letters) - len(bodies))]
    names = ["base"]
    for number, row in enumerate(bodies):
        row |= {"name": f"body_{number}", "parent": draw(st.sampled_from(names))}
        squareness = row.pop("squareness", {})
        if number < len(letters):
            row["axis"] = letters[number]
            others = {x: angle for x, angle in squareness.items() if x in letters and x != row["axis"]}
            row["squareness"] = {x: angle / (2 * len(others)) for x, angle in others.items()}
            turned = row.get("location_error", {}).get("rotation")
            if turned is not None:
                turned[:] = [angle / 2 for angle in turned]  # with the angles within the limit of a location error
        names.append(row["name"])
    section["bodies"] = bodies
    section["tool"] = draw(st.sampled_from(names[1:]))
    section["workpiece"] = draw(st.sampled_from([name for name in names if name != section["tool"]]))
    rotary = [x for x in _between(section) if section["axes"][x]["kind"] == "rotary"]
    section["spindle"] = draw(st.sampled_from([None, *(row["name"] for row in bodies if "axis" not in row)]))
    section["monitored"] = draw(st.sampled_from([None, *rotary]))
    if section["monitored"] is not None:
        section["axes"][section["monitored"]]["direction"] = [0.0, 0.0, 1.0]


def _between(section: Any) -> list[str]:
    """Axes that move the tool against the workpiece."""
    rows = {row["name"]: row for row in section["bodies"]}

    def above(name: str) -> set[str]:
        return set() if name == "base" else {name} | above(rows[name]["parent"])

    chain = sorted(above(section["tool"]) ^ above(section["workpiece"]))
    return [rows[name]["axis"] for name in chain if "axis" in rows[name]]


@MANY
@given(content=machines())
def test_every_machine_that_does_not_contradict_itself_can_be_used(content: Any, folder: Path) -> None:
    machine, section = load("machine", content, folder), content["machine"]
    if machine is None and "bodies" in section:  # three linear axes may lie in one plane
        assume(sum(section["axes"][x]["kind"] == "linear" for x in _between(section)) != 3)
    assert isinstance(machine, MachineDescription)
    again = machine_from_mapping(machine_mapping(machine))
    assert again.axes == machine.axes and again.errors == machine.errors
    positions = np.array([[sum(axis.travel) / 2 for axis in machine.axes]])
    offset = predict_tool_offset(arrange_machine(machine), positions)
    assert offset.shape == (1, 6) and np.isfinite(offset).all()


@MANY
@given(content=drawn.contents(MountDescription))
def test_every_mount_that_the_section_allows_can_be_used(content: Any, folder: Path) -> None:
    mount = load("mount", {"mount": content}, folder)
    assert mount is not None
    assert all(value > 0 for value in mount.geometry_uncertainty())
    assert mount_machine(mount.latitude or 0.0, mount.geometry).letters == ("H", "D")


@MANY
@given(content=drawn.contents(QuadratureDescription))
def test_every_pair_of_signals_that_the_section_allows_can_be_used(content: Any, folder: Path) -> None:
    signals = load("quadrature", {"quadrature": content}, folder)
    assert signals is not None
    assert all(
        0 < value < math.inf for value in (signals.period, signals.amplitude, signals.uncertainty, signals.noise)
    )


@settings(MANY, max_examples=15)
@given(content=drawn.contents(WireSection))
def test_every_wire_contract_that_its_section_allows_makes_a_table_or_names_what_is_double(
    content: Any, folder: Path
) -> None:
    wire = load("wire", content, folder)
    if wire is not None:
        assert len(markdown_table(wire).splitlines()) == 2 + len(wire.names)


def places(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document."""
    yield path
    parts = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in parts:
        yield from places(value, (*path, key))


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.just("x" * 5000) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=3),
    max_leaves=5,
)


@pytest.mark.parametrize(("kind", "path"), [(kind, path) for kind, paths in SHIPPED.items() for path in paths])
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_whatever_stands_anywhere_in_a_shipped_file_is_read_or_refused(kind, path, data, folder) -> None:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    place = data.draw(st.sampled_from(list(places(content))))
    value = data.draw(ANYTHING)
    if place:
        changed = copy.deepcopy(content)
        parent = changed
        for step in place[:-1]:
            parent = parent[step]
        if data.draw(st.booleans()):
            parent[place[-1]] = value
        else:
            del parent[place[-1]]
    else:
        changed = value
    load(kind, changed, folder)


PLANAR = {"x": [1.0e-9, 0.0], "y": [0.0, 1.0e-9]}


@pytest.mark.parametrize(
    ("place", "row"),
    [
        (("encoder", "graduation"), {"cos": 1.0e-9, "sin": 0.0}),
        (("mirror", "flatness"), PLANAR),
        (("spindle", "radial"), PLANAR),
        (("spindle", "tilt"), PLANAR),
    ],
)
def test_more_orders_than_anybody_can_tell_are_refused(
    place: tuple[str, str], row: dict[str, Any], tmp_path: Path
) -> None:
    """Each of them costs every sample of a recording."""
    for count in (500, 501, 1000):
        content = yaml.safe_load((CONFIG / "stage.yaml").read_text(encoding="utf-8"))
        content["stage"].setdefault(place[0], {})[place[1]] = [{"order": k + 2} | row for k in range(count)]
        path = tmp_path / "stage.yaml"
        path.write_text(yaml.dump(content, Dumper=_Plain), encoding="utf-8")
        if count == 500:
            load_stage(path)
            continue
        with pytest.raises(InputError, match=rf"{place[0]}\.{place[1]}: {count} entries; expected: at most 500 rows"):
            load_stage(path)


class _Plain(yaml.SafeDumper):
    """Writes a value that stands twice as often."""

    def ignore_aliases(self, data: object) -> bool:
        return True


@settings(max_examples=100, deadline=None)
@given(text=st.text(max_size=200), random=st.randoms())
def test_whatever_text_is_read_or_refused(text: str, random, tmp_path_factory) -> None:
    top = tmp_path_factory.getbasetemp() / "texts"
    top.mkdir(exist_ok=True)
    for kind, paths in SHIPPED.items():
        whole = random.choice(paths).read_text(encoding="utf-8")
        at = random.randrange(len(whole))
        path = top / kind / "any.yaml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(whole[:at] + text + whole[at:], encoding="utf-8", errors="surrogatepass")
        try:
            LOADERS[kind](path)
        except InputError as error:
            assert re.match(rf"{re.escape(str(path))}:?\d*: |{re.escape(str(path.parent))}: ", str(error)), error
            assert len(str(error)) < 1500
