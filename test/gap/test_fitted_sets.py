"""Sets of causes as they depart: each fitted once, and only where it may be believed."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap import fitted_sets, judgement
from rotary_error_monitor.gap.departure_selection import with_departures
from rotary_error_monitor.gap.fitted_sets import FittedSets
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.posterior import may_depart
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.verdict import Verdict
from test.gap.test_verdict import COUNT, WARMTH, DepartingProblem


def problem_of(rng, make, nuisance=False):
    """Rows that `make` gives from the first effect's column and from one that no effect has, beside noise."""
    first, second, other, uncertain = rng.normal(size=(4, COUNT, 1))
    data = {"x": make(first, other) + rng.normal(size=(COUNT, 1)), "y": rng.normal(size=(COUNT, 1))}
    problem = DepartingProblem(data, {}, {"x": uncertain} if nuisance else {})
    problem.offer({"first": {"x": first}, "second": {"x": second}})
    return problem


@pytest.fixture
def fitted(monkeypatch):
    """Names of the causes of each set that is fitted with its departures, one after the other."""
    names = []

    def noted(problem, fit, false_alarms=1.0, without=()):
        names.append((tuple(cause.key for cause in fit.causes), false_alarms, frozenset(without)))
        return with_departures(problem, fit, false_alarms, without)

    monkeypatch.setattr(fitted_sets, "with_departures", noted)
    return names


@pytest.mark.parametrize("growth", [0.0, 0.2])
def test_a_set_is_fitted_once_and_gives_the_same_again(rng, fitted, growth):
    problem = problem_of(rng, lambda first, _: 30 * first * (1 + growth * WARMTH))
    candidates = problem.candidates({}, ())
    sets = FittedSets(problem)
    for causes in ((candidates[0],), (candidates[0], candidates[1]), (candidates[1], candidates[0])):
        fit = fit_causes(problem, [each.cause(np.ones(1)) for each in causes])
        before, again = sets.departing(fit), sets.departing(fit)
        assert (before is fit) == (again is fit) == (growth == 0.0)
        assert before.squares == again.squares
        assert [cause.key for cause in again.causes] == [cause.key for cause in fit.causes], "in their order"
        assert np.array_equal(before.data["x"], again.data["x"])
    assert len(fitted) == len(set(fitted)) == 3


def test_of_one_recording_no_set_is_fitted_twice(rng, fitted):
    for _ in range(20):
        problem = problem_of(rng, lambda first, other: 6 * first * (1 + 0.2 * WARMTH) + 3 * np.abs(other), True)
        fitted.clear()
        judgement.judge(problem, select_causes(problem))
        assert fitted and len(fitted) == len(set(fitted))


def test_departures_are_not_looked_at_where_a_cause_leaves_more_than_half_of_itself(rng, fitted):
    """They would not be believed: something unknown is likelier."""
    for share, may in ((0.0, True), (0.3, True), (1.2, False)):
        for _ in range(20):
            problem = problem_of(rng, lambda first, other, share=share: 8 * (first + share * other), True)
            (first, _) = problem.candidates({}, ())
            fit = fit_causes(problem, (first.cause(np.ones(1)),))
            assert may_depart(problem, fit) == may, share
            fitted.clear()
            verdict = judgement.judge(problem, select_causes(problem)).verdict
            if not may:
                assert verdict is Verdict.UNKNOWN and not fitted


def test_where_a_cause_may_depart_as_a_whole_they_are_looked_at_whatever_it_leaves(rng):
    """Of a play that stays at rest, on a table that rests most of the time, the textbook form is a small part."""
    problem = problem_of(rng, lambda first, other: first + 12 * other)
    fit = fit_causes(problem, (problem.candidates({}, ())[0].cause(np.ones(1)),))
    assert not may_depart(problem, fit)
    problem.departs_as_whole = lambda cause: cause.key[0] == "first"
    assert may_depart(problem, fit)
