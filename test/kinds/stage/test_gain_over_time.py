"""A gain that comes and goes in time as no other quantity of the recording does: a triangle, a sine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds
from scipy.signal import sawtooth

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap import departure_selection
from rotary_error_monitor.gap.departure_selection import likeliest_kinds
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.lagging import late
from rotary_error_monitor.kinds.stage.stretches import stage_problem as problem_of
from rotary_error_monitor.twin.recording import SignalStream

EFFECTS = load_effects(StageEffect)

COURSES = {
    "triangle": lambda draw, time, warming: sawtooth(phase(draw, time), 0.5),
    "sine": lambda draw, time, warming: np.sin(phase(draw, time)),
    "what a late temperature leaves of time": lambda draw, time, warming: left_of_time(time, warming),
}


def phase(draw, time):
    """Of something that comes and goes once or twice."""
    return 2 * np.pi * time / draw.uniform(15.0, 30.0) + draw.uniform(0, 6)


def left_of_time(time, warming):
    """What a part that follows the temperature does, less what goes with time: far smaller than either."""
    followed = late(warming, float(time[-1]), float(time[-1]) / 4)(time)
    left = followed - np.polyval(np.polyfit(time, followed, 1), time)
    return left / (np.std(left) * np.sqrt(2))


def diagnosed(stage_problem, seed, form):
    """Diagnosis of a gain of the LVDT that a course changes by 15 %, and the axis that has it."""
    draw = np.random.default_rng([seed, 15])
    problem, truth = stage_problem(seed, "single", ["lvdt_gain"], snr=(300.0, 600.0), duration=40.0)
    (fault,) = truth.faults
    axis, gain, read = "xy".index(fault.location), fault.relative, problem.recording.streams["lvdt"]
    course = COURSES[form](draw, read.time, problem.twin.inputs.warming)
    values = read.values.copy()
    values[:, axis] *= (1 + gain * (1 + 0.15 * course)) / (1 + gain)
    streams = {**problem.recording.streams, "lvdt": SignalStream(read.time, values)}
    return diagnose(problem_of(problem.stage, replace(problem.recording, streams=streams), EFFECTS)), fault.location


def is_right(found, axis):
    """Whether the gain is named alone, with a departure."""
    named = [each.cause.key for each in found.causes] == [("lvdt_gain", axis)]
    return named and found.verdict is Verdict.EXPLAINED and bool(found.causes[0].departures)


@pytest.mark.parametrize("form", COURSES)
def test_it_is_named_with_its_course(form, stage_problem):
    assert np.mean([is_right(*diagnosed(stage_problem, seed, form)) for seed in seeds(12, 1600)]) >= 0.9


def test_kinds_of_most_evidence_that_cancel_stand_back(stage_problem, monkeypatch):
    """A recording of another plant was unknown so, its cause ranked first with nine parts of ten: the course is a tenth
    of the gain, and the two kinds between which it lies are each four times as large.
    """
    cancel = {"time", "lagging temperature"}

    def likeliest(gram, moment, labels, least=0.0):
        both = {label for label in labels if label[1] in cancel}
        # They have the most evidence, where both are offered.
        return (both, 0.0) if len({kind for _, kind in both}) == 2 else likeliest_kinds(gram, moment, labels, least)

    monkeypatch.setattr(departure_selection, "likeliest_kinds", likeliest)
    form = "what a late temperature leaves of time"
    assert np.mean([is_right(*diagnosed(stage_problem, seed, form)) for seed in seeds(6, 1600)]) >= 0.8
