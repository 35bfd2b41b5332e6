"""Targets that several probes see: their form stands in a file once, and what does not go together is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription, load_stage, stage_mapping
from rotary_error_monitor.errors import InputError

MAKE = "noise: 1.0e-08, resolution: 1.0e-09, range: 1.0e-04, uncertainty: 1.0e-08"
FORM = "form: [{order: 1, cos: 4.0e-06, sin: 1.0e-06}, {order: 3, cos: 2.0e-07, sin: 1.0e-07}]"
ROWS = (AngularHarmonic(1, 4e-6, 1e-6), AngularHarmonic(3, 2e-7, 1e-7))


def written(tmp_path: Path, sensors: dict[str, str], targets: dict[str, str] | None = None) -> Path:
    lines = ["stage:", "  sensors:", *(f"    {name}: {{{row}, {MAKE}}}" for name, row in sensors.items())]
    lines += ["  targets:", *(f"    {name}: {{{row}}}" for name, row in targets.items())] if targets else []
    path = tmp_path / "stage.yaml"
    path.write_text("\n".join(lines) + "\n")
    return path


def probe(azimuth: float, height: float = 0.05, *more: str) -> str:
    return ", ".join(["kind: radial_probe", f"azimuth: {azimuth}", f"height: {height}", *more])


TWO = {"x": probe(0.0, 0.05, "target: ball"), "y": probe(1.5, 0.05, "target: ball", "gain: -1.0")}


@pytest.fixture
def stage(tmp_path: Path) -> StageDescription:
    return load_stage(written(tmp_path, {**TWO, "z": probe(0.0, 0.2)}, {"ball": FORM}))


def test_all_probes_before_a_target_have_its_form(stage: StageDescription) -> None:
    forms = {stream: (sensor.target, sensor.form) for stream, sensor in stage.sensors.items()}
    seen = ("ball", ROWS)
    assert forms == {"radial_probe_x": seen, "radial_probe_y": seen, "radial_probe_z": ("", ())}


def test_what_is_written_says_it_once_and_reads_back(tmp_path: Path, stage: StageDescription) -> None:
    content = stage_mapping(stage)
    assert list(content["targets"]) == ["ball"] and "form" not in content["sensors"]["x"]
    path = tmp_path / "again.yaml"
    path.write_text(yaml.safe_dump({"stage": content}))
    assert load_stage(path) == stage


def test_forms_that_have_come_apart_are_written_with_each_sensor(tmp_path: Path, stage: StageDescription) -> None:
    """Not with the target, of which one of them would be lost."""
    apart = replace(stage.sensors["radial_probe_x"], form=ROWS[:1])
    changed = replace(stage, sensors={**stage.sensors, "radial_probe_x": apart})
    path = tmp_path / "apart.yaml"
    path.write_text(yaml.safe_dump({"stage": stage_mapping(changed)}))
    assert [sensor.form for sensor in load_stage(path).sensors.values()] == [ROWS[:1], ROWS, ()]


def test_targets_of_other_kinds_go_by_their_own_track(tmp_path: Path) -> None:
    """A ball may be seen from the side, and another target from above at a radius."""
    face = {name: f"kind: axial_probe, radius: 0.03, azimuth: {at}, target: face" for name, at in (("p", 0), ("q", 2))}
    stage = load_stage(written(tmp_path, {**TWO, **face}, {"ball": FORM, "face": ""}))
    assert {sensor.target for sensor in stage.sensors.values()} == {"ball", "face"}


WRONG: dict[str, tuple[dict[str, str], dict[str, str] | None, int, str]] = {
    "unknown": (TWO, {"bal": FORM}, 3, "sensors.x.target: there is no target 'ball'; expected one of bal"),
    "no section": (TWO, None, 3, "sensors.x.target: there is no target 'ball'; expected it in the section 'targets'"),
    "two forms": (
        {"x": probe(0.0, 0.05, "target: ball", FORM)},
        {"ball": FORM},
        3,
        "sensors.x.form: the target 'ball' has a form of its own; expected the form in one of both places",
    ),
    "heights": (
        {**TWO, "w": probe(2.0, 0.06, "target: ball")},
        {"ball": FORM},
        5,
        "sensors.w.target: 'x' sees another part of 'ball'; expected probes of one kind before one turn of a target",
    ),
    "kinds": (
        {**TWO, "w": "kind: axial_probe, radius: 0.05, target: ball"},
        {"ball": FORM},
        5,
        "sensors.w.target: 'x' sees another part of 'ball'",
    ),
    "faces": (
        {name: f"kind: axial_probe, radius: 0.05, gain: {gain}, target: disk" for name, gain in (("f", 1), ("g", -1))},
        {"disk": FORM},
        4,
        "sensors.g.target: 'f' sees another part of 'disk'",
    ),
    "nobody": (TWO, {"ball": FORM, "shaft": FORM}, 7, "targets.shaft: no probe names it; expected 'target' of a"),
    "a thermometer": (
        {"t": "kind: thermometer, target: ball"},
        {"ball": FORM},
        3,
        "sensors.t: 'target' was unexpected; expected: of kind thermometer:",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_does_not_go_together_is_refused_with_its_line(tmp_path: Path, wrong: str) -> None:
    sensors, targets, line, said = WRONG[wrong]
    path = written(tmp_path, sensors, targets)
    with pytest.raises(InputError) as refused:
        load_stage(path)
    assert re.search(rf"{re.escape(str(path))}:{line}: stage\.{re.escape(said)}", str(refused.value)), refused.value


def test_the_schema_of_a_form_is_that_of_a_sensor(tmp_path: Path) -> None:
    rows: dict[str, Any] = {"ball": "form: [{order: 1, cos: 4.0e-06}]"}
    with pytest.raises(InputError, match=r"stage\.targets\.ball\.form"):
        load_stage(written(tmp_path, TWO, rows))
