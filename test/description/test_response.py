"""Responses of instruments: closed forms of each part, what a file says of them, and what it must not say."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from described_stages import stage_of

from rotary_error_monitor.description.response import IDEAL, Response
from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.metrology.tilt import check_saturation
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import block_from_samples

START = 1_763_700_000_000_000_000
TIMES = START + np.array([0, 100_001, 250_000])
PLANE = np.array([[1e-5, 2e-5], [-3e-5, 0.0], [0.0, -4e-5]])
ANGLE = np.array([[0.5], [-1.0], [7.25]])
TILT = ("tilt_x", "tilt_y")


def corrected(response, values, fields=TILT):
    return correct_block(block_from_samples(TIMES, fields, values), fields, response)


def test_an_ideal_instrument_costs_nothing():
    block = block_from_samples(TIMES, TILT, PLANE)
    for response in (None, IDEAL, Response((0.0, 0.0))):
        assert correct_block(block, TILT, response) is block
    assert IDEAL.corrected(PLANE) is PLANE and IDEAL.readings(PLANE) is PLANE


@pytest.mark.parametrize(
    ("response", "values", "expected"),
    [
        (Response((1e-5, -2e-5)), PLANE, [[0.0, 4e-5], [-4e-5, 2e-5], [-1e-5, -2e-5]]),
        (Response(gain=2.0), PLANE, PLANE / 2),
        (Response((0.25,), -1.0), ANGLE, [[-0.25], [1.25], [-7.0]]),
        # of the command: the speed has no zero, but the sign; of the angle alone the same
        (Response((0.25, 0.0), -1.0), [[0.5, 2.0]] * 3, [[-0.25, -2.0]] * 3),
        # what turned x to y by a quarter of a turn is turned back: y was x, and x was -y
        (Response(roll=np.pi / 2), PLANE, [[2e-5, -1e-5], [0.0, 3e-5], [-4e-5, 0.0]]),
        # zero first, then gain and roll: (4e-5, 0) over -2 is (-2e-5, 0), which had been turned from (0, 2e-5)
        (Response((-1e-5, 2e-5), -2.0, np.pi / 2), [[3e-5, 2e-5]] * 3, [[0.0, 2e-5]] * 3),
    ],
    ids=["zero", "gain", "sign", "command", "roll", "all"],
)
def test_each_part_is_taken_off_in_its_turn(response, values, expected):
    fields = TILT[: np.shape(values)[1]]
    block = corrected(response, np.array(values), fields)
    np.testing.assert_allclose(block.columns(fields), expected, rtol=0, atol=1e-20 if len(fields) == 2 else 1e-15)
    assert np.array_equal(block.times_ns, TIMES)
    np.testing.assert_allclose(response.readings(block.columns(fields)), values, rtol=1e-14, atol=1e-20)


def test_samples_are_of_their_latency_before_their_stamps():
    raw = block_from_samples(TIMES, TILT, PLANE)
    block = correct_block(raw, TILT, Response(latency=2e-3))
    assert np.array_equal(block.times_ns, TIMES - 2_000_000)
    assert block.rows is raw.rows, "the values are not touched"


def test_other_columns_stay_and_the_block_that_came_is_not_changed():
    fields = ("quality", "angle")
    raw = block_from_samples(TIMES, fields, np.hstack([ANGLE, ANGLE]))
    before = raw.rows.copy()
    block = correct_block(raw, ("angle",), Response((0.5,)))
    assert np.array_equal(block.column("quality"), ANGLE[:, 0]) and np.array_equal(raw.rows, before)
    np.testing.assert_allclose(block.column("angle"), ANGLE[:, 0] - 0.5)
    with pytest.raises(InputError, match="no field 'tilt_x'"):
        correct_block(raw, TILT, Response((0.0, 1.0)))


def test_what_is_not_finite_stays_so_without_a_warning():
    values = np.array([[np.inf, 0.0], [1e308, np.nan], [0.0, 0.0]])
    block = corrected(Response((1e-5, 0.0), 0.001, 0.3), values)
    assert np.isfinite(block.columns(TILT)).all(axis=1).tolist() == [False, False, True]


def test_the_range_is_of_what_the_instrument_reads():
    instrument = Autocollimator(5e-4, 1e-7, 1e-7)
    response = Response((2e-4, 0.0), -2.0, np.radians(30))
    readings = np.array([[10e-4, 0.0], [-9e-4, 0.0], [0.0, -10e-4], [9.9e-4, 9.9e-4]])
    found = check_saturation(response.corrected(readings), instrument, response)
    assert found.tolist() == [True, False, True, False]
    corners = np.array([[x, y] for x in (-1e-3, 1e-3) for y in (-1e-3, 1e-3)])
    largest = np.abs(response.corrected(corners)).max()
    assert largest <= response.largest(5e-4) <= 1.2 * largest


def test_the_example_of_the_documentation_is_read():
    text = (Path(__file__).parents[2] / "doc" / "devices.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```yaml\n(heads:.*?)```", text, re.DOTALL)
    rows = yaml.safe_load(example)
    encoder = {"disc_radius": 0.1, "lines_per_revolution": 31488, "counts_per_line": 100, "noise": 3e-7}
    content = {"encoder": encoder | {"heads": rows["heads"]}, "autocollimator": rows["autocollimator"]}
    assert set(stage_of(content).responses) == {"head_a", "head_b", "autocollimator"}


def described(folder, **changes):
    """File with changed sections; heads by their letters, the others by their names."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    stage = content["stage"]
    probe = {"kind": "axial_probe", "radius": 0.0, "noise": 1e-8, "resolution": 0, "range": 1e-3, "uncertainty": 1e-9}
    stage |= {"sensors": {"top": probe}, "command": {}}
    places = stage["encoder"]["heads"] | {"top": probe} | stage
    for name, rows in changes.items():
        places[name] |= rows
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


