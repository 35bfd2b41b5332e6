"""Read heads, autocollimator and LVDT that a stage file lists beside other sensors, as it may have them in sections."""

from __future__ import annotations

import pytest
import yaml
from described_stages import stage_of

from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

RING = "disc_radius: 0.1, lines_per_revolution: 31488, counts_per_line: 100, noise: 3.0e-07"
LISTED = f"""\
stage:
  encoder: {{{RING}}}
  sensors:
    a: {{kind: read_head, azimuth: 0.0, zero: 2.7}}
    b: {{kind: read_head, azimuth: 3.141592653589793, sign: -1}}
    c: {{kind: read_head, azimuth: 1.5707963267948966}}
    tilt: {{kind: autocollimator, range: 4.8e-04, resolution: 4.8e-07, noise: 4.8e-07, gain: 1.02}}
    artefact: {{kind: lvdt, height: 0.016, noise: 5.0e-08}}
    drive: {{kind: command, zero: 0.3, sign: -1, gain: 2.5, latency: 1.0e-04, unit: rad}}
    top: {{kind: axial_probe, radius: 0.0, noise: 1.0e-08, resolution: 1.0e-09, range: 0.0001, uncertainty: 1.0e-09}}
"""


def load_text(folder, text):
    path = folder / "stage.yaml"
    path.write_text(text, encoding="utf-8")
    return load_stage(path)


def test_a_list_is_the_stage_that_sections_are(tmp_path):
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    stage = content["stage"]
    stage["command"] = {"zero": 0.3, "sign": -1, "latency": 1e-4}
    (tmp_path / "sections.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    sections = load_stage(tmp_path / "sections.yaml")
    heads = {name: {"kind": "read_head", **row} for name, row in stage["encoder"].pop("heads").items()}
    others = {name: {"kind": name, **stage.pop(name)} for name in ("autocollimator", "lvdt", "command")}
    stage["sensors"] = {**heads, **others}
    found = load_text(tmp_path, yaml.safe_dump(content))
    assert found == sections and sections != load_stage()
    assert load_text(tmp_path, yaml.safe_dump({"stage": stage_mapping(found)})) == found


def test_heads_may_stand_in_both(tmp_path):
    whole = load_text(tmp_path, LISTED)
    assert [*whole.azimuths] == ["a", "b", "c"] and [*whole.sensors] == ["axial_probe_top"]
    assert (whole.response("head_a").zero, whole.response("head_b").gain) == ((2.7,), -1.0)
    assert whole.response("autocollimator").gain == 1.02 and whole.lvdt.height == 0.016
    assert whole.response("command") == Response((0.3, 0.0), -2.5, latency=1e-4)
    assert stage_of(stage_mapping(whole)) == whole, "sign and gain are written apart"
    mixed = LISTED.replace(RING, RING + ", heads: {d: {azimuth: 4.7}}")
    assert {*load_text(tmp_path, mixed).azimuths} == {"a", "b", "c", "d"}


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ("azimuth: 0.0", "azimuth: 7.0", 4, r"stage.sensors.a.azimuth: 7.0 is greater than"),
        ("azimuth: 0.0, ", "", 4, "stage.sensors.a: 'azimuth' is a required property"),
        (
            "sign: -1",
            "roll: 1.0",
            5,
            "stage.sensors.b: 'roll' was unexpected; expected: of kind read_head: kind, unit, zero",
        ),
        ("noise: 4.8e-07, gain", "noise: 0.5, gain", 7, "stage.sensors.tilt.noise: 0.5 is greater"),
        (RING, RING + ", heads: {a: {azimuth: 4.7}}", 4, "stage.sensors.a: there is one in 'encoder.heads.a' already"),
        ("kind: lvdt, height: 0.016, noise: 5.0e-08", "kind: autocollimator", 8, "'tilt' is of kind autocollimator al"),
        (
            "sign: -1, gain: 2.5",
            "azimuth: 1.0",
            9,
            "stage.sensors.drive: 'azimuth' was unexpected; expected: of kind command: kind, unit,",
        ),
        ("kind: axial_probe", "kind: axial_probe, roll: 1.0", 10, "top: 'roll' was unexpected; .* kind, noise.*, unit"),
        ("gain: 2.5", "gain: 0.0", 9, "stage.sensors.drive.gain: 0.0 is less than the minimum of 1e-06"),
        ("unit: rad", "unit: mm", 9, "stage.sensors.drive.unit: 'mm' is no unit of kind command; expected: rad; where"),
        ("height: 0.016", "unit: rad", 8, "stage.sensors.artefact.unit: 'rad' is no unit of kind lvdt; expected: m;"),
        (
            "kind: lvdt, height: 0.016, noise: 5.0e-08",
            "kind: command",
            9,
            "'artefact' is of kind command already; a stage has one at most",
        ),
        (RING, RING + "}\n  command: {sign: 1", 10, "stage.sensors.drive: there is one in 'command' already; keep one"),
        ("kind: axial_probe", "unit: N, kind: axial_probe", 10, "sensors.top.unit: 'N' is no unit of kind axial_probe"),
        ("kind: axial_probe", "kind: axial", 10, "'axial' is no kind of sensor; expected: one of read_head, autocoll"),
        (f"  encoder: {{{RING}}}\n", "", 1, "stage.encoder: 'disc_radius' is a required property"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(old, new, line, told, tmp_path):
    assert old in LISTED
    with pytest.raises(InputError, match=rf"stage.yaml:{line}: .*{told}"):
        load_text(tmp_path, LISTED.replace(old, new, 1))


@pytest.mark.parametrize("name", ["a", "tilt", "artefact", "drive", "top"])
def test_what_a_message_says_that_a_sensor_may_state_it_may(name, tmp_path):
    """Names are looked at before values: what is wrong of these is the value."""
    with pytest.raises(InputError, match="'word' was unexpected") as refused:
        load_text(tmp_path, LISTED.replace(f"{name}: {{", f"{name}: {{word: 1, "))
    words = {*str(refused.value).rpartition(": ")[2].split(", ")}
    assert {"kind", "unit"} <= words
    content = yaml.safe_load(LISTED)
    row = content["stage"]["sensors"][name]
    row |= dict.fromkeys(words - {"kind", "unit"}, "no value")
    with pytest.raises(InputError, match=r"'no value' is no (number|mapping|list)|'no value' is not one of"):
        load_text(tmp_path, yaml.safe_dump(content))
