"""Departures are kept where they predict what was left out, on problems made of plain columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.departures import SHARE, Departures, columns_at
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.held_out import held_out_squares
from rotary_error_monitor.gap.judgement import judge
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.problem import SparseRows
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.standing import needed_departures, standing_departures
from rotary_error_monitor.gap.verdict import Verdict
from test.gap.conftest import LinearProblem

GROWTH = 0.3


@dataclass
class Growing(LinearProblem):
    """The first effect may grow, or do something in a single condition."""

    def departures(self, causes):
        return tuple(
            Departures(i, ("growth", "once"), (str, str), np.full(2, SHARE), {"x": self.columns_of(cause)})
            for i, cause in enumerate(causes)
            if cause.effect.name == "first"
        )

    def columns_of(self, cause):
        whole = cause.values[0] * cause.effect.column["x"][:, 0]
        count = len(whole)
        once = np.where(np.arange(count) < count / self.blocks, self.data["x"][:, 0] - whole, 0.0)
        return np.column_stack([SHARE * whole * rising(count), once])


def rising(count):
    return np.sqrt(3) * np.linspace(-1, 1, count)


def fitted(problem, *names):
    return fit_causes(problem, [Cause(problem.effects[name], "", np.zeros(1)) for name in names])


@pytest.fixture
def growing(linear):
    """The first effect of the linear problem at size 2, larger by 30 % where the modulation is one."""
    column = linear.effects["first"].column["x"]
    more = (2 * (1 + GROWTH * rising(len(column))) - 0.5)[:, None]
    return Growing({**linear.data, "x": linear.data["x"] + more * column}, linear.effects)


def test_only_what_predicts_is_kept(growing):
    """What one condition alone shows has evidence, but predicts nothing."""
    found = needed_departures(growing, fitted(growing, "first"), FALSE_ALARMS)
    (departures,) = found.departures
    assert departures.kinds == ("growth",)
    assert SHARE * found.departure_values[0] == pytest.approx(GROWTH, rel=0.2)


def test_a_cause_that_is_not_needed_beside_departures_falls_away(growing):
    causes = fitted(growing, "first", "second").causes
    found = standing_departures(growing, causes, FALSE_ALARMS)
    assert [cause.effect.name for cause in found.causes] == ["first"]


def test_causes_without_a_departure_are_left_as_they_are(linear, growing):
    plain = Growing(linear.data, linear.effects)
    assert standing_departures(plain, fitted(plain, "first").causes, FALSE_ALARMS) is None
    assert standing_departures(linear, fitted(linear, "first").causes, FALSE_ALARMS) is None, (
        "no departures are offered"
    )
    assert standing_departures(growing, fitted(growing, "second").causes, FALSE_ALARMS) is None


def beside_a_cause_like_its_growth(growth):
    """Judgements of ten recordings in which the first effect grows; the second one does what the growth does."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        first, other = rng.normal(size=(2, 800, 1))
        alike = first * rising(800)[:, None] + 0.1 * other
        data = 2 * first * (1 + growth * rising(800)[:, None]) + rng.normal(size=(800, 1))
        problem = Growing({"x": data}, {})
        problem.m_open = True
        problem.offer({"first": {"x": first}, "alike": {"x": alike}})
        yield judge(problem, select_causes(problem))


def test_what_predicts_as_well_is_named_beside_departures():
    """The smaller set is told, and the other in a remark."""
    departing_sets = []
    for told in beside_a_cause_like_its_growth(0.2):
        assert told.verdict is Verdict.EXPLAINED
        if told.fit.departures:
            assert [cause.effect.name for cause in told.fit.causes] == ["first"]
            departing_sets.append(told.doubts)
        else:
            assert {cause.effect.name for cause in told.fit.causes} == {"first", "alike"} and not told.doubts
    assert departing_sets
    for doubts in filter(None, departing_sets):
        assert doubts == ("first and alike in their textbook forms predict what was left out as well",)
    assert any(departing_sets), "nearly alike: chance decides"


def test_more_than_a_fair_departure_is_left_to_the_second_cause():
    for told in beside_a_cause_like_its_growth(GROWTH):
        assert told.verdict is Verdict.EXPLAINED and not told.fit.departures
        assert {cause.effect.name for cause in told.fit.causes} == {"first", "alike"}


def test_squares_without_a_kind_are_those_of_a_fit_without_it(growing):
    alone = fitted(growing, "first")
    both = fit_causes(growing, alone.causes, departures=growing.departures(alone.causes))
    without = held_out_squares(both, growing.conditions, np.array([False, False]))
    np.testing.assert_allclose(without, held_out_squares(alone, growing.conditions), rtol=1e-6)
    assert held_out_squares(both, growing.conditions, np.array([True, False])).sum() < without.sum()


def test_some_columns_of_some_columns(rng):
    rows = {"x": rng.normal(size=(5, 4))}
    twice = columns_at(columns_at(rows, np.array([3, 0, 1])), np.array([2, 0]))
    np.testing.assert_array_equal(twice.rows["x"], rows["x"][:, [1, 3]])
    with pytest.raises(TypeError, match="whole channels"):
        columns_at(SparseRows(4, {"x": rows["x"][:, :2]}, {"x": np.array([0, 2])}), np.array([0]))
