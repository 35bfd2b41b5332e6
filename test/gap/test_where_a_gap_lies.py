"""Where a gap lies: what an effect that the description lacks does to the published error motion, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose

EFFECTS = load_effects(StageEffect)
AT_RING, ABOVE = "tool_offset_error_at_the_ring_um", "tool_offset_error_100_mm_above_um"
DIRECTION, ROTATION = "tool_direction_error_urad", "rotation_error_urad"


def figures(problem, name, values, location=""):
    return problem.figures([Cause(effect_named(name, EFFECTS), location, np.array(values, float))])


def test_what_the_sensors_show_truly_lands_nowhere(stage_problem):
    """A rotor that moves otherwise than the twin says is seen by the heads: the published offset follows it."""
    problem, _ = stage_problem(1, "null")
    found = figures(problem, "spindle_radial", [2, 1e-6, 0, 0, 1e-6], "order_2")
    assert found[AT_RING] < 2e-3
    assert figures(problem, "reversal_backlash", [1e-4])[ROTATION] < 0.05


def test_what_one_sensor_makes_up_lands_whole(stage_problem):
    problem, _ = stage_problem(1, "null")
    shifted = figures(problem, "disc_eccentricity", [3e-6, 4e-6])
    assert shifted[AT_RING] == pytest.approx(5.0, rel=1e-3)
    assert shifted[DIRECTION] == pytest.approx(0.0, abs=1e-3)
    leaning = figures(problem, "mirror_wobble", [6e-6, 8e-6])
    assert leaning[DIRECTION] == pytest.approx(10.0, rel=1e-3)
    assert leaning[AT_RING] == pytest.approx(0.0, abs=1e-3)
    assert leaning[ABOVE] == pytest.approx(1.0, rel=1e-3), "10 µrad over 100 mm"


def test_a_diagnosis_says_it(stage_problem):
    problem, truth = stage_problem(3, "single", ["mirror_wobble"])
    figures = diagnose(problem).as_mapping()["figures"]
    (fault,) = truth.faults
    assert figures[DIRECTION] == pytest.approx(1e6 * np.hypot(*fault.parameters["tilt"]), rel=0.05)
