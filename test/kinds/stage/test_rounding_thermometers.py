"""Thermometers as they are sold: they round to a tenth or half a degree, and their zero is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import stage_problem as problem_of
from rotary_error_monitor.twin.recording import SignalStream

EFFECTS = load_effects(StageEffect)

CASES = 24


def bought(seed, read, steps):
    """Readings (n, 1) of a thermometer out of a box: IEC 60751 lets class B be off by 0.4 K at 20 °C."""
    draw = np.random.default_rng([seed, 7])
    step, zero = draw.choice(steps), draw.uniform(-0.4, 0.4)
    return np.rint((read + zero) / step) * step


def diagnosed(problem, seed, steps):
    """The problem with such a thermometer, that rounds to one of the steps, K."""
    read = problem.recording.streams["temperature"]
    streams = {**problem.recording.streams, "temperature": SignalStream(read.time, bought(seed, read.values, steps))}
    return diagnose(problem_of(problem.stage, replace(problem.recording, streams=streams), EFFECTS))


def test_a_stage_that_drifts_as_stated_has_no_gap_by_it(stage_problem):
    """Most of them were unknown."""
    found = [diagnosed(stage_problem(seed, "null")[0], seed, (0.1, 0.25, 0.5)) for seed in seeds(CASES, 700)]
    assert sum(each.verdict is not Verdict.NO_GAP for each in found) <= 0.1 * len(found), "of a hundred one alarms"


@pytest.mark.parametrize("effect", ["thermal_drift", "unbalance"])
def test_causes_are_named_beside_it(effect, stage_problem):
    """The stages warm by 1.1 to 3.3 K: what steps of half a degree leave open of that hides the form of a drift."""
    right = 0
    for seed in seeds(CASES, 740):
        found = diagnosed(stage_problem(seed, "single", [effect], snr=(60.0, 300.0))[0], seed, (0.1, 0.25))
        right += [each.cause.effect.name for each in found.causes] == [effect]
    assert right >= 0.95 * len(seeds(CASES)) - 0.5
