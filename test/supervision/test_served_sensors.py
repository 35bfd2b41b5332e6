"""Sensors that a stage lists and nodes of a cell's file: each has the other, or the file is refused with both lines."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config
from rotary_error_monitor.supervision.cell_file import CellNode, nodes_of, parameters_of
from rotary_error_monitor.supervision.served_sensors import checked_nodes, unserved_sensors

PROBE = {"kind": "axial_probe", "radius": 0.0, "noise": 1e-8, "resolution": 5e-9, "range": 1e-4, "uncertainty": 2e-8}
WARM = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1}
NOSE = "/**/listed_sensor_nose: {ros__parameters: {source: mock}}\n"
ESTIMATOR = "/**/error_estimator: {ros__parameters: {}}\n"
RECORDER = "/**/recorder: {ros__parameters: {}}\n"


def stage(folder: Path, sensors: Mapping[str, dict[str, Any]], name: str = "stage.yaml", **sections: object) -> Path:
    """The embedded stage with these sensors; sections that are None are left out."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    apart = {
        name: row | {"radius": 0.01 * k} if "radius" in row else row for k, (name, row) in enumerate(sensors.items())
    }
    content["stage"] |= {"sensors": apart, **sections}
    content["stage"] = {key: value for key, value in content["stage"].items() if value is not None}
    path = folder / name
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def cell(folder: Path, text: str, stage_file: Path | None, **shared: object) -> Path:
    """A cell's file whose nodes all take a stage's file."""
    path = folder / "cell.yaml"
    given = yaml.safe_dump({"/**": {"ros__parameters": {"stage": str(stage_file or ""), **shared}}})
    path.write_text(text + given, encoding="utf-8")
    return path


def line(path: Path, beginning: str) -> int:
    """Number of the line that begins like that."""
    return next(
        number
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if text.strip().startswith(beginning)
    )


def refused(path: Path, namespace: str = "") -> str:
    """Why a cell's file is refused."""
    with pytest.raises(InputError) as error:
        checked_nodes(path, namespace)
    return str(error.value)


@pytest.mark.parametrize("reader", [ESTIMATOR, RECORDER, "/**/gap_monitor: {ros__parameters: {}}\n"])
def test_a_sensor_without_a_node_is_refused(reader: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stage(tmp_path, {"nose": PROBE, "low": PROBE})
    file = cell(tmp_path, reader + NOSE, path)
    name = reader.split(":")[0].removeprefix("/**/")
    said = refused(file)
    assert said.startswith(f"{path}:{line(path, 'low:')}: stage.sensors.low: no node of {file} publishes "), said
    for words in ("/stage/axial_probe_low/samples", name, "/**/listed_sensor_low: {", "external_sensors: [low]"):
        assert words in said
    for more in ([], ["--systemd"]):
        assert main(["up", str(file), *more]) == 2
        told = capsys.readouterr()
        assert said in told.err and not told.out, "no node begins, and no unit is printed that would fail at the start"


def test_the_section_that_is_asked_for_is_one_that_serves(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE, "bearing": WARM})
    text = ESTIMATOR + RECORDER
    for _ in range(2):
        asked = re.search(r"'(/\*\*/\w+: \{ros__parameters: \{source: )…", refused(cell(tmp_path, text, path)))
        assert asked
        text += f"{asked[1]}mock}}}}\n"
    assert len(checked_nodes(cell(tmp_path, text, path))) == 4


def test_an_input_that_the_estimator_does_without_is_asked_for_by_who_listens(tmp_path: Path) -> None:
    path = stage(tmp_path, {"bearing": WARM})
    assert checked_nodes(cell(tmp_path, ESTIMATOR, path))
    assert "to which recorder would listen" in refused(cell(tmp_path, ESTIMATOR + RECORDER, path))


def test_a_cell_that_listens_to_nothing_may_serve_some_of_them(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE, "low": PROBE})
    assert [node.name for node in checked_nodes(cell(tmp_path, NOSE, path))] == ["listed_sensor_nose"]


@pytest.mark.parametrize(
    "section",
    [
        NOSE,
        "/**/listed_sensor_nose: {ros__parameters: {source: vector3, vector3: {topic: probe}}}\n",
        "/**/listed_sensor: {ros__parameters: {sensor: nose, source: mock}}\n",
        "/**/listed_sensor_7: {ros__parameters: {sensor: axial_probe_nose, source: mock}}\n",
        "/**/listed_sensor_axial_probe_nose: {ros__parameters: {source: mock}}\n",
        "/listed_sensor_nose: {ros__parameters: {source: mock}}\n",
    ],
)
def test_nodes_that_serve_it(section: str, tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE})
    assert checked_nodes(cell(tmp_path, ESTIMATOR + section, path))


