"""What a real thing does beyond a textbook effect, modulated: its zero wanders, and its temperature lags."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.description.stage import OWN_THERMOMETER
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.lagging import late
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import SignalStream

EFFECTS = load_effects(StageEffect)
LAG = 5.0
SEEDS = seeds(6, 1)
MISSED = len(SEEDS) // 4


def settling(rise, settles, time):
    """K above the beginning: a room that settles."""
    return rise * -np.expm1(-time / settles)


def settling_late(rise, settles, lag, time):
    """The same behind a thermal mass: closed form."""
    return rise * (1 - (settles * np.exp(-time / settles) - lag * np.exp(-time / lag)) / (settles - lag))


@pytest.mark.parametrize("lag", [0.5, 5.0, 40.0])
def test_what_is_late_follows_the_closed_form(lag):
    time = np.linspace(0.0, 40.0, 333)
    made = late(partial(settling, 3.0, 12.0), 40.0, lag)(time)
    np.testing.assert_allclose(made, settling_late(3.0, 12.0, lag, time), atol=2e-4)


def shown(problem, cause):
    """What a cause does to each stream that it moves."""
    moved, base = problem.twin.predict((cause,)), problem.twin.predict(())
    return {name: moved[name] - base[name] for name in moved if np.any(moved[name] != base[name])}


def with_added(problem, added):
    """The same problem with signals added to its recording."""
    streams = dict(problem.recording.streams)
    for name, values in added.items():
        streams[name] = SignalStream(streams[name].time, streams[name].values + values)
    return StageProblem(problem.stage, dataclasses.replace(problem.recording, streams=streams), EFFECTS)


def cause_of(truth):
    (fault,) = truth.faults
    effect = next(e for e in EFFECTS if e.name == fault.name)
    return Cause(effect, fault.location, effect.values_from(fault.parameters))


def is_named_alone(problem, cause, words):
    """Whether the cause is named, nothing beside it, and its departure told in these words."""
    diagnosis = diagnose(problem)
    named = [found.cause.key for found in diagnosis.causes]
    told = [row.pattern for found in diagnosis.causes for row in found.departures]
    return diagnosis.verdict is Verdict.EXPLAINED and named == [cause.key] and any(words in row for row in told)


@pytest.mark.few(1)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_zero_of_a_displaced_head_may_wander(direction, stage_problem):
    """Its bracket creeps along the ring by a tenth of what the head is wrong by: of no order is there such a signal."""
    told = []
    for seed in SEEDS:
        problem, truth = stage_problem(2400 + seed, "single", ["head_misplacement"], (2000.0, 3000.0), duration=40.0)
        cause = cause_of(truth)
        added = {}
        for name, values in shown(problem, cause).items():
            crept = 0.5 + settling_late(1.0, 15.0, LAG, problem.twin.times[name])
            added[name] = 0.1 * direction * np.std(values) * crept[:, None]
        told.append(is_named_alone(with_added(problem, added), cause, "its zero wanders"))
    assert sum(told) >= len(SEEDS) - MISSED, told


@pytest.mark.long
def test_what_wanders_at_another_head_is_no_departure(stage_problem):
    """Of a head that is where it should be nothing may wander with another one that is not."""
    for seed in SEEDS[:2]:
        problem, truth = stage_problem(2400 + seed, "single", ["head_misplacement"], (2000.0, 3000.0), duration=40.0)
        cause = cause_of(truth)
        (name,) = shown(problem, cause)
        other = next(head for head in problem.recording.heads if head != name)
        crept = settling_late(1.0, 15.0, LAG, problem.twin.times[other])
        size = 0.2 * np.std(shown(problem, cause)[name])
        diagnosis = diagnose(with_added(problem, {other: size * crept[:, None]}))
        assert diagnosis.verdict is not Verdict.EXPLAINED


@pytest.mark.parametrize("name", ["unbalance", "mirror_flatness"])
def test_an_effect_may_grow_with_a_temperature_that_lags(name, stage_problem):
    """By 15 % over the recording; where it warms steadily, time is as good."""
    told = []
    for seed in SEEDS:
        problem, truth = stage_problem(2500 + seed, "single", [name], snr=(600.0, 900.0), duration=40.0)
        cause = cause_of(truth)
        added = {}
        for stream, values in shown(problem, cause).items():
            warm = late(problem.twin.inputs.warming, 40.0, LAG)(problem.twin.times[stream])
            added[stream] = 0.15 * (warm / np.ptp(warm))[:, None] * values
        told.append(is_named_alone(with_added(problem, added), cause, "grows with"))
    assert sum(told) >= len(SEEDS) - MISSED, told


def test_a_housing_may_lag_behind_its_thermometer(stage_problem):
    """What drifts with the temperature drifts with that of its own part; the thermometer follows at once, or as late a
    one would do the same to what the twin states to drift.
    """
    told = []
    for seed in SEEDS:
        made, truth = stage_problem(2600 + seed, "single", ["thermal_drift"], snr=(600.0, 900.0), duration=40.0)
        stage = dataclasses.replace(made.stage, uncertainty=made.stage.uncertainty | {OWN_THERMOMETER + "_timing": 0.0})
        problem = StageProblem(stage, made.recording, EFFECTS)
        cause = cause_of(truth)
        inputs = dataclasses.replace(problem.twin.inputs, warming=late(problem.twin.inputs.warming, 40.0, LAG))
        lagging = problem.twin.driven_by(inputs)
        moved, base = lagging.predict((cause,)), lagging.predict(())
        added = {name: moved[name] - base[name] - values for name, values in shown(problem, cause).items()}
        told.append(is_named_alone(with_added(problem, added), cause, "lags behind the thermometer"))
    assert sum(told) >= len(SEEDS) - MISSED, told
