"""Stages as described: what `uncertainty` may name, and files that name something else, each with its line."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.stage_section import PARAMETERS
from rotary_error_monitor.description.two_axis_section import Autocollimator, RadialReference
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

PROBE = {"kind": "axial_probe", "radius": 0.0, "noise": 1e-8, "resolution": 1e-8, "range": 1e-4, "uncertainty": 1e-8}
FILE = """\
stage:
  encoder:
    disc_radius: 0.1
    lines_per_revolution: 31488
    counts_per_line: 100
    noise: 3.0e-07
    heads: {a: {azimuth: 0.0}, b: {azimuth: 3.14159}}
  sensors:
    top: {kind: axial_probe, radius: 0.0, noise: 1.0e-08, resolution: 1.0e-09, range: 0.0001, uncertainty: 1.0e-09}
    low: {kind: radial_probe, azimuth: 0, height: 0.1, noise: 1.0e-08, resolution: 0, range: 0.01, uncertainty: 1.0e-07}
  uncertainty:
    encoder.eccentricity: 5.0e-08
"""


def described(folder, *rows):
    path = folder / "stage.yaml"
    path.write_text(FILE + "".join(f"    {row}\n" for row in rows), encoding="utf-8")
    return path


def test_what_the_file_names_is_uncertain(tmp_path):
    stage = load_stage(described(tmp_path, "sensors.low.gain: 0.01", "sensors.low.height: 1.0e-04"))
    named = {parameter.name: parameter.uncertainty for parameter in uncertain_parameters(stage)}
    assert named["sensors.low.gain"] == 0.01 and named["sensors.low.height"] == 1e-4
    assert named["sensors.low.zero"] == named["sensors.low.form[order 1][cos]"] == 1e-7, "of the sensor's own section"
    assert {size for name, size in named.items() if name.startswith("sensors.top")} == {1e-9}


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("encoder.excentricity: 1.0e-08", "encoder has no 'excentricity'; expected one of disc_radius, .*eccentricity"),
        ("spindle.wobble: 1.0e-08", "spindle has no 'wobble'; expected one of radial, tilt, radial_c"),
        ("sensors.low.radius: 1.0e-08", "sensors.low has no 'radius'; expected one of gain, azimuth, height"),
        ("sensors.low.form: 1.0e-08", "sensors.low has no 'form'"),
        ("sensors.topp.gain: 0.01", "there is no part 'sensors.topp'; expected one of encoder, .*sensors.low"),
        ("command.eccentricity: 1.0e-08", "command has no 'eccentricity'; expected one of timing"),
    ],
)
def test_a_name_that_there_is_not_is_refused_with_its_line(row, told, tmp_path):
    path = described(tmp_path, row)
    with pytest.raises(InputError, match=rf"stage.yaml:13: stage.uncertainty.{row.partition(':')[0]}: {told}"):
        load_stage(path)


def test_what_a_calibration_leaves_of_the_autocollimator_counts_unless_the_file_states_it(tmp_path):
    figures = "figures: {gain_uncertainty: 0.002, roll_uncertainty: 0.003, latency_uncertainty: 0.001}"
    note = f"{{date: '2026-11-26', source: bag, sha256: {64 * 'a'}, {figures}}}"
    path = described(tmp_path, "autocollimator.roll: 0.004")
    path.write_text(f"{path.read_text()}  calibration: {{autocollimator: {note}}}\n", encoding="utf-8")
    told = {name: std for name, std in load_stage(path).uncertainty.items() if name.startswith("autocollimator")}
    assert told == {"autocollimator.gain": 0.002, "autocollimator.roll": 0.004}


def test_a_name_of_no_section_is_refused_with_the_line_of_all(tmp_path):
    with pytest.raises(InputError, match=r"stage.yaml:13: stage.uncertainty: .*'rotor.mass'"):
        load_stage(described(tmp_path, "rotor.mass: 1.0"))


def test_whoever_reads_the_file_refuses_it(tmp_path, capsys):
    path = described(tmp_path, "encoder.excentricity: 1.0e-08")
    for command in (["check", "--stage", str(path), str(tmp_path)], ["diagnose", str(tmp_path), "--twin", str(path)]):
        options = ["-o", str(tmp_path / "out")] if command[0] == "diagnose" else []
        assert main([*command, *options]) == 2
        assert "stage.yaml:13: stage.uncertainty.encoder.excentricity" in capsys.readouterr().err


def test_each_name_that_is_accepted_is_one_that_the_twin_knows():
    stage = load_stage()
    stage = replace(
        stage,
        autocollimator=stage.autocollimator or Autocollimator(1e-3, 1e-7, 1e-7),
        lvdt=stage.lvdt or RadialReference(0.1, 1e-8),
        sensors={"axial_probe_top": ListedSensor("axial_probe", 1e-8, 1e-9, 1e-4, 0.0, place={"radius": 0.1})},
    )
    names = [f"{part}.{name}" for part, known in PARAMETERS.items() for name in known]
    for name in [*names, "sensors.top.gain", "sensors.top.zero", "sensors.top.radius"]:
        found = uncertain_parameters(replace(stage, uncertainty={name: 1e-9}))
        assert all(parameter.shifted(stage, 1e-9) != stage for parameter in found), name
    for name in ("encoder.mass", "sensors.top.zeros", "sensors.high.zero"):
        with pytest.raises(InputError, match=f"no parameter is called '{name}'"):
            uncertain_parameters(replace(stage, uncertainty={name: 1e-9}))


@pytest.mark.parametrize(
    ("heads", "sensors", "own", "message"),
    [
        (14, 38, {}, r"stage\.sensors: 38 sensors beside 14 heads; a mask of streams has place for 51 of both"),
        (4, 1, {"zero": 1e-3}, r"stage\.sensors\.s0\.zero: 0\.001 is beyond the range of 0\.0001 m"),
        (4, 1, {"noise": 1e-4}, r"stage\.sensors\.s0\.noise: 0\.0001 is beyond the range of 0\.0001 m"),
        (4, 1, {"resolution": 2e-4}, r"stage\.sensors\.s0\.resolution: 0\.0002 is beyond the range"),
        (4, 1, {"uncertainty": 0.0}, r"stage\.sensors\.s0\.uncertainty: .* 0\.1 nm or more"),
    ],
)
def test_sensors_that_cannot_be_are_refused_with_their_line(tmp_path, heads, sensors, own, message):
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["encoder"]["heads"] = {f"h{i}": {"azimuth": 0.1 * i} for i in range(heads)}
    content["stage"]["sensors"] = {f"s{i}": PROBE | own for i in range(sensors)}
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    with pytest.raises(InputError, match=rf"stage\.yaml:\d+: {message}"):
        load_stage(path)


@pytest.mark.parametrize("azimuth", ["0.0", "6.283185307179586", "-6.2831853", "9.0e-04"])
def test_two_heads_at_one_place_are_refused(tmp_path, azimuth):
    text = config("stage.yaml").read_text(encoding="utf-8")
    last = "      d: {azimuth: 4.71238898038469}\n"
    assert last in text
    path = tmp_path / "stage.yaml"
    path.write_text(text.replace(last, f"{last}      e: {{azimuth: {azimuth}}}\n"), encoding="utf-8")
    line = 1 + text[: text.index(last) + len(last)].count("\n")
    told = rf"stage\.yaml:{line}: stage\.encoder\.heads\.e\.azimuth: \S+ is where head 'a' stands \(0\.0\); expected"
    with pytest.raises(InputError, match=told):
        load_stage(path)
    path.write_text(text.replace(last, f"{last}      e: {{azimuth: 0.8}}\n"), encoding="utf-8")
    assert len(load_stage(path).azimuths) == 5


@pytest.mark.parametrize("kind", ["[tilt_sensor]", "{}", "7", "null"])
def test_a_kind_that_is_no_name_is_refused_with_its_line(tmp_path, kind):
    text = config("stage.yaml").read_text(encoding="utf-8") + "  sensors:\n    x:\n      kind: " + kind + "\n"
    path = tmp_path / "stage.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"stage\.yaml:\d+: stage\.sensors\.x.*kind.*; expected: one of read_head"):
        load_stage(path)


TILT = "kind: tilt_sensor, noise: 1.0e-07, resolution: 1.0e-08, range: 5.0e-04, uncertainty: 1.0e-06"


def with_tilt_sensor(folder, own):
    """A file whose line 11 is a tilt sensor with something of its own."""
    path = folder / "stage.yaml"
    before, after = FILE.split("  uncertainty:\n")
    rows = dict(row.split(": ", 1) for row in TILT.split(", ")) | dict([own.split(": ", 1)])
    second = ", ".join(f"{key}: {value}" for key, value in rows.items())
    path.write_text(f"{before}    second: {{{second}}}\n  uncertainty:\n{after}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("own", "told"),
    [
        ("noise: -1.0e-07", r"second.noise: -1e-07 is less than .* standard deviation of one reading in rad"),
        ("resolution: -1", r"second.resolution: .* step of a reading in rad"),
        ("range: 0", r"second.range: .* half of the measuring range in rad"),
        ("uncertainty: 0", r"second.uncertainty: .* 0\.1 nrad or more"),
        ("roll: 6.3", r"second.roll: 6.3 is greater than .* angle about \+z in rad"),
        ("roll: -6.3", r"second.roll: -6.3 is less than .* angle about \+z in rad"),
        ("gain: 0", r"second.gain: .* at least 0.001 in size"),
        ("zero: 1.0e-05", r"second.zero: 1e-05 is no list; expected: reading \[x, y\] of a perfect axis"),
        ("zero: [1.0e-05]", r"second.zero: \[1e-05\] is too short; expected: reading \[x, y\]"),
        ("zero: [0.0, 6.0e-04]", r"second.zero: \[0.0, 0.0006\] is beyond the range of 0.0005 rad"),
        ("azimuth: 0.0", r"second: .*'azimuth' was unexpected"),
        ("tilt_x: 0.0", r"second: .*'tilt_x' was unexpected"),
        ("form: [{order: 1, cos: 0.0, sin: 0.0}]", r"second.form.0: .*(unexpected|required)"),
        ("form: [{order: 1, x: [0.0, 0.0], y: [0.02, 0.0]}]", r"second.form.0.y.0: 0.02 is greater .* at most 10 mrad"),
    ],
)
def test_a_tilt_sensor_that_cannot_be_is_refused_with_its_line(tmp_path, own, told):
    with pytest.raises(InputError, match=rf"stage\.yaml:11: stage\.sensors\.{told}"):
        load_stage(with_tilt_sensor(tmp_path, own))


def test_a_tilt_sensor_is_read_as_the_file_has_it(tmp_path):
    sensor = load_stage(with_tilt_sensor(tmp_path, "zero: [1.0e-05, 2.0e-05]")).sensors["tilt_sensor_second"]
    assert (sensor.fields, sensor.unit, sensor.zeros) == (("tilt_x", "tilt_y"), "rad", (1e-5, 2e-5))
    path = with_tilt_sensor(tmp_path, "form: [{order: 2, x: [1.0e-06, 2.0e-06], y: [3.0e-06, 4.0e-06]}]")
    stage = load_stage(path)
    assert stage.sensors["tilt_sensor_second"].zeros == (0.0, 0.0)
    assert stage.sensors["tilt_sensor_second"].forms == (
        (AngularHarmonic(2, 1e-6, 2e-6),),
        (AngularHarmonic(2, 3e-6, 4e-6),),
    )
    named = {p.name: p for p in uncertain_parameters(stage) if p.name.startswith("sensors.second")}
    places = ["zero[x]", "zero[y]"]
    places += [f"form[order {k}][{axis}][{part}]" for k in (1, 2) for axis in "xy" for part in ("cos", "sin")]
    assert set(named) == {f"sensors.second.{place}" for place in places}
    moved = named["sensors.second.zero[y]"].shifted(stage, 1e-6).sensors["tilt_sensor_second"]
    assert moved.zeros == (0.0, 1e-6)
    bent = named["sensors.second.form[order 1][y][sin]"].shifted(stage, 1e-6).sensors["tilt_sensor_second"]
    assert bent.form[-1] == PlanarHarmonic(1, (0.0, 0.0), (0.0, 1e-6))


def test_the_order_in_the_file_is_not_that_of_the_bits(tmp_path):
    """A replay with the same sensors in another order reads the masks of the live run as they were written."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    found = []
    for names in (("top", "nose"), ("nose", "top")):
        content["stage"]["sensors"] = {name: PROBE | {"radius": 0.01 * len(name)} for name in names}
        path = tmp_path / "stage.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        found.append(tuple(load_stage(path).sensors))
    assert found[0] == found[1] == ("axial_probe_nose", "axial_probe_top")
