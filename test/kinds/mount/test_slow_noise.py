"""Pointings whose noise is shared from one to the next, and what is slow and no noise."""

from __future__ import annotations

import numpy as np
import pytest
from draws import seeds
from scipy.stats import binom
from simulated_pointings import pointing_file, simulate_pointings

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.mount.description import MountDescription
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.pointings import parse_pointings
from rotary_error_monitor.kinds.mount.problem import MountProblem

EFFECTS = load_effects(MountEffect)
NOISE = 5e-5


def problem_of(simulated):
    return MountProblem(MountDescription("mount", 5e-6), parse_pointings(pointing_file(simulated), "made"), EFFECTS)


def slow_part(problem):
    """Root mean square of slow noise along each way, rad."""
    return problem.std * [np.sqrt(np.mean(np.sum(np.square(courses), axis=1))) for courses in problem.slow]


def is_learnt(problem, ways=(0, 1)):
    problem.learn_noise(())
    return bool(np.any(slow_part(problem)[[*ways]] > 0))


def in_time(pose):
    return (pose.time - pose.time.min()) / np.ptp(pose.time)


def test_noise_that_lasts_from_one_pointing_to_the_next_is_no_gap():
    """In random order, where neighbours on the sky are far apart in time."""
    drawn = seeds(12)
    verdicts = [diagnose(problem_of(simulate_pointings(seed, 160, kept=0.6))).verdict for seed in drawn]
    assert verdicts.count(Verdict.NO_GAP) >= len(drawn) - binom.ppf(0.99, len(drawn), 0.05), verdicts


def test_slow_and_white_part_are_together_as_loud_as_the_noise():
    for seed in seeds(6):
        problem = problem_of(simulate_pointings(seed, 200, kept=0.6))
        assert is_learnt(problem)
        assert np.hypot(problem.std, slow_part(problem)) == pytest.approx(NOISE, rel=0.4)


def test_white_noise_has_no_slow_part():
    drawn = seeds(30)
    learnt = sum(is_learnt(problem_of(simulate_pointings(seed, 100))) for seed in drawn)
    assert learnt <= binom.ppf(0.99, len(drawn), 0.05)


def turned_about(axis, course):
    return lambda pose: NOISE * course(in_time(pose))[:, None] * getattr(pose, axis)


@pytest.mark.parametrize("axis", ["polar", "declination"])
@pytest.mark.parametrize("size", [4.0, 10.0])
def test_an_axis_that_jumps_or_swings_is_no_noise(axis, size):
    learnt, drawn = 0, seeds(15)
    for seed in drawn:
        rng = np.random.default_rng(seed)
        at, rate, phase = rng.uniform(0.2, 0.8), rng.uniform(6, 25), rng.uniform(0, 6)
        jumps = lambda time, at=at: size * (time > at)  # noqa: E731
        swings = lambda time, rate=rate, phase=phase: size * np.sin(rate * time + phase)  # noqa: E731
        turn = turned_about(axis, jumps if seed % 2 else swings)
        learnt += is_learnt(problem_of(simulate_pointings(seed, 160, turn=turn)), [0 if axis == "polar" else 1])
    assert learnt <= binom.ppf(0.99, len(drawn), 0.05)
