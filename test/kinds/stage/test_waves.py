"""The search for asynchronous orders: how often chance explains as much, and what few turns can tell."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.orders import trials_of_waves
from rotary_error_monitor.plant.motion import Motion, MotionSegment

EFFECTS = load_effects(StageEffect)


@pytest.mark.parametrize("rate", [0.1, 0.03])
def test_a_search_over_all_orders_has_the_rate_that_is_told(rate):
    """White noise over 40 turns and the best of all orders from 0.1 to 24, by brute force on a fine grid."""
    turns, count, tries = 40, 2048, 4000
    independent = round(23.9 * turns)
    level = rate / independent
    for _ in range(20):
        level = rate / trials_of_waves(independent, float(np.log(level)))
    rng, length = np.random.default_rng(round(1 / rate)), 12 * count
    order = np.arange(length // 2 + 1) * count / length / turns
    searched = (order > 0.1) & (order < 24.0)
    most = [np.max(np.abs(np.fft.rfft(rng.normal(size=count), length)[searched]) ** 2) for _ in range(tries)]
    alarms = np.mean(np.array(most) * 2 / count > -2 * np.log(level))
    assert alarms == pytest.approx(rate, abs=4 * np.sqrt(rate / tries) + 0.15 * rate)


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_over_few_turns_what_creeps_at_an_order_is_not_told_as_asynchronous(seed, stage_problem):
    """An eccentricity that departs from its textbook form, over one turn and a half."""
    motion = Motion((MotionSegment(20.0, 0.45), MotionSegment(20.0, -0.45)))
    problem, _ = stage_problem(seed, "variant", ["disc_eccentricity"], snr=(200.0, 400.0), duration=20.0, motion=motion)
    diagnosis = diagnose(problem)
    alike = {key for group in diagnosis.indistinguishable for key in group.effects}
    for found in diagnosis.causes:
        if found.cause.effect.name == "bearing_asynchronous":
            assert ("disc_eccentricity", "") in alike or found.probability < 0.5
    assert (
        any(found.cause.effect.name == "disc_eccentricity" for found in diagnosis.causes)
        or (
            "disc_eccentricity",
            "",
        )
        in alike
    )