def test_what_another_program_publishes_is_named(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE, "low": PROBE})
    assert checked_nodes(cell(tmp_path, ESTIMATOR + NOSE, path, external_sensors=["low"]))
    assert checked_nodes(cell(tmp_path, ESTIMATOR + NOSE, path, external_sensors=["axial_probe_low"]))
    assert "stage.sensors.low" in refused(cell(tmp_path, ESTIMATOR + NOSE, path, external_sensors=[]))


@pytest.mark.parametrize(
    ("named", "said"),
    [
        (["low", "lwo"], r"lists no sensor 'lwo'; it lists nose, low$"),
        (["low", "nose"], r"'nose' is published by listed_sensor_nose of this cell \(.*cell.yaml:2\); keep one"),
        ("low", r"low; expected a list of names of sensors that the stage lists, such as \[nose\]$"),
        ([1], r"\[1\]; expected a list of names"),
    ],
)
def test_wrong_names_of_what_others_publish(named: object, said: str, tmp_path: Path) -> None:
    file = cell(tmp_path, ESTIMATOR + NOSE, stage(tmp_path, {"nose": PROBE, "low": PROBE}), external_sensors=named)
    found = refused(file)
    place = f"{file}:{line(file, 'external_sensors')}: /**.ros__parameters.external_sensors: "
    assert found.startswith(place) and re.search(said, found), found


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("/**/listed_sensor_tip: {ros__parameters: {}}\n", "the sensor 'tip', of which the stage has none"),
        ("/**/listed_sensor_nose: {ros__parameters: {sensor: tip}}\n", "the sensor 'tip', of which the stage has none"),
        ("/**/encoder_head_q: {ros__parameters: {}}\n", "the head 'q', of which the stage has none"),
    ],
)
def test_a_node_of_no_listed_sensor_is_refused(section: str, said: str, tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE})
    file = cell(tmp_path, RECORDER + section, path, external_sensors=["nose"])
    found = refused(file)
    assert found.startswith(f"{file}:2: ") and said in found and f"{path} has " in found
    assert "axial_probe_nose" in found or "head_a, head_b, head_c, head_d" in found


def test_two_nodes_of_one_sensor_are_refused(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE})
    twice = RECORDER + NOSE + "/**/listed_sensor_7: {ros__parameters: {sensor: nose}}\n"
    said = refused(cell(tmp_path, twice, path))
    assert said.startswith(
        f"{tmp_path / 'cell.yaml'}:3: listed_sensor_7 publishes /stage/axial_probe_nose/samples, as "
    )
    assert f"listed_sensor_nose does ({tmp_path / 'cell.yaml'}:2)" in said


def test_what_has_a_section_of_its_own_is_asked_for_where_it_is_listed(tmp_path: Path) -> None:
    listed = {
        "a": {"kind": "read_head", "azimuth": 0.0},
        "b": {"kind": "read_head", "azimuth": 3.14},
        "far": {"kind": "lvdt", "height": 0.1, "noise": 1e-8},
        "drive": {"kind": "command"},
    }
    encoder = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))["stage"]["encoder"]
    path = stage(tmp_path, listed, encoder={k: v for k, v in encoder.items() if k != "heads"}, lvdt=None)
    text, sections = RECORDER, ("encoder_head_a", "encoder_head_b", "lvdt", "stage_command")
    for place, section in zip(listed, sections, strict=True):
        said = refused(cell(tmp_path, text, path))
        assert f":{line(path, f'{place}:')}: stage.sensors.{place}: " in said and f"'/**/{section}: {{" in said
        text += f"/**/{section}: {{ros__parameters: {{source: mock}}}}\n"
    assert checked_nodes(cell(tmp_path, text, path))


@pytest.mark.parametrize(
    ("section", "serves"),
    [
        ("/**/mock_controller: {ros__parameters: {}}\n", True),
        ("/**/linuxcnc_bridge: {ros__parameters: {}}\n", True),
        ("/**/linuxcnc_bridge: {ros__parameters: {stage_command: false}}\n", False),
    ],
)
def test_the_command_comes_of_a_controller_too(section: str, serves: bool, tmp_path: Path) -> None:
    path = stage(tmp_path, {"drive": {"kind": "command"}}, command=None)
    file = cell(tmp_path, RECORDER + section, path)
    assert checked_nodes(file) if serves else "stage.sensors.drive" in refused(file)