OWN = {
    "a": {"zero": 2.5, "sign": -1, "latency": 1e-4},
    "autocollimator": {"zero": [1e-5, 0.0], "gain": 1.02, "roll": 0.2, "latency": 2e-3},
    "lvdt": {"gain": -1.0},
    "top": {"latency": 5e-4, "zero": 1e-6, "gain": -2.0},
    "command": {"zero": 1.3, "sign": -1, "latency": 4e-3},
}


def test_a_file_says_how_its_instruments_answer_and_is_written_back(tmp_path):
    assert load_stage(described(tmp_path)).responses == {}
    stage = load_stage(described(tmp_path, **OWN))
    assert stage.responses == {
        "head_a": Response((2.5,), -1.0, 0.0, 1e-4),
        "autocollimator": Response((1e-5, 0.0), 1.02, 0.2, 2e-3),
        "lvdt": Response((0.0, 0.0), -1.0),
        "axial_probe_top": Response(latency=5e-4),
        "command": Response((1.3, 0.0), -1.0, latency=4e-3),
    }
    assert stage.response("head_b") is IDEAL
    assert stage.sensors["axial_probe_top"].zero == 1e-6, "stays a parameter of the sensor"
    assert "latency" not in stage.sensors["axial_probe_top"].place
    assert stage_of(stage_mapping(stage)) == stage
    assert stage_mapping(stage)["encoder"]["heads"]["b"] == {"azimuth": stage.encoder.azimuths["b"]}


@pytest.mark.parametrize(
    ("name", "rows", "told"),
    [
        ("b", {"sign": 0.5}, r"encoder\.heads\.b\.sign: .*expected: 1, or -1 for a head that counts the other way"),
        ("b", {"zero": 7.0}, r"encoder\.heads\.b\.zero: .*expected: reading at rotation 0 .*whole turns do not count"),
        ("b", {"gain": 1.01}, r"encoder\.heads\.b: .*'gain' was unexpected"),
        ("autocollimator", {"gain": 0}, r"autocollimator\.gain: .*expected: .*at least 0\.001 in size"),
        ("autocollimator", {"zero": 1e-5}, r"autocollimator\.zero: .*expected: reading \[x, y\] of a mirror"),
        ("autocollimator", {"roll": 12}, r"autocollimator\.roll: .*expected: angle about \+z in rad"),
        ("lvdt", {"latency": -0.1}, r"lvdt\.latency: .*expected: how long after .* in s, from 0 to 1"),
        ("command", {"sign": 0}, r"command\.sign: .*expected: 1, or -1 for a controller that counts the other way"),
        ("command", {"gain": -2.0}, r"command\.gain: -2\.0 is less than .*expected: angle that is told per rotation"),
        ("command", {"roll": 2.0}, r"command: .*'roll' was unexpected"),
        ("top", {"latency": 2}, r"sensors\.top\.latency: .*expected: how long after"),
    ],
)
def test_what_no_instrument_can_be_is_refused_with_its_line(name, rows, told, tmp_path):
    with pytest.raises(InputError, match=rf"stage\.yaml:\d+: stage\.{told}"):
        load_stage(described(tmp_path, **{name: rows}))


BENT = Response((1e-5, -2e-5), -1.1, 0.3, 0.0, 0.04, -0.02, (-2e4, 3e4))


def read_by(response, tilt):
    """By a matrix and a power: turned, stretched along the axes, bent."""
    cosine, sine = np.cos(response.roll), np.sin(response.roll)
    half, both = response.gain_difference / 2, response.cross_coupling
    straight = np.array([[1 + half, both], [both, 1 - half]]) @ np.array([[cosine, -sine], [sine, cosine]]) @ tilt.T
    bent = straight + np.array(response.cubic)[:, None] * straight**3
    return np.array(response.zero) + response.gain * bent.T


