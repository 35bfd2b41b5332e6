"""Slow noise that is learnt beside causes takes no part of what they were mistaken for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.plant.noise_forms import WanderingNoise

EFFECTS = load_effects(StageEffect)
SEEDS = range(4, 12)


def slow_noise_beside_lost_counts(problem, head):
    """What is told of the heads' slow noise beside counts lost by one head, fitted alone where they fit best."""
    candidates = problem.candidates(problem.residual(()), ())
    lost = next(candidate for candidate in candidates if candidate.key == ("head_missed_counts", head))
    fit = fit_causes(problem, [lost.cause(np.zeros(len(lost.linear)))])
    problem.learn_noise(fit.causes)
    return [remark for remark in problem.remarks(fit.rest) if remark.startswith("head: slow noise")]


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_another_cause_leaves_of_a_fault_is_no_slow_noise(stage_problem, seed):
    """A late head of a stage that turns back looks like lost counts, which leave a slow 6 % of it.

    The cause in its place holds a part of the fault: only where it may be of another size is the fault, here one that
    goes with the speed and is no known effect, likelier than slow noise.
    """
    without = tuple(effect for effect in EFFECTS if effect.name != "head_latency")
    problem, truth = stage_problem(seed, "single", ["head_latency"], snr=(100.0, 200.0), stage_effects=without)
    assert not slow_noise_beside_lost_counts(problem, truth.faults[0].location)


@pytest.mark.long
def test_slow_noise_beside_a_cause_is_learnt(stage_problem):
    told, seeds = [], SEEDS[:3]
    for seed in seeds:
        problem, truth = stage_problem(seed, "single", ["head_missed_counts"], snr=(100.0, 200.0), noise="wander")
        told += slow_noise_beside_lost_counts(problem, truth.faults[0].location)
    assert len(told) >= len(seeds) - 1, told


def slow_noise_told_where_two_wander(problem, seed, *, alike):
    """Instruments whose slow noise is told: autocollimator and LVDT follow one slow course, or each one of its own."""
    streams = dict(problem.recording.streams)
    for name in ("autocollimator", "lvdt"):
        stream, values = streams[name], streams[name].values.copy()
        course = WanderingNoise(0.3, 2.0).shaped(
            np.zeros((len(values), 1)), Noise(seed, "one" if alike else name), stream.time
        )
        values[:, :1] += problem.noise.std[name] * course
        streams[name] = dataclasses.replace(stream, values=values)
    wandering = StageProblem(problem.stage, dataclasses.replace(problem.recording, streams=streams), EFFECTS)
    wandering.learn_noise(())
    told = [remark for remark in wandering.remarks(wandering.residual(())) if "slow noise" in remark]
    return {name for name in ("autocollimator", "lvdt") if any(remark.startswith(name) for remark in told)}


@pytest.mark.long
def test_what_two_instruments_show_alike_is_noise_of_neither(stage_problem):
    """A rotor that leans slowly moves both. Where each took it for noise of its own, there was no gap."""
    alike, own, seeds = [], [], SEEDS[:5]
    for seed in seeds:
        problem, _ = stage_problem(seed, "null")
        alike.append(slow_noise_told_where_two_wander(problem, seed, alike=True))
        own.append(slow_noise_told_where_two_wander(problem, seed, alike=False))
    assert sum(not told for told in alike) >= len(seeds) - 1, alike
    assert sum(told == {"autocollimator", "lvdt"} for told in own) >= len(seeds) - 1, own


def test_a_cause_that_shows_nowhere_changes_nothing(stage_problem):
    """A compliance where no force acts, and every component of it: as in a part of a recording without its sensors."""
    whole, _ = stage_problem(3, "null")
    streams = {name: stream for name, stream in whole.recording.streams.items() if name != "force"}
    problem = StageProblem(whole.stage, dataclasses.replace(whole.recording, streams=streams), EFFECTS)
    compliance = next(effect for effect in EFFECTS if effect.name == "load_compliance")
    cause = Cause(compliance, "", np.full(compliance.size, 1e-9))
    assert compliance.size > 1 and problem.signature(cause, range(compliance.size)) == {}
    problem.learn_noise((cause,))
    assert not [remark for remark in problem.remarks(problem.residual(())) if "slow noise" in remark]