def test_each_namespace_by_itself(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE})
    other = stage(tmp_path, {}, "other.yaml")
    both = "".join(f"/{side}/error_estimator: {{ros__parameters: {{}}}}\n" for side in ("left", "right"))
    left = "/left/listed_sensor_nose: {ros__parameters: {source: mock}}\n"
    said = refused(cell(tmp_path, both + left, path))
    assert "publishes /right/stage/axial_probe_nose/samples" in said
    own = "/right/**: {ros__parameters: {external_sensors: [nose]}}\n"
    assert checked_nodes(cell(tmp_path, both + left + own, path))
    behind = yaml.safe_dump({"/right/**": {"ros__parameters": {"stage": str(other)}}})
    file = cell(tmp_path, both + left, path)
    file.write_text(file.read_text(encoding="utf-8") + behind, encoding="utf-8")
    assert checked_nodes(file), "the stage of the right one lists none"


def test_the_namespace_of_the_command_line_is_that_of_nodes_without_one(tmp_path: Path) -> None:
    path = stage(tmp_path, {"nose": PROBE})
    file = cell(tmp_path, "/left/listed_sensor_nose: {ros__parameters: {source: mock}}\n" + ESTIMATOR, path)
    assert {node.namespace for node in checked_nodes(file, "/left")} == {"/left"}
    assert "/stage/axial_probe_nose/samples" in refused(file)


def test_parameters_are_those_that_rcl_gives_a_node(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(
        "/**: {ros__parameters: {a: 1, b: {c: 1}}}\n"
        "/left/recorder: {ros__parameters: {a: 2}}\n"
        "/right/recorder: {ros__parameters: {a: 3}}\n"
        "/*/recorder: {ros__parameters: {b: {c: 2}}}\n"
        "/right/**: {ros__parameters: {d: 1}}\n"
    )
    left, right = CellNode("recorder", "recorder", "/left"), CellNode("recorder", "recorder", "/right")
    assert parameters_of(path, [left, right]) == {left: {"a": 2, "b.c": 2}, right: {"a": 3, "b.c": 2, "d": 1}}


def test_the_shipped_cell_goes_with_the_shipped_stage() -> None:
    assert checked_nodes(config("real_cell.yaml")) == nodes_of(config("real_cell.yaml"))


def test_the_mock_cell_of_all_parameters_goes_with_a_stage_that_lists_top(tmp_path: Path) -> None:
    text = config("cell.yaml").read_text(encoding="utf-8")
    path = stage(tmp_path, {"top": PROBE})
    file = tmp_path / "cell.yaml"
    file.write_text(text.replace('stage: "" #', f"stage: {path} #"), encoding="utf-8")
    assert "listed_sensor_top" in {node.name for node in checked_nodes(file)}
    file.write_text(text, encoding="utf-8")
    assert "listed_sensor_top is of the sensor 'top', of which the stage has none" in refused(file)


HEADS = "".join(f"/**/encoder_head_{head}: {{ros__parameters: {{source: mock}}}}\n" for head in "abcd")


def test_a_head_of_the_section_that_no_node_serves_is_said(tmp_path: Path) -> None:
    """It may come from another program, and the estimate goes without: that is no reason not to start."""
    heads = {name: {"azimuth": azimuth} for name, azimuth in zip("abcde", (0.0, 3.14, 1.57, 4.71, 0.8), strict=True)}
    encoder = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))["stage"]["encoder"]
    path = stage(tmp_path, {}, encoder={**encoder, "heads": heads})
    file = cell(tmp_path, HEADS + "/left/error_estimator: {ros__parameters: {}}\n" + ESTIMATOR, path)
    assert len(checked_nodes(file)) == 6
    missing = [*(f"/left/stage/head_{head}/samples" for head in "abcde"), "/left/stage/autocollimator/samples"]
    there = [f"no node of {file} publishes {name}, which {path} describes; " for name in missing]
    there += [f"no node of {file} publishes /stage/{name}/samples, which" for name in ("head_e", "autocollimator")]
    said = unserved_sensors(file)
    assert len(said) == len(there) and all(any(one.startswith(words) for one in said) for words in there), said
    assert all("unless another program does, error_estimator will go without it" in one for one in said)
    served = "".join(f"/**/{name}: {{ros__parameters: {{}}}}\n" for name in ("encoder_head_e", "autocollimator"))
    assert unserved_sensors(cell(tmp_path, HEADS + served + ESTIMATOR, path)) == ()
    assert unserved_sensors(cell(tmp_path, RECORDER, path)) == (), "a recorder on another computer hears them all"