@pytest.mark.parametrize("cubic", [(-2e4, 3e4), (0.0, 1e9), (-1e-3, 0.0), ()])
def test_a_distortion_is_taken_off(cubic):
    response = replace(BENT, cubic=cubic)
    tilts = np.random.default_rng(3).uniform(-5e-4, 5e-4, (200, 2))
    read = read_by(replace(response, cubic=cubic or (0.0, 0.0)), tilts)
    np.testing.assert_allclose(response.readings(tilts), read, rtol=1e-13, atol=1e-20)
    np.testing.assert_allclose(response.corrected(read), tilts, rtol=0, atol=1e-15)
    assert (
        np.abs(replace(response, cubic=(), gain_difference=0.0, cross_coupling=0.0).corrected(read) - tilts).max()
        > 1e-6
    )


def test_without_a_distortion_no_bit_changes():
    """The arithmetic of zero, gain and roll alone, written out."""
    response, readings = Response((1e-5, -2e-5), -1.1, 0.3), np.random.default_rng(4).normal(0, 1e-4, (500, 2))
    x, y = ((readings - (1e-5, -2e-5)) / -1.1).T
    cosine, sine = math.cos(-0.3), math.sin(-0.3)
    assert np.array_equal(
        response.corrected(readings), np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
    )


def test_readings_that_no_tilt_makes_stand_at_the_end_and_are_saturated():
    response = Response(cubic=(-1e5, 0.0))  # rises to 2/3 of 1/sqrt(3e5)
    end = 2 / 3 / np.sqrt(3e5)
    assert response.rises_to(0) == pytest.approx(end) and response.rises_to(1) == np.inf
    readings = np.array([[2 * end, 0.0], [end / 2, 0.0], [np.inf, 0.0], [np.nan, 0.0]])
    tilts = response.corrected(readings)
    assert tilts[0, 0] == pytest.approx(1 / np.sqrt(3e5), rel=1e-7)
    assert np.isfinite(tilts).all(axis=1).tolist() == [True, True, False, False]
    found = check_saturation(tilts[:2], Autocollimator(0.9 * end, 1e-7, 1e-7), response)
    assert found.tolist() == [True, False]


def test_the_largest_tilt_holds_those_of_a_distortion():
    corners = np.array([[x, y] for x in np.linspace(-5e-4, 5e-4, 21) for y in np.linspace(-5e-4, 5e-4, 21)])
    largest = np.abs(BENT.corrected(corners * -1.1)).max()
    assert largest <= BENT.largest(5e-4) <= 1.3 * largest


def test_an_undistorted_reading_is_one_of_the_same_zero_gain_and_roll():
    tilts = np.random.default_rng(5).uniform(-4e-4, 4e-4, (100, 2))
    plain = Response(BENT.zero, BENT.gain, BENT.roll)
    np.testing.assert_allclose(BENT.undistorted(BENT.readings(tilts)), plain.readings(tilts), rtol=0, atol=1e-15)
    assert plain.undistorted(tilts) is tilts


def test_a_file_states_a_distortion_and_is_written_back(tmp_path):
    rows = {"gain_difference": 0.04, "cross_coupling": -0.02, "cubic": [-2e4, 3e4]}
    stage = load_stage(described(tmp_path, autocollimator=rows))
    assert stage.response("autocollimator") == Response((0.0, 0.0), 1.0, 0.0, 0.0, 0.04, -0.02, (-2e4, 3e4))
    assert stage_of(stage_mapping(stage)) == stage
    assert {name: stage_mapping(stage)["autocollimator"][name] for name in rows} == rows
    straight = load_stage(described(tmp_path, autocollimator={"cubic": [0.0, 0.0], "gain": 2.0}))
    assert straight.response("autocollimator") == Response((0.0, 0.0), 2.0)
    assert "cubic" not in stage_mapping(straight)["autocollimator"]


@pytest.mark.parametrize(
    ("name", "rows", "told"),
    [
        ("autocollimator", {"cubic": [1e10, 0.0]}, r"autocollimator\.cubic\.0: .*expected: .*at most 1e9"),
        ("autocollimator", {"cubic": 1e4}, r"autocollimator\.cubic: .*expected: \[x, y\] in 1/rad\^2"),
        ("autocollimator", {"gain_difference": 0.7}, r"autocollimator\.gain_difference: .*at most 0\.5"),
        ("autocollimator", {"cross_coupling": -0.5}, r"autocollimator\.cross_coupling: .*at most 0\.3"),
        (
            "autocollimator",
            {"cubic": [0.0, -7e5]},
            r"autocollimator\.cubic\.1: -700000 lets readings fall .*-6\.3e\+05",
        ),
        ("lvdt", {"cubic": [0.0, 0.0]}, r"lvdt: .*'cubic' was unexpected"),
    ],
)
def test_a_distortion_that_no_instrument_can_have_is_refused_with_its_line(name, rows, told, tmp_path):
    with pytest.raises(InputError, match=rf"stage\.yaml:\d+: stage\.{told}"):
        load_stage(described(tmp_path, **{name: rows}))
