"""Drift with the temperature of one of several places; the recordings are those of a world written apart."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import yaml
from described_stages import by_stream, stage_of
from world import Options, make_recording

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.kinds.stage.experiments import advise
from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.kinds.stage.warming import uncertain_warmings
from rotary_error_monitor.kinds.stage.where import describe
from rotary_error_monitor.resources import config
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import StageTwin, twin_of

EFFECTS = load_effects(StageEffect)
KNOWN = {effect.name: effect for effect in EFFECTS}
PLACES = ("bearing", "housing")
DRIFT = (2e-7, -1e-7)
THERMOMETER = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1}
SECONDS = 30.0


def section(places: Sequence[str] = PLACES):
    """The embedded stage with thermometers at places, and no drift with the stage's own temperature."""
    found = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))["stage"]
    del found["lvdt"]
    found["spindle"]["radial_thermal"] = [0.0, 0.0]
    found["sensors"] = dict.fromkeys(places, THERMOMETER)
    return found


def recorded(seed, drifts, seconds=SECONDS):
    """A world in which the axis drifts with the warming of places, m/K by place."""
    rates = {f"/stage/head_{head}/samples": 200.0 for head in "abcd"}
    habits = {"noise": 1.0, "quantise": True, "jitter": 1.0, "temperature": True}
    options = Options.textbook(motion="both_directions", peak_speed=5.0, rates=rates, place_drift=drifts, **habits)
    return make_recording(seed, duration=seconds, stage=section(), options=options)


def problem_of(recording, places=PLACES):
    """Of a stage that lists thermometers at some of the places; the others are in no file and no bag."""
    stage = stage_of(section(places))
    gone = [f"/stage/thermometer_{place}/samples" for place in PLACES if place not in places]
    topics = {topic: blocks for topic, blocks in recording.blocks.items() if topic not in gone}
    return stage_problem(
        stage, record_stage(by_stream(topics), "abcd", without=("lvdt",), listed=tuple(stage.listed)), EFFECTS
    )


def drifts_named(diagnosis, least):
    """Places of the thermal drifts that are named with a probability above the least."""
    return {
        found.cause.location: found
        for found in diagnosis.causes
        if found.cause.effect.name == "thermal_drift" and found.probability > least
    }


def test_a_drift_is_named_at_the_place_that_it_goes_with():
    """Ten of each place at most: courses of two places may be alike by chance. The drift is right within a tenth."""
    for place in PLACES:
        right = 0
        for seed in range(10):
            found = drifts_named(diagnose(problem_of(recorded(seed, {place: DRIFT}))), 0.5)
            near = place in found and np.allclose(found[place].parameters["radial"].value, DRIFT, rtol=0.1)
            right += set(found) == {place} and near
        assert right >= 9, (place, right)


def test_another_place_is_rarely_named_where_the_thermometer_is_missing():
    wrong = 0
    for seed in range(10):
        for place, other in (PLACES, PLACES[::-1]):
            wrong += bool(drifts_named(diagnose(problem_of(recorded(seed, {place: DRIFT}), (other,))), 0.9))
    assert wrong <= 4, f"{wrong} of 20"


def test_a_thermometer_is_no_sensor_of_the_rotor_s_pose():
    problem = problem_of(recorded(0, {}, 12.0))
    assert set(problem.twin.times) == {"autocollimator", *(f"head_{head}" for head in "abcd")}
    assert set(problem.twin.inputs.warmings) == set(PLACES)
    places = {effect.name: effect.locations(problem.stage) for effect in problem.effects if effect.warms}
    assert places == {"thermal_drift": ("", *PLACES)}, "no sensor would show axial growth"


def test_the_warming_of_a_place_is_what_the_world_had():
    recording = recorded(3, {})
    warmings, time = problem_of(recording).twin.inputs.warmings, np.linspace(1.0, SECONDS - 1.0, 200)
    start = min(int(blocks[0].stamp_ns) for blocks in recording.blocks.values())
    for place in PLACES:
        true = recording.truth.environment.warmth_of(place, time + (start - recording.start_ns) * 1e-9)
        assert np.abs(warmings[place](time) - true).max() < 0.1 * 4 + 0.1, "four uncertainties of its zero, and noise"
        assert np.ptp(warmings[place](time) - true) < 0.2


