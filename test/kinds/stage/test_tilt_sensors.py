"""Diagnosis of a stage with a second autocollimator; its recordings are written out with numpy (`probed_stage.py`)."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from kinds.stage.test_listed_sensors import TILT, assert_named, causes_of, diagnosed, held, written  # noqa: F401
from probed_stage import SECOND, SECONDS, WITH_SECOND, Withheld, recorded, without_autocollimator

from rotary_error_monitor.cli import main
from rotary_error_monitor.gap.verdict import Verdict

ALONE = without_autocollimator(WITH_SECOND)


@pytest.mark.parametrize("stage", [WITH_SECOND, ALONE], ids=["with", "without autocollimator"])
def test_a_stage_as_described_has_no_gap(stage):
    """At a false-alarm rate of 1 % two of twelve alarm once in a hundred times."""
    found = [diagnosed(recorded(seed, stage=stage), stage) for seed in range(12)]
    verdicts = [diagnosis.verdict for diagnosis in found]
    assert verdicts.count(Verdict.NO_GAP) >= 11, verdicts
    assert not [remark for diagnosis in found for remark in diagnosis.remarks if "noise is" in remark]


def test_tilt_error_motion_is_the_axis_s_where_both_show_it():
    assert_named(TILT, ("spindle_tilt", "order_3"), {"x": (2e-6, -1e-6), "y": (1e-6, 2e-6)}, range(2), WITH_SECOND)


def test_one_tilt_sensor_alone_does_not_tell_tilt_error_motion_from_its_mirror():
    alike = [("tilt_sensor_form", f"{SECOND}.order_3")]
    values = {"x": (2e-6, -1e-6), "y": (1e-6, 2e-6)}
    assert_named(TILT, ("spindle_tilt", "order_3"), values, range(2), ALONE, alike)


@pytest.mark.parametrize(
    ("withheld", "key", "values"),
    [
        (Withheld(drift={SECOND: (2e-7, -1e-7)}), ("tilt_sensor_drift", SECOND), {"rate": (2e-7, -1e-7)}),
        (Withheld(zero={SECOND: (1e-5, 5e-6)}), ("tilt_sensor_zero", SECOND), {"shift": (1e-5, 5e-6)}),
        (
            Withheld(form={SECOND: ((3, (2e-6, -1e-6), (1e-6, 2e-6)),)}),
            ("tilt_sensor_form", f"{SECOND}.order_3"),
            {"x": (2e-6, -1e-6), "y": (1e-6, 2e-6)},
        ),
    ],
    ids=["drift", "zero", "form"],
)
def test_what_goes_wrong_with_it_is_named(withheld, key, values):
    assert_named(withheld, key, values, range(2), WITH_SECOND)


def test_the_scale_of_one_is_named_by_what_is_known_of_the_axis_and_the_mirror():
    for seed in range(2):
        diagnosis = diagnosed(recorded(seed, Withheld(gain={SECOND: 0.5}), WITH_SECOND), WITH_SECOND)
        assert causes_of(diagnosis) == {("tilt_sensor_gain", SECOND)}


def test_axes_that_are_turned_are_among_what_it_can_be():
    """A mirror askew the other way about shows nearly the same."""
    for seed in range(2):
        diagnosis = diagnosed(recorded(seed, Withheld(roll={SECOND: 0.8}), WITH_SECOND), WITH_SECOND)
        alike = {each for group in diagnosis.indistinguishable for each in group.effects}
        assert diagnosis.verdict is Verdict.EXPLAINED
        assert ("tilt_sensor_roll", SECOND) in causes_of(diagnosis) | alike


def test_one_that_is_stuck_is_left_out_from_then_on():
    diagnosis = diagnosed(held(recorded(0, stage=WITH_SECOND), SECOND, SECONDS / 2), WITH_SECOND)
    assert diagnosis.verdict is Verdict.NO_GAP
    (remark,) = (remark for remark in diagnosis.remarks if remark.startswith(f"{SECOND}: stuck"))
    assert "µrad from 8.0 s on" in remark


def test_noise_beyond_what_is_stated_is_told_of_it_alone():
    streams = recorded(1, stage=WITH_SECOND)
    time, fields, values = streams[SECOND]
    noisy = values + 6e-7 * np.random.default_rng(3).normal(size=values.shape)
    diagnosis = diagnosed({**streams, SECOND: (time, fields, noisy)}, WITH_SECOND)
    told = [re.fullmatch(r"(.+): noise is (.+) times what the twin states", each) for each in diagnosis.remarks]
    assert [each[1] for each in told if each] == [f"{SECOND}.x", f"{SECOND}.y"]
    assert [float(each[2]) for each in told if each] == pytest.approx([np.hypot(6e-7, 2e-7) / 2e-7] * 2, rel=0.1)


def test_from_file_to_file(written, tmp_path):  # noqa: F811
    """Diagnosed and described better by command: the improved twin has no gap."""
    form = Withheld(form={SECOND: ((3, (2e-6, -1e-6), (1e-6, 2e-6)),)})
    arguments, improved = written(recorded(1, form, WITH_SECOND), WITH_SECOND), tmp_path / "improved.yaml"
    assert main([*arguments, "--write-twin", str(improved)]) == 10
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(each["effect"], each["location"]) for each in content["causes"]] == [
        ("tilt_sensor_form", f"{SECOND}.order_3")
    ]
    assert content["where"][0]["channel"] in {f"/stage/{SECOND}/samples.tilt_{axis}" for axis in "xy"}
    arguments[3] = str(improved)
    assert main([*arguments[:-1], str(tmp_path / "again")]) == 0
