"""Listed load cells in a stage's file: what is read, written back, and refused with its line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from described_stages import stage_of
from description.test_thermometers import line_of

from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

DOC = Path(__file__).parents[2] / "doc"
CELL = {"kind": "force", "noise": 0.1, "resolution": 0.05, "range": 500.0, "uncertainty": 0.5, "azimuth": 0.3}


def written(tmp_path, sensors, force=None):
    found = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    if force is not None:
        found["stage"]["environment"]["force"] = force
    found["stage"]["sensors"] = sensors
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump(found, sort_keys=False), encoding="utf-8")
    return path


def test_forces_are_inputs_and_the_only_one_is_that_on_the_shaft(tmp_path):
    own = {**CELL, "zero": [3.0, -4.0], "gain": -1.5, "axes": 1, "latency": 0.002, "unit": "N"}
    stage = load_stage(written(tmp_path, {"nose": own}))
    assert not stage.sensors and stage.forces == {"nose": "force_nose"} and stage.shaft_forces == ("force_nose",)
    cell = stage.inputs["force_nose"]
    assert (cell.zeros, cell.gain, cell.place) == ((3.0, -4.0), -1.5, {"azimuth": 0.3, "axes": 1})
    assert stage.response("force_nose").latency == 0.002
    assert stage_of(stage_mapping(stage)) == stage
    names = wire_of(stage).names
    assert {"/stage/force_nose/samples", "/stage/force_nose/wrench", "/stage/force/samples"} <= set(names)


def test_of_two_forces_the_file_names_which(tmp_path):
    stage = load_stage(written(tmp_path, {"nose": CELL, "plate": CELL}, ["plate"]))
    assert stage.shaft_forces == ("force_plate",) and len(stage.forces) == 2
    assert stage_of(stage_mapping(stage)) == stage
    both = load_stage(written(tmp_path, {"nose": CELL, "plate": CELL}, ["plate", "nose"]))
    assert both.shaft_forces == ("force_plate", "force_nose")


@pytest.mark.parametrize(
    ("sensors", "force", "word", "told"),
    [
        ({"nose": {**CELL, "unit": "mm"}}, None, "unit: mm", "nose.unit: 'mm' is no unit of kind force; expected: N"),
        ({"nose": {**CELL, "form": []}}, None, "form:", "nose: 'form' was unexpected"),
        ({"nose": {**CELL, "axes": 3}}, None, "axes: 3", "axes: 3 is greater than .* 1 where it measures along"),
        ({"nose": {**CELL, "gain": 0.0}}, None, "gain: 0.0", "gain: 0.0 is too near to 0"),
        ({"nose": {**CELL, "zero": 3.0}}, None, "zero: 3.0", r"zero: 3.0 is no list; expected: reading \[first axis"),
        ({"nose": {**CELL, "zero": [0.0, 501.0]}}, None, "zero:", "is beyond the range of 500.0 N"),
        ({"nose": CELL, "plate": CELL}, None, "plate:", "sensors.plate: a force beside 'nose'; name the one on the sh"),
        ({"nose": CELL}, ["nase"], "- nase", "environment.force.0: no force of the name 'nase' is listed; .* of nose"),
        ({}, ["nose"], "- nose", "environment.force.0: .*'nose' is listed; expected a sensor of kind force in"),
        ({"nose": CELL}, ["nose", "nose"], "force:", "environment.force: .* has an entry twice"),
        (
            {"nose": {name: value for name, value in CELL.items() if name != "azimuth"}},
            None,
            "nose:",
            "'azimuth' is a required property; expected: direction of its first axis",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(sensors, force, word, told, tmp_path):
    path = written(tmp_path, sensors, force)
    with pytest.raises(InputError, match=rf"stage\.yaml:{line_of(path, word)}: stage\.[a-z.]*.*{told}"):
        load_stage(path)


def test_a_sensor_of_two_fields_without_a_zero_can_be_written_back(tmp_path):
    level = {"kind": "tilt_sensor", "noise": 1e-7, "resolution": 1e-7, "range": 1e-3, "uncertainty": 1e-6}
    stage = load_stage(written(tmp_path, {"level": level}))
    assert stage_of(stage_mapping(stage)) == stage and stage.sensors["tilt_sensor_level"].zeros == (0.0, 0.0)


def test_the_example_of_the_page_can_be_read(tmp_path):
    """It says what is beside an encoder; its three cells are one force on the shaft, of two of them."""
    section = (DOC / "sensors.md").read_text(encoding="utf-8").split("## Load cells")[1]
    block = yaml.safe_load(section.split("```yaml\n")[1].split("```")[0])["stage"]
    stage = load_stage(written(tmp_path, block["sensors"], block["environment"]["force"]))
    assert stage.shaft_forces == ("force_fx", "force_fy") and len(stage.forces) == 3
