"""Listed thermometers in a stage's file: what is read, written back, and refused with its line."""

from __future__ import annotations

import re

import pytest
import yaml
from described_stages import stage_of

from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

OWN = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1}
PROBE = {"kind": "axial_probe", "radius": 0.0, "noise": 1e-8, "resolution": 1e-9, "range": 1e-4, "uncertainty": 1e-7}


def content(sensors):
    found = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    found["stage"]["sensors"] = sensors
    return found


def written(tmp_path, sensors):
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump(content(sensors), sort_keys=False), encoding="utf-8")
    return path


def line_of(path, word):
    """Of the last line with a word: the sensors are the end of the file."""
    return max(i for i, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1) if word in line)


def test_thermometers_are_inputs_and_probes_are_sensors(tmp_path):
    stage = load_stage(written(tmp_path, {"housing": OWN, "nose": PROBE, "bearing": {**OWN, "zero": 0.5}}))
    assert tuple(stage.sensors) == ("axial_probe_nose",)
    assert stage.thermometers == {"bearing": "thermometer_bearing", "housing": "thermometer_housing"}
    assert tuple(stage.listed) == ("axial_probe_nose", "thermometer_bearing", "thermometer_housing")
    assert stage.inputs["thermometer_bearing"].zeros == (0.5,)
    assert stage_of(stage_mapping(stage)) == stage
    names = wire_of(stage).names
    assert "/stage/thermometer_bearing/samples" in names and "/stage/thermometer_bearing/temperature" in names


@pytest.mark.parametrize(
    ("own", "word", "told"),
    [
        (
            {"form": [{"order": 1, "cos": 1e-6, "sin": 0.0}]},
            "form:",
            "'form' was unexpected.*of kind thermometer: kind, n",
        ),
        ({"gain": 2.0}, "gain: 2.0", "'gain' was unexpected"),
        ({"unit": "K"}, "unit: K", "unit: 'K' is no unit of kind thermometer; expected: °C; where a driver"),
        ({"noise": -1.0}, "noise: -1.0", r"noise: -1\.0 is less than .*standard deviation of one reading in K"),
        ({"range": 0.0}, "range: 0.0", r"range: 0\.0 is less than .*largest reading"),
        ({"zero": 80.0, "range": 50.0}, "zero: 80.0", r"zero: 80\.0 is beyond the range of 50\.0 °C"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_what_no_thermometer_has_is_refused_with_its_line(tmp_path, own, word, told):
    path = written(tmp_path, {"bearing": {**OWN, **own}})
    with pytest.raises(InputError, match=rf"stage\.yaml:{line_of(path, word)}: stage\.sensors\.bearing.*{told}"):
        load_stage(path)


def test_a_name_that_stands_twice_is_refused_with_its_line(tmp_path):
    path = written(tmp_path, {"bearing": OWN})
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("    bearing:\n", f"    bearing: {OWN}\n    bearing:\n"), encoding="utf-8")
    again = line_of(path, "    bearing: {") + 1
    with pytest.raises(InputError, match=rf"stage\.yaml:{again}: key 'bearing' stands twice"):
        load_stage(path)


def test_nothing_of_a_thermometer_is_uncertain_but_its_zero_and_how_late_it_is(tmp_path):
    path = written(tmp_path, {"bearing": OWN, "nose": PROBE})
    found = yaml.safe_load(path.read_text(encoding="utf-8"))
    found["stage"]["uncertainty"] = {"sensors.bearing.gain": 0.01}
    path.write_text(yaml.safe_dump(found), encoding="utf-8")
    told = r"sensors\.bearing has no 'gain'; expected one of timing$"
    with pytest.raises(InputError, match=told) as caught:
        load_stage(path)
    assert re.search(r"stage\.yaml:\d+: ", str(caught.value))


def test_thermometers_take_no_place_in_masks(tmp_path):
    """A mask has place for 51 heads and probes: 13 heads and 38 probes fill it."""
    sensors = {**{f"p{i}": PROBE | {"radius": 0.01 * i} for i in range(38)}, "bearing": OWN, "housing": OWN}
    for heads in (13, 14):
        found = content(sensors)
        found["stage"]["encoder"]["heads"] = {f"h{i}": {"azimuth": 0.1 * i} for i in range(heads)}
        path = tmp_path / f"{heads}.yaml"
        path.write_text(yaml.safe_dump(found, sort_keys=False), encoding="utf-8")
    assert len(load_stage(tmp_path / "13.yaml").inputs) == 2
    with pytest.raises(InputError, match="38 sensors beside 14 heads; a mask of streams has place for 51 of both"):
        load_stage(tmp_path / "14.yaml")
