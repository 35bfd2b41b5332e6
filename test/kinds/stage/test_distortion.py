"""How far a cause changes the signatures of other effects, beside signatures predicted with and without it."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.problem import Candidate

EFFECTS = {effect.name: effect for effect in load_effects(StageEffect)}


@pytest.fixture(scope="module")
def problem(stage_problem):
    return stage_problem(3, "null")[0]


def candidate(name, location):
    effect = EFFECTS[name]
    return Candidate(effect, location, effect.start(location))


def changed(problem, seen, causes):
    """Part of the white signature that is another beside the causes."""
    at_zero = seen.cause(np.zeros(len(seen.linear)))
    alone, beside = (problem.signature(at_zero, seen.linear, others) for others in ((), causes))
    change = sum(np.sum(np.square(beside[channel] - rows)) for channel, rows in alone.items())
    return np.sqrt(change / sum(np.sum(np.square(rows)) for rows in alone.values()))


@pytest.mark.parametrize(
    ("cause", "location", "values", "seen", "order"),
    [
        ("autocollimator_latency", "", [5e-3], "mirror_flatness", "order_5"),
        ("autocollimator_latency", "", [5e-3], "spindle_tilt", "order_3"),
        ("head_latency", "head_a", [2e-4], "graduation_error", "order_40"),
        ("encoder_latency", "", [2e-4], "graduation_error", "order_40"),
        ("following_error", "", [2e-3], "spindle_radial", "order_9"),
        ("autocollimator_gain", "x", [0.1], "mirror_flatness", "order_5"),
        ("autocollimator_roll", "", [0.05], "spindle_tilt", "order_3"),
        ("disc_scale", "", [0.05], "spindle_radial", "order_9"),
    ],
)
def test_what_is_said_to_change_changes_so_far(problem, cause, location, values, seen, order):
    causes = (Cause(EFFECTS[cause], location, np.array(values)),)
    shown = candidate(seen, order)
    (said,) = problem.distortions([shown], causes)
    # The largest phase at any speed, the largest part of any stream: an upper bound of the same size.
    assert 0.3 * said < changed(problem, shown, causes) < 1.2 * said


@pytest.mark.parametrize(
    ("cause", "location", "values", "seen", "order"),
    [
        ("mirror_wobble", "", [1e-5, 1e-5], "spindle_tilt", "order_3"),
        ("autocollimator_latency", "", [5e-3], "graduation_error", "order_40"),
        ("head_latency", "head_a", [1e-4], "subdivisional_error", "head_b"),
        ("autocollimator_gain", "x", [0.1], "lvdt_artefact", ""),
    ],
)
def test_what_adds_up_or_lies_elsewhere_does_not_change(problem, cause, location, values, seen, order):
    causes = (Cause(EFFECTS[cause], location, np.array(values)),)
    shown = candidate(seen, order)
    assert problem.distortions([shown], causes) == [0.0]
    assert changed(problem, shown, causes) < 1e-6


def test_what_rescales_is_always_looked_at_again(problem):
    gain = candidate("autocollimator_gain", "x")
    wobble = Cause(EFFECTS["mirror_wobble"], "", np.array([1e-5, 0.0]))
    assert problem.distortions([gain], ()) == [0.0]
    assert problem.distortions([gain], (wobble,)) == [np.inf]
    assert changed(problem, gain, (wobble,)) > 1e-3
