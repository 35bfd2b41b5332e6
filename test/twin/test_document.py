"""Descriptions survive being written and read again; effects without a parameter of their own survive as rows."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from described_stages import stage_of

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.machine import load_machine, machine_from_mapping, machine_mapping
from rotary_error_monitor.description.stage import TIMINGS, load_stage, stage_mapping
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.twin.document import causes_from_rows, effect_rows
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters


def again(content):
    return yaml.safe_load(yaml.safe_dump(content, sort_keys=False))


def test_a_stage_is_written_as_it_was_read():
    for stage in (load_stage(), make_stage_case(3, "null", rough=True, duration=10.0).twin):
        content = again({"stage": stage_mapping(stage)})
        assert stage_of(content["stage"]) == stage


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt"])
def test_a_machine_is_written_as_it_was_read(name):
    machine = load_machine(name)
    content = again({"machine": machine_mapping(machine)})
    assert machine_from_mapping(content["machine"]) == machine


def test_effects_are_written_as_the_vocabulary_names_them():
    effects = load_effects(StageEffect)
    bearing = effect_named("bearing_asynchronous", effects)
    values = bearing.values_from({"order": 3.4, "radial": 2e-7, "tilt": 1e-6, "phase": 0.5})
    late = effect_named("head_latency", effects)
    causes = (Cause(bearing, "", values), Cause(late, "head_b", np.array([2e-5])))
    rows = again(effect_rows(causes))
    assert rows[1] == {"effect": "head_latency", "location": "head_b", "parameters": {"delay": 2e-5}}
    read = causes_from_rows(rows, effects, "twin.yaml")
    assert [cause.key for cause in read] == [cause.key for cause in causes]
    np.testing.assert_allclose(read[0].values, values, rtol=1e-12)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({"effect": "unbalance"}, "expected a list of rows"),
        ([{"effect": "unbalance"}], "row 1"),
        ([{"effect": "wobble", "parameters": {}}], "no effect is called 'wobble'"),
        ([{"effect": "disc_scale", "parameters": {"relativ": 1}}], "expected \\['relative'\\]"),
    ],
)
def test_wrong_rows_are_told(rows, message):
    with pytest.raises(InputError, match=message):
        causes_from_rows(rows, load_effects(StageEffect), "twin.yaml")


def test_uncertain_parameters_are_moved_one_by_one():
    stage = make_stage_case(3, "null", rough=True, duration=10.0).twin
    parameters = {parameter.name: parameter for parameter in uncertain_parameters(stage)}
    moved = parameters["encoder.azimuth[b]"].shifted(stage, 0.002)
    assert moved.encoder.azimuths["b"] == pytest.approx(stage.encoder.azimuths["b"] + 0.002)
    assert moved.encoder.azimuths["a"] == stage.encoder.azimuths["a"]
    row = parameters["spindle.radial[1][y][0]"].shifted(stage, 1e-7).spindle.radial[1]
    assert row.y[0] == pytest.approx(stage.spindle.radial[1].y[0] + 1e-7)
    assert row.x == stage.spindle.radial[1].x
    radius = parameters["encoder.disc_radius"]
    assert radius.uncertainty == stage.uncertainty["encoder.disc_radius"]
    assert radius.shifted(stage, 1e-5).encoder.disc_radius == pytest.approx(stage.encoder.disc_radius + 1e-5)


def test_an_uncertainty_of_nothing_is_an_error():
    content = stage_mapping(load_stage())
    content["uncertainty"] = {"encoder.wobble": 1e-6}
    with pytest.raises(InputError, match=r"encoder\.wobble"):
        uncertain_parameters(stage_of(content))


def test_stamps_may_be_uncertain_and_move_no_number():
    """The default states it of its stamps; a twin with or without them is the same twin."""
    stage = load_stage()
    assert set(stage.uncertainty) == set(TIMINGS)
    assert uncertain_parameters(stage) == ()
    assert stage_of(stage_mapping(stage)).uncertainty == stage.uncertainty
