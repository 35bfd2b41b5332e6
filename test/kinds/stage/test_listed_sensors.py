"""Diagnosis of a stage with displacement probes; its recordings are written out with numpy (`probed_stage.py`).

Rates are over seeds: noise, jitter, and zero and form of each probe within their uncertainty are drawn anew.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from draws import seeds
from probed_stage import HIGH, LOW, SECONDS, STAGE, TOP, Withheld, blocks_of, command, recorded, without_autocollimator

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import stage_mapping
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
SEEDS = seeds(4)
AXIAL = Withheld(axial=((2, 2.1e-7, 2.1e-7),))
RADIAL = Withheld(radial=((3, (2e-7, -1e-7), (1e-7, 2e-7)),))
TILT = Withheld(tilt=((3, (2e-6, -1e-6), (1e-6, 2e-6)),))


def diagnosed(streams, stage=STAGE):
    without = () if stage.autocollimator is not None else ("autocollimator",)
    recording = record_stage(blocks_of(streams), "abcd", without=without, listed=tuple(stage.sensors))
    return diagnose(stage_problem(stage, recording, EFFECTS))


def causes_of(diagnosis):
    """Names and places, or none where they do not explain everything."""
    return {found.cause.key for found in diagnosis.causes} if diagnosis.verdict is Verdict.EXPLAINED else set()


def assert_named(withheld, key, values, numbers=SEEDS, stage=STAGE, alike=()):
    """All seeds name this one cause, with values within four standard deviations, and what it cannot be told from."""
    for seed in numbers:
        diagnosis = diagnosed(recorded(seed, withheld, stage), stage)
        assert causes_of(diagnosis) == {key}, (seed, diagnosis.verdict, diagnosis.remainder)
        (found,) = diagnosis.causes
        told = {name: np.atleast_1d(each.value) for name, each in found.parameters.items()}
        std = {name: np.atleast_1d(each.std) for name, each in found.parameters.items()}
        for name, value in values.items():
            assert np.all(np.abs(told[name] - value) < 4 * std[name]), (seed, name, told[name], value)
        groups = [set(group.effects) for group in diagnosis.indistinguishable]
        assert groups == ([{key, *alike}] if alike else []), (seed, groups)


@pytest.mark.parametrize("stage", [STAGE, without_autocollimator()], ids=["with", "without autocollimator"])
def test_a_stage_as_described_has_no_gap(stage):
    """At a false-alarm rate of 1 % two of fourteen alarm once in a hundred times."""
    found = [diagnosed(recorded(seed, stage=stage), stage) for seed in seeds(14)]
    verdicts = [diagnosis.verdict for diagnosis in found]
    assert verdicts.count(Verdict.NO_GAP) >= 13 / 14 * len(verdicts), verdicts
    assert not [remark for diagnosis in found for remark in diagnosis.remarks if "noise is" in remark]


def test_axial_error_motion_is_named_and_one_probe_does_not_tell_it_from_its_target():
    assert_named(
        AXIAL, ("spindle_axial", "order_2"), {"cos": 2.1e-7, "sin": 2.1e-7}, alike=[("probe_form", f"{TOP}.order_2")]
    )


def test_moving_the_probe_is_what_tells_axial_error_motion_from_its_target():
    """The form of the target comes later at another azimuth, the axis moves all of it at once."""
    (group,) = diagnosed(recorded(0, AXIAL)).indistinguishable
    assert group.advice.startswith(f"move {TOP} by 35° around the axis and record again"), group.advice


def test_a_second_axial_probe_tells_axial_error_motion_from_the_form_of_a_target():
    other = replace(STAGE.sensors[TOP], place={"azimuth": 2.4, "radius": 0.05})
    stage = replace(STAGE, sensors={**STAGE.sensors, "axial_probe_side": other})
    assert_named(AXIAL, ("spindle_axial", "order_2"), {"cos": 2.1e-7, "sin": 2.1e-7}, range(2), stage)
    form = Withheld(form={TOP: ((2, 2.1e-7, 2.1e-7),)})
    assert_named(form, ("probe_form", f"{TOP}.order_2"), {"cos": 2.1e-7, "sin": 2.1e-7}, range(2), stage)


def test_a_probe_on_the_axis_has_no_target_whose_form_it_could_be():
    central = replace(STAGE.sensors[TOP], place={"azimuth": 0.0, "radius": 0.0})
    stage = replace(
        STAGE, sensors={TOP: central}, spindle=replace(STAGE.spindle, axial=(AngularHarmonic(3, 3e-7, 2e-7),))
    )
    assert_named(AXIAL, ("spindle_axial", "order_2"), {"cos": 2.1e-7, "sin": 2.1e-7}, range(2), stage)


def test_radial_error_motion_is_the_axis_s_and_no_probe_s():
    assert_named(RADIAL, ("spindle_radial", "order_3"), {"x": (2e-7, -1e-7), "y": (1e-7, 2e-7)})


def test_the_form_of_a_target_is_that_probe_s():
    for stream in (LOW, HIGH):
        withheld = Withheld(form={stream: ((3, 2e-7, -1e-7),)})
        assert_named(withheld, ("probe_form", f"{stream}.order_3"), {"cos": 2e-7, "sin": -1e-7}, range(2))


def test_two_orders_of_one_target_are_two_causes():
    withheld = Withheld(form={HIGH: ((3, 2e-7, 2e-7), (5, -1e-7, 2e-7))})
    found = [causes_of(diagnosed(recorded(seed, withheld))) for seed in range(2)]
    assert found == [{("probe_form", f"{HIGH}.order_{order}") for order in (3, 5)}] * 2


@pytest.mark.parametrize(
    ("withheld", "key", "values"),
    [
        (Withheld(drift={LOW: 1e-8}), ("probe_drift", LOW), {"rate": 1e-8}),
        (Withheld(zero={HIGH: -3e-6}), ("probe_zero", HIGH), {"shift": -3e-6}),
        (Withheld(growth=5e-7), ("axial_growth", ""), {"axial": 5e-7}),
    ],
    ids=["drift", "zero", "growth"],
)
def test_what_else_goes_wrong_with_a_probe_is_named(withheld, key, values):
    assert_named(withheld, key, values, range(3))


def test_the_scale_of_a_probe_is_named_where_it_sees_what_is_known():
    """The described order 2 of the axis, read a fifth too large, looks like a form of order 2 as well."""
    withheld = Withheld(gain={HIGH: 0.2})
    alike = [("probe_form", f"{HIGH}.order_2")]
    assert_named(withheld, ("probe_gain", HIGH), {"relative": 0.2}, range(3), alike=alike)


def test_two_radial_probes_show_the_tilt_of_a_stage_without_autocollimator():
    values = {"x": (2e-6, -1e-6), "y": (1e-6, 2e-6)}
    assert_named(TILT, ("spindle_tilt", "order_3"), values, range(4), without_autocollimator())


def cut(streams, name, first, last):
    time, fields, values = streams[name]
    kept = (time >= first) & (time < last)
    return {**streams, name: (time[kept], fields, values[kept])}


def held(streams, name, since):
    time, fields, values = streams[name]
    return {**streams, name: (time, fields, np.where(time[:, None] < since, values, values[time < since][-1]))}


def test_a_probe_that_falls_silent_says_what_it_said_until_then():
    for seed in range(2):
        diagnosis = diagnosed(cut(recorded(seed, AXIAL), TOP, 0.0, SECONDS / 2))
        assert causes_of(diagnosis) == {("spindle_axial", "order_2")}
        (remark,) = (remark for remark in diagnosis.remarks if TOP.removeprefix("axial_probe_") in remark)
        assert "no sample in the last 8.0 s" in remark


def test_a_probe_that_is_stuck_is_left_out_from_then_on():
    for seed in range(2):
        for withheld, key in ((AXIAL, {("spindle_axial", "order_2")}), (Withheld(), set())):
            diagnosis = diagnosed(held(recorded(seed, withheld), TOP, SECONDS / 2))
            assert causes_of(diagnosis) == key and (key or diagnosis.verdict is Verdict.NO_GAP)
            (remark,) = (remark for remark in diagnosis.remarks if remark.startswith(f"{TOP}: stuck"))
            assert re.search(r"stuck at .* µm from 8.0 s on; 80. equal samples are left out", remark), remark


def test_a_probe_that_begins_late_is_diagnosed_in_a_long_recording():
    """It goes through stretches of which the first ones have no such stream."""
    withheld = Withheld(form={HIGH: ((3, 2e-7, 1e-7),)})
    streams = recorded(2, withheld, seconds=5 * SECONDS)
    assert causes_of(diagnosed(cut(streams, HIGH, 3 * SECONDS, np.inf))) == {("probe_form", f"{HIGH}.order_3")}


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (
            lambda streams: {name: stream for name, stream in streams.items() if name != TOP},
            "described, but not recorded",
        ),
        (lambda streams: cut(streams, TOP, 0.0, 0.6), "only 60 samples; 200 are needed; left out"),
        (lambda streams: held(streams, TOP, 0.3), f"{TOP}: stuck at"),
        (
            lambda streams: {**streams, TOP: (streams[TOP][0] + 3e3, *streams[TOP][1:])},
            "do not overlap; stamp all streams by one clock; left out",
        ),
        (
            lambda streams: {**streams, TOP: (*streams[TOP][:2], np.full_like(streams[TOP][2], np.nan))},
            "samples are not finite .*; left out",
        ),
    ],
    ids=["absent", "short", "stuck", "another clock", "no numbers"],
)
def test_a_probe_of_no_use_is_left_out_and_the_others_are_diagnosed(broken, told):
    diagnosis = diagnosed(broken(recorded(1, RADIAL)))
    assert causes_of(diagnosis) == {("spindle_radial", "order_3")}
    remarks = "\n".join(diagnosis.remarks)
    assert re.search(told, remarks), remarks


@pytest.fixture
def written(tmp_path):
    """Function that writes recording and twin, and gives the arguments of `diagnose`."""

    def write(streams, stage):
        write_messages(tmp_path / "bag", {samples_topic(name): blocks for name, blocks in blocks_of(streams).items()})
        twin = tmp_path / "twin.yaml"
        twin.write_text(yaml.safe_dump({"stage": stage_mapping(stage)}, sort_keys=False), encoding="utf-8")
        return ["diagnose", str(tmp_path / "bag"), "--twin", str(twin), "-o", str(tmp_path / "out")]

    return write


def test_from_file_to_file(written, tmp_path, capsys):
    streams = {name: stream for name, stream in recorded(2, AXIAL).items() if name != LOW}
    improved = tmp_path / "improved.yaml"
    arguments = written(streams, STAGE)
    assert main([*arguments, "--write-twin", str(improved)]) == 10
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(cause["effect"], cause["location"]) for cause in content["causes"]] == [("spindle_axial", "order_2")]
    assert content["where"][0]["channel"] == "/stage/axial_probe_top/samples.displacement"
    assert any("/stage/radial_probe_low/samples: described, but not recorded" in each for each in content["remarks"])
    page = (tmp_path / "out" / "diagnosis.html").read_text(encoding="utf-8")
    assert "probe_form at axial_probe_top.order_2" in page
    (axial,) = (row for row in yaml.safe_load(improved.read_text())["stage"]["spindle"]["axial"] if row["order"] == 2)
    assert axial["cos"] == pytest.approx(2.1e-7, rel=0.05)
    arguments[3] = str(improved)
    assert main([*arguments[:-1], str(tmp_path / "again")]) == 0, "the improved twin has no gap"


def test_a_recording_without_the_autocollimator_says_what_to_do(written, capsys):
    blind = {name: stream for name, stream in recorded(0).items() if name != "autocollimator"}
    assert main(written(blind, STAGE)) == 2
    said = capsys.readouterr().err
    assert "no message on /stage/autocollimator/samples" in said
    assert "a stage without autocollimator is described without the section 'autocollimator'" in said
    with pytest.raises(InputError, match="is described without the section 'autocollimator'"):
        diagnosed(blind)


def test_a_recording_without_a_head_says_what_to_do(written, capsys):
    streams = {name: stream for name, stream in recorded(0).items() if name != "head_b"}
    assert main(written(streams, STAGE)) == 2
    said = capsys.readouterr().err
    assert "no message on /stage/head_b/samples" in said
    assert "; a stage without head b is described without b in 'encoder.heads'" in said


def test_residuals_of_a_probe_are_shown_in_micrometres():
    blocks = blocks_of(recorded(0, AXIAL))
    problem = stage_problem(STAGE, record_stage(blocks, "abcd", listed=tuple(STAGE.sensors)), EFFECTS)
    over_rotation, over_time = problem.views(["/stage/axial_probe_top/samples.displacement"], ())
    assert over_rotation.unit == over_time.unit == "µm"
    axial, tilt = STAGE.spindle.axial[0], STAGE.spindle.tilt[0]
    at = 0.02 * np.array([np.cos(0.3), np.sin(0.3)])
    (time, _, read), (angle, _) = recorded(0, AXIAL)[TOP], command(recorded(0, AXIAL)[TOP][0]).T
    lean = [part[0] * np.cos(2 * angle) + part[1] * np.sin(2 * angle) for part in (tilt.x, tilt.y)]
    predicted = 1e-6 + axial.cos * np.cos(angle) + axial.sin * np.sin(angle) + lean[0] * at[1] - lean[1] * at[0]
    np.testing.assert_allclose(over_time.before, 1e6 * (read[:, 0] - predicted), atol=1e-6)
    np.testing.assert_allclose(over_time.x, time, atol=1e-9)


def test_what_a_stage_lists_is_of_no_matter_to_one_that_lists_nothing():
    bare = replace(STAGE, sensors={})
    sensors = {TOP: ListedSensor("axial_probe", 8e-9, 1e-9, 1e-4, 2e-7, place={"radius": 0.02})}
    streams = {name: stream for name, stream in recorded(0).items() if name not in STAGE.sensors}
    recording = record_stage(blocks_of(streams), "abcd")
    plain = {effect.name for effect in stage_problem(bare, recording, EFFECTS).effects}
    listing = {effect.name for effect in stage_problem(replace(bare, sensors=sensors), recording, EFFECTS).effects}
    assert listing - plain == {"spindle_axial", "axial_growth", "probe_zero", "probe_gain", "probe_drift", "probe_form"}
