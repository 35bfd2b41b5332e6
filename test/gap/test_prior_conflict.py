"""Uncertain parameters moved too far beside a loud cause: what a twin of first order leaves, and what it does not."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.posterior import is_structured, powers_of, summed
from rotary_error_monitor.gap.prior_conflict import find_prior_conflict
from rotary_error_monitor.gap.problem import FIRST_ORDER
from rotary_error_monitor.gap.selection import select_causes
from test.gap.conftest import LinearProblem

COUNT, CASES = 400, 20
LOUD = 1e5
PRIOR = 3.0
"""White size of one standard uncertainty of the parameter in each row."""

LOG_ALARM = float(np.log(1e-4))


def beside_a_loud_cause(rng, make):
    """A loud cause on channel x, and the parameter's column; `make(cause, parameter)` gives rows of x and y, and what
    the parameter does in each."""
    cause, parameter = rng.normal(size=(2, COUNT, 1))
    x, y, uncertain = make(cause, parameter)
    data = {"x": LOUD * cause + x + rng.normal(size=(COUNT, 1)), "y": y + rng.normal(size=(COUNT, 1))}
    problem = LinearProblem(data, {}, uncertain)
    problem.offer({"loud": {"x": cause}, "second": uncertain})
    return problem


def is_alarmed(problem):
    fit = fit_causes(problem, (select_causes(problem, most=1).steps[1].fit.causes))
    return is_structured(find_prior_conflict(problem, fit), LOG_ALARM, summed(powers_of(problem, fit)))


def test_a_loud_cause_forgives_nothing_on_channels_that_it_does_not_act_on(rng):
    """A parameter twelve of its uncertainties away; `FIRST_ORDER` of the loud cause would be a thousand."""

    def make(cause, parameter):
        return 0 * cause, 12 * PRIOR * parameter, {"y": PRIOR * parameter}

    for _ in range(CASES):
        problem = beside_a_loud_cause(rng, make)
        selection = select_causes(problem)
        assert {cause.effect.name for cause in selection.chosen.fit.causes} == {"loud", "second"}
        assert is_alarmed(problem)


@pytest.mark.parametrize(("part", "alarmed"), [(0.9, False), (1.5, True)])
def test_what_a_twin_leaves_of_a_cause_may_move_a_parameter_as_far_as_it_reaches(rng, part, alarmed):
    """What is left of the loud cause looks as the parameter does: up to `FIRST_ORDER` of the cause it is the twin's."""

    def make(cause, parameter):
        left = part * FIRST_ORDER * LOUD * np.linalg.norm(cause) / np.linalg.norm(parameter)
        return left * parameter, 0 * cause, {"x": PRIOR * parameter}

    for _ in range(CASES):
        assert is_alarmed(beside_a_loud_cause(rng, make)) is alarmed


def test_a_parameter_on_both_channels_is_moved_as_far_as_the_loud_one_can(rng):
    """Where the loud channel hardly shows the parameter, it cannot have moved it that far."""

    def make(cause, parameter):
        uncertain = {"x": 0.001 * PRIOR * parameter, "y": PRIOR * parameter}
        return 12 * uncertain["x"], 12 * uncertain["y"], uncertain

    for _ in range(CASES):
        assert is_alarmed(beside_a_loud_cause(rng, make))