def test_effects_at_places_follow_the_formula():
    """Radial drift and axial growth in proportion to the warming of their place, by a closed form."""
    problem = problem_of(recorded(1, {}, 12.0))
    probe = {
        "kind": "axial_probe",
        "radius": 0.0,
        "noise": 1e-8,
        "resolution": 1e-9,
        "range": 1e-4,
        "uncertainty": 1e-7,
    }
    stage = stage_of(section() | {"sensors": {**section()["sensors"], "nose": probe}})
    time = np.linspace(0.0, 10.0, 50)
    twin = StageTwin(stage, problem.twin.inputs, {"head_a": time, "head_c": time, "axial_probe_nose": time})
    causes = (
        Cause(KNOWN["thermal_drift"], "housing", np.array(DRIFT)),
        Cause(KNOWN["axial_growth"], "bearing", np.array([3e-7])),
    )
    moved, plain = twin.predict(causes), twin.predict()
    warm = {place: problem.twin.inputs.warmings[place](time) for place in PLACES}
    apart = {name: moved[name][:, 0] - plain[name][:, 0] for name in twin.times}
    radius = stage.encoder.disc_radius
    np.testing.assert_allclose(apart["axial_probe_nose"], 3e-7 * warm["bearing"], atol=1e-15)
    np.testing.assert_allclose(apart["head_a"], warm["housing"] * DRIFT[1] / radius, rtol=1e-3, atol=1e-10)
    np.testing.assert_allclose(apart["head_c"], -warm["housing"] * DRIFT[0] / radius, rtol=1e-3, atol=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_thermometer_does_not_tell_acts_beside_causes_at_its_place(seed):
    """By a closed form: its zero is uncertain, and by half a step where it cuts off; the two are independent."""
    uncertainty, resolution = 10.0 ** np.random.default_rng(seed).uniform(-2.0, 0.0, 2)
    problem = problem_of(recorded(seed, {}, 12.0))
    stage = stage_of(section())
    stated = {
        name: replace(sensor, uncertainty=uncertainty, resolution=resolution) for name, sensor in stage.inputs.items()
    }
    twin = StageTwin(replace(stage, inputs=stated), problem.twin.inputs, {"head_a": np.linspace(0.0, 10.0, 50)})
    warmed = uncertain_warmings(twin, problem.recording)
    assert len(warmed) == 2 * (1 + 8), "the zero and eight slow courses of each"
    cause = Cause(KNOWN["thermal_drift"], "bearing", np.array(DRIFT))
    plain = twin.predict((cause,))["head_a"]
    moved = [other.predict((cause,))["head_a"] - plain for other in warmed]
    expected = np.hypot(uncertainty, resolution / 2) * DRIFT[1] / stage.encoder.disc_radius
    np.testing.assert_allclose(moved[0][:, 0], expected, rtol=1e-4)
    assert all(np.any(each) for each in moved[:9]) and not any(np.any(each) for each in moved[9:])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda topics, name: topics.pop(name), "described, but not recorded; left out"),
        (
            lambda topics, name: topics.update({name: [replace(b, rows=b.rows + [0.0, 200.0]) for b in topics[name]]}),
            r"read 22.* °C, the end of its range or beyond \(100\); left out",
        ),
    ],
    ids=["absent", "beyond its range"],
)
def test_a_thermometer_of_no_use_is_left_out_and_said(change, told):
    topics = dict(recorded(1, {}, 12.0).blocks)
    change(topics, "/stage/thermometer_bearing/samples")
    stage = stage_of(section())
    problem = stage_problem(
        stage, record_stage(by_stream(topics), "abcd", without=("lvdt",), listed=tuple(stage.listed)), EFFECTS
    )
    assert set(problem.stage.thermometers) == {"housing"} == set(problem.twin.inputs.warmings)
    assert any(re.search(f"thermometer_bearing.*{told}", remark) for remark in problem.recording.remarks)


def test_what_the_twin_states_to_go_with_a_place_that_nobody_read_is_uncertain():
    problem = problem_of(recorded(1, {}, 12.0), ("housing",))
    cause = Cause(KNOWN["thermal_drift"], "bearing", np.array(DRIFT))
    twin = twin_of(problem.stage, problem.recording, (cause,))
    warmed = uncertain_warmings(twin, problem.recording)
    assert len(warmed) == 9 + 4, "of the one that is read, and a course of any kind of the other"
    cold = twin.predict((), ["head_a"])["head_a"]
    assert all(np.any(other.predict((), ["head_a"])["head_a"] != cold) for other in warmed[9:])


def test_warming_one_place_alone_is_what_tells_two_places_apart():
    problem = problem_of(recorded(1, {}, 12.0))
    cause = Cause(KNOWN["thermal_drift"], "bearing", np.array(DRIFT))
    advice = advise(problem, [("thermal_drift", "bearing"), ("thermal_drift", "housing")], (cause,))
    assert re.match(r"record again while (bearing|housing) warms by 5 K more than the other thermometers", advice), (
        advice
    )


def test_where_a_gap_lies_says_with_which_place_it_goes():
    state = problem_of(recorded(3, {}, 12.0)).twin.state("head_a")
    gap = state.warmings["housing"] - state.warmings["housing"].mean()
    assert describe(gap, state, float(np.mean(np.square(gap)))).startswith("temperature of housing (100%)")


def test_from_file_to_file(tmp_path):
    """The improved twin holds the drift as an effect at its place, for a description has none there, and has no gap."""
    recording = recorded(1, {"bearing": DRIFT})
    write_messages(tmp_path / "bag", recording.blocks)
    twin, improved = tmp_path / "twin.yaml", tmp_path / "improved.yaml"
    twin.write_text(yaml.safe_dump({"stage": section()}, sort_keys=False), encoding="utf-8")
    arguments = ["diagnose", str(tmp_path / "bag"), "--no-report", "--twin"]
    assert main([*arguments, str(twin), "-o", str(tmp_path / "one"), "--write-twin", str(improved)]) == 10
    content = json.loads((tmp_path / "one" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(cause["effect"], cause["location"]) for cause in content["causes"]] == [("thermal_drift", "bearing")]
    written = yaml.safe_load(improved.read_text(encoding="utf-8"))
    (row,) = written["effects"]
    assert (row["effect"], row["location"]) == ("thermal_drift", "bearing")
    assert written["stage"]["sensors"]["bearing"] == {**THERMOMETER, "zero": 0.0}
    assert main([*arguments, str(improved), "-o", str(tmp_path / "two")]) == 0
