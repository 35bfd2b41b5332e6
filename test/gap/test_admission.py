"""Recordings and twins that are not worth a diagnosis are refused, with what can be said all the same."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.admission import check_stage
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.stage.problem import StageProblem
from rotary_error_monitor.plant.cases import make_stage_case
from rotary_error_monitor.plant.motion import Motion, Segment
from rotary_error_monitor.twin.recording import record_stage, stage_topic
from rotary_error_monitor.twin.stage import twin_of

EFFECTS = load_effects(StageEffect)


def recorded(plant, length):
    topics = {}
    for stream in plant.streams:
        count = plant.index_at(stream, plant.epoch_ns + round(length * 1e9))
        topics[stage_topic(stream)] = [plant.samples(stream, 0, count)]
    return record_stage(topics, "abcd")


@pytest.fixture(scope="module")
def cases():
    return [make_stage_case(seed, "null", duration=20.0) for seed in (3, 4, 5, 6)]


@pytest.mark.parametrize("length", [2.0, 6.0, 11.5])
def test_a_short_recording_is_refused_with_what_can_be_said(cases, length):
    problem = StageProblem(cases[0].twin, recorded(cases[0].plant, length), EFFECTS)
    with pytest.raises(InputError) as error:
        diagnose(problem)
    told = str(error.value)
    assert "too little to hold data out" in told and "record at least 12 s and 1 turn" in told
    for sensor in ("head_a", "head_d", "autocollimator", "lvdt"):
        assert f"{sensor} " in told
    found, noise = re.search(r"autocollimator (\S+) µrad \(noise of one sample (\S+) µrad", told).groups()
    assert float(found) == pytest.approx(float(noise), rel=0.1)


@pytest.mark.parametrize("speed", [0.0, 0.2])
def test_a_stage_that_hardly_turns_is_refused(cases, speed):
    plant = replace(cases[0].plant, motion=Motion((Segment(60.0, speed),)))
    problem = StageProblem(cases[0].twin, recorded(plant, 20.0), EFFECTS)
    with pytest.raises(InputError, match=r"lasts 20\.0 s and 0(\.64)? turns of the stage: too little"):
        diagnose(problem)


def test_the_twin_of_any_other_stage_is_refused(cases):
    for case in cases:
        recording = recorded(case.plant, 20.0)
        for other in cases:
            twin = twin_of(other.twin, recording, ())
            raw = {name: recording.streams[name].values - values for name, values in twin.predict(()).items()}
            if other is case:
                check_stage(recording, raw, twin)
            else:
                with pytest.raises(InputError, match="It describes another stage") as error:
                    check_stage(recording, raw, twin)
                assert "head " in str(error.value) and "autocollimator " in str(error.value)


@pytest.mark.parametrize("effects", [["spindle_radial", "mirror_wobble"], ["disc_eccentricity", "spindle_tilt"]])
def test_the_strongest_effects_do_not_pass_for_another_stage(effects):
    case = make_stage_case(8, "pair", effects, (2900.0, 3000.0), rough=True, duration=20.0)
    topics = {stage_topic(stream): list(blocks) for stream, blocks in case.blocks.items()}
    recording = record_stage(topics, "abcd")
    twin = twin_of(case.twin, recording, ())
    raw = {name: recording.streams[name].values - values for name, values in twin.predict(()).items()}
    check_stage(recording, raw, twin)
