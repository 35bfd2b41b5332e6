"""Slow noise that is learnt beside causes takes no part of what they were mistaken for."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.fitting import fit_causes

EFFECTS = load_effects(StageEffect)
SEEDS = range(4, 12)


def slow_noise_beside_lost_counts(problem, head):
    """What is told of the heads' slow noise beside counts lost by one head, fitted alone where they fit best."""
    candidates = problem.candidates(problem.residual(()), ())
    lost = next(candidate for candidate in candidates if candidate.key == ("head_missed_counts", head))
    fit = fit_causes(problem, [lost.cause(np.zeros(len(lost.linear)))])
    problem.learn_noise(fit.causes)
    return [remark for remark in problem.remarks(fit.rest) if remark.startswith("head: slow noise")]


@pytest.mark.parametrize("seed", SEEDS)
def test_what_another_cause_leaves_of_a_fault_is_no_slow_noise(stage_problem, seed):
    """A late head of a stage that turns back looks like lost counts, which leave a slow 6 % of it.

    The cause in its place holds a part of the fault: only where it may be of another size is the fault, here one that
    goes with the speed and is no known effect, likelier than slow noise.
    """
    without = tuple(effect for effect in EFFECTS if effect.name != "head_latency")
    problem, truth = stage_problem(seed, "single", ["head_latency"], snr=(100.0, 200.0), stage_effects=without)
    assert not slow_noise_beside_lost_counts(problem, truth.faults[0].location)


def test_slow_noise_beside_a_cause_is_learnt(stage_problem):
    told, seeds = [], SEEDS[:3]
    for seed in seeds:
        problem, truth = stage_problem(seed, "single", ["head_missed_counts"], snr=(100.0, 200.0), noise="wander")
        told += slow_noise_beside_lost_counts(problem, truth.faults[0].location)
    assert len(told) >= len(seeds) - 1, told
