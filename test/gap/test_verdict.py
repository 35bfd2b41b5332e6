"""Which causes stand although something is left: known ones with their departures, against something unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.gap import judgement, weighing
from rotary_error_monitor.gap.alternatives import rank_alternatives
from rotary_error_monitor.gap.departure_selection import with_departures
from rotary_error_monitor.gap.departures import (
    SHARE,
    Departures,
    Modulation,
    amplitude_sizes,
    in_proportion,
    modulated,
    spread_out,
)
from rotary_error_monitor.gap.fitted_departures import describe
from rotary_error_monitor.gap.fitted_sets import FittedSets
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.judgement import judge
from rotary_error_monitor.gap.normal import Normal
from rotary_error_monitor.gap.p_values import log_chi_square_tail
from rotary_error_monitor.gap.posterior import departures_of
from rotary_error_monitor.gap.problem import StructureTest
from rotary_error_monitor.gap.proportion import log_odds_in_proportion
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.verdict import Verdict
from test.gap.conftest import LinearProblem

COUNT, CASES = 800, 30
WARMTH = np.linspace(-np.sqrt(3.0), np.sqrt(3.0), COUNT)[:, None]


class DepartingProblem(LinearProblem):
    """Effects that may grow with warmth; what is left of a channel is tested by its power.

    Attributes:
        spread: standard deviation of the warmth as a part of its mean; 0: it has no zero of its own.
        blind: whether the tests see nothing.
    """

    spread = 0.0
    blind = False

    def departures(self, causes):
        found = []
        for place, cause in enumerate(causes):
            amplitudes, sizes = cause.values[:1], amplitude_sizes(cause)
            growth = Modulation("temperature", WARMTH, lambda change: f"grows by {change:.2f}", True, self.spread)
            modulations = [growth]
            rows = {c: modulated(s[:, :, None], amplitudes, sizes, modulations) for c, s in cause.effect.column.items()}
            columns = {channel: values[:, 0] for channel, values in rows.items()}
            told, proportional = spread_out(modulations, amplitudes, sizes), in_proportion(modulations, sizes)
            found.append(Departures(place, *told, columns, proportional=proportional))
        return tuple(found)

    def structure(self, rest):
        squares = {channel: float(np.sum(rows**2)) for channel, rows in rest.items()}
        if self.blind:
            return [StructureTest(channel, "none", 0.0, 0.0, "") for channel in rest]
        return [
            StructureTest(c, "power", log_chi_square_tail(s, COUNT), max(s - COUNT, 0.0), "")
            for c, s in squares.items()
        ]


@pytest.fixture
def judged(rng):
    """Function that adds noise to rows of two channels and judges them beside known effects, some times over.

    `make` gives the rows from the first effect's column and from a column that no effect has.
    """

    def judge_all(make, spread=0.0, blind=False):
        outcomes = []
        for _ in range(CASES):
            first, second, other = rng.normal(size=(3, COUNT, 1))
            x, y = make(first, other)
            data = {"x": x + rng.normal(size=(COUNT, 1)), "y": y + rng.normal(size=(COUNT, 1))}
            problem = DepartingProblem(data, {})
            problem.spread, problem.blind = spread, blind
            more = {f"more {i}": {"x": column} for i, column in enumerate(rng.normal(size=(20, COUNT, 1)))}
            problem.offer({"first": {"x": first}, "second": {"x": second, "y": other}, **more})
            outcomes.append(judge(problem, select_causes(problem, most=1)))
        return outcomes

    return judge_all


def rate(outcomes, verdict, names=("first",)):
    named = [tuple(cause.key[0] for cause in told.fit.causes) for told in outcomes]
    return np.mean([told.verdict is verdict and found == names for told, found in zip(outcomes, named, strict=True)])


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_a_cause_with_a_fair_departure_explains(judged, share):
    outcomes = judged(lambda first, other: (20 * first * (1 + share * WARMTH), 0 * first))
    assert rate(outcomes, Verdict.EXPLAINED) > 0.9
    # Where chance leaves something besides, the textbook form with that beside it is as good a reason.
    for told in outcomes:
        if told.verdict is Verdict.EXPLAINED:
            (row,) = describe(departures_of(told.fit)[0])
            assert row.share == pytest.approx(share, rel=0.15)
        else:
            assert told.verdict is Verdict.PARTLY_EXPLAINED and told.findings


def test_what_departs_by_a_third_is_as_well_something_unknown(judged):
    """Something unknown resembles a known effect to a third more often than that departs so far."""
    outcomes = judged(lambda first, other: (20 * first * (1 + 0.33 * WARMTH), 0 * first))
    assert rate(outcomes, Verdict.UNKNOWN, ()) > 0.9


@pytest.mark.parametrize(("size", "share"), [(2.0, 0.33), (0.6, 0.5), (1.0, 0.5), (1.0, 0.8), (2.0, 0.8)])
def test_what_no_test_sees_of_a_large_departure_refutes_the_textbook_form(judged, size, share):
    """Its evidence alone tells it, at ten standard deviations and more: no cause departs so far, nor not at all."""
    outcomes = judged(lambda first, other: (size * first * (1 + share * WARMTH), 0 * first), blind=True)
    assert rate(outcomes, Verdict.UNKNOWN, ()) > 0.85
    assert not any(told.verdict is Verdict.EXPLAINED and not told.fit.departures for told in outcomes)


@pytest.mark.parametrize(("share", "beside", "explained"), [(0.2, 0.01, True), (0.2, 0.05, False), (0.0, 0.01, False)])
def test_of_a_cause_that_departs_a_little_more_may_be_left(judged, share, beside, explained):
    """Half the square of the departure, which columns of first order lack: 2 % of the cause; of none nothing."""
    outcomes = judged(lambda first, other: (300 * (first * (1 + share * WARMTH) + beside * other), 0 * first))
    verdicts = [told.verdict is Verdict.EXPLAINED for told in outcomes]
    assert np.mean(verdicts) > 0.9 if explained else np.mean(verdicts) < 0.1


def test_what_grows_from_nothing_is_no_steady_effect(judged):
    """The known effect takes three quarters of it away; the rest is no departure but another thing."""
    outcomes = judged(lambda first, other: (20 * first * (WARMTH + np.sqrt(3.0)), 0 * first))
    assert rate(outcomes, Verdict.UNKNOWN, ()) > 0.9


@pytest.mark.parametrize(("spread", "blind"), [(0.1, False), (0.2, False), (0.2, True)])
def test_what_is_proportional_to_a_quantity_that_hardly_varies_is_no_departure(judged, spread, blind):
    """A force squared is no compliance, however little the force varies, and whether its textbook form leaves what the
    tests see or what its evidence alone tells; what departs otherwise is a departure.
    """

    def growing(share):
        return judged(lambda first, other: (100 * first * (1 + share * WARMTH), 0 * first), spread, blind)

    assert rate(growing(spread), Verdict.UNKNOWN, ()) > 0.9
    assert all(rate(growing(share), Verdict.EXPLAINED) > 0.9 for share in (-spread, 0.5 * spread))


def test_what_is_proportional_to_a_quantity_that_is_none_where_a_cause_acts_is_nothing(rng):
    """As to a force that acts at other times: what rounding leaves of a loud cause then was no product of columns."""
    for size in 10 ** rng.uniform(2.0, 6.0, 40):
        problem = DepartingProblem({"x": rng.normal(size=(COUNT, 1))}, {})
        column = size * rng.normal(size=(COUNT, 1))
        problem.offer({"first": {"x": column}})
        (candidate,) = problem.candidates({}, ())
        cause, none = candidate.cause(np.ones(1)), np.full(COUNT, -1 / 3.0)
        around = np.sqrt(2) * np.cos(np.arange(COUNT))
        modulations = [Modulation("load", none, str, True, 3.0), Modulation("place", around, str, True)]
        sizes = amplitude_sizes(cause)
        apart = modulated(column[:, :, None], cause.values[:1], sizes, modulations)[:, 0]
        table = np.hstack([column, apart])
        total = Normal(table.T @ table, table.T @ problem.residual(())["x"][:, 0], 0.0, COUNT)
        kinds, words, changes = spread_out(modulations, cause.values[:1], sizes)
        offered = Departures(0, kinds, words, changes, {}, proportional=in_proportion(modulations, sizes))
        for chosen in (set(), {(0, "place")}):
            (odds,) = log_odds_in_proportion(total, 0, [cause], [offered], chosen)
            assert odds < -0.4 * COUNT * size**2, "the cause explains its own squares, and nothing none"


def test_without_some_of_its_columns_nothing_is_proportional_to_a_quantity(rng):
    """Of a kind that was left out all values were zero, and the diagnosis ended with an IndexError."""
    column = rng.normal(size=(COUNT, 1))
    problem = DepartingProblem({"x": column}, {})
    problem.offer({"first": {"x": column}})
    (candidate,) = problem.candidates({}, ())
    cause = candidate.cause(np.ones(1))
    sizes, around = amplitude_sizes(cause), np.cos(np.arange(COUNT))
    modulations = [Modulation("load", around, str, True, 3.0), Modulation("place", around, str, True)]
    apart = modulated(column[:, :, None], cause.values[:1], sizes, modulations)[:, 0]
    told, proportional = spread_out(modulations, cause.values[:1], sizes), in_proportion(modulations, sizes)
    offered = Departures(0, *told, {"x": apart}, proportional=proportional)
    assert len(offered.proportional) == 1
    for places, many in (((1,), 0), ((0,), 1), ((1, 0), 1)):
        some = offered.chosen(places)
        assert len(some.proportional) == many and all(values.any() for values in some.proportional)
        table = np.hstack([column, apart[:, list(places)]])
        total = Normal(table.T @ table, table.T @ problem.residual(())["x"][:, 0], 0.0, COUNT)
        (odds,) = log_odds_in_proportion(total, 0, [cause], [some], set())
        assert np.isfinite(odds) == bool(many)


def test_what_no_effect_describes_is_noise_to_whether_a_cause_is_proportional(rng):
    """Beside thirty times the noise chance takes and gives squares by the hundred: odds were 6000."""
    odds = []
    for _ in range(100):
        column = {"x": rng.normal(size=(COUNT, 1))}
        problem = DepartingProblem({"x": 20 * column["x"] + 30 * rng.normal(size=(COUNT, 1))}, {})
        problem.spread = 0.1
        problem.offer({"first": column})
        (candidate,) = problem.candidates({}, ())
        departing = with_departures(problem, fit_causes(problem, (candidate.cause(np.ones(1)),)))
        odds += departing.proportional
    assert len(odds) > 50, "most seem to depart"
    assert np.max(np.abs(odds)) < 15.0, "a tenth more or less of what is mostly something else tells next to nothing"


def test_what_resembles_a_known_effect_by_half_is_unknown(judged):
    outcomes = judged(lambda first, other: (5 * (first + other), 0 * first))
    assert rate(outcomes, Verdict.UNKNOWN, ()) > 0.9


def test_something_unknown_on_another_channel_does_not_hide_a_cause(judged):
    outcomes = judged(lambda first, other: (5 * first, 50 * np.abs(other)))
    assert rate(outcomes, Verdict.PARTLY_EXPLAINED) > 0.9


def test_a_little_that_is_left_does_not_hide_a_cause_but_is_told(judged):
    outcomes = judged(lambda first, other: (50 * first + 2 * np.abs(other), 0 * first))
    assert rate(outcomes, Verdict.PARTLY_EXPLAINED) > 0.9
    assert all(told.findings and told.unknown < 0.5 for told in outcomes)


def test_probability_and_verdict_never_contradict_one_another(judged):
    for share in (0.0, 0.2, 0.4, 0.6):
        for told in judged(lambda first, other, share=share: (10 * first + 10 * share * other, 0 * first)):
            assert bool(told.fit.causes) == (told.unknown < 0.5)


def growing(seed, growth):
    """An effect that grows by so much of it, and among the known ones another that does just what its growth does."""
    rng = np.random.default_rng(seed)
    first, *more = rng.normal(size=(5, COUNT, 1))
    problem = DepartingProblem({"x": 4 * first * (1 + growth * WARMTH) + rng.normal(size=(COUNT, 1))}, {})
    others = {f"more {i}": {"x": column} for i, column in enumerate(more)}
    problem.offer({"first": {"x": first}, "alike": {"x": first * WARMTH}, **others})
    return problem


@pytest.mark.parametrize(
    ("growth", "least", "most"),
    [(0.0, 0.0, 0.0), (SHARE, 0.0, 0.0), (-2 * SHARE, 0.0, 0.0), (3 * SHARE, 0.5, 0.9), (-6 * SHARE, 0.9, 1.0)],
)
def test_a_second_cause_that_a_departure_may_be_is_not_sure(growth, least, most):
    """A departure of two standard deviations of its prior is no cause, what is six of them is no departure."""
    for seed in range(10):
        told = judge(problem := growing(seed, growth), select_causes(problem))
        causes = {cause.effect.name for cause in told.fit.causes}
        assert told.verdict is Verdict.EXPLAINED and "first" in causes
        ranked = rank_alternatives(
            told.step, told.fit.causes, told.unknown, told.dispersion, told.credits, told.needless
        )
        second = ranked.probability(("alike", "")) if "alike" in causes else 0.0
        assert least <= second <= most and ranked.probability(("first", "")) > 0.9, (seed, second)
        assert bool(told.fit.departures) == (growth != 0 and "alike" not in causes), seed


def test_what_its_departure_makes_likelier_is_named_not_what_its_textbook_form_resembles():
    """An effect that is nearly the other at its largest: as a whole it explains more, as it departs less."""
    for seed in range(8):
        draw = np.random.default_rng(seed)
        first, *more = draw.normal(size=(5, COUNT, 1))
        resembling = first * (1 + SHARE * WARMTH) + 0.01 * draw.normal(size=(COUNT, 1))
        problem = DepartingProblem({"x": 20 * first * (1 + 2 * SHARE * WARMTH) + draw.normal(size=(COUNT, 1))}, {})
        others = {f"more {i}": {"x": column} for i, column in enumerate(more)}
        problem.offer({"first": {"x": first}, "resembling": {"x": resembling}, **others})
        selection = select_causes(problem, most=1)
        told = judge(problem, selection)
        assert [c.effect.name for c in selection.steps[1].fit.causes] == ["resembling"]
        assert told.verdict is Verdict.EXPLAINED and [c.effect.name for c in told.fit.causes] == ["first"], seed


def hidden(seed, size):
    """An effect of some standard deviations of an uncertain parameter that does the same; beside it others by chance.

    Its growth by 20 % shows, which three other effects resemble more than the effect as it is.
    """
    problem = growing(seed, 2 * SHARE)
    first, alike = (problem.effects[name].column["x"] for name in ("first", "alike"))
    draw = np.random.default_rng(1000 + seed)
    near = {f"near {i}": {"x": alike + 1.2 * draw.normal(size=alike.shape)} for i in range(3)}
    problem.offer({"first": {"x": first}, **near})
    problem.nuisances = {"x": 4 / size * first}
    return problem


@pytest.mark.parametrize("size", [4, 10, 40])
def test_a_cause_that_uncertain_parameters_take_is_found_by_its_departure(size):
    for seed in range(6):
        told = judge(problem := hidden(seed, size), select_causes(problem))
        assert told.verdict is Verdict.EXPLAINED and [c.effect.name for c in told.fit.causes] == ["first"], seed
        assert told.fit.departures and told.unknown < 0.2, seed


def test_what_uncertain_parameters_may_well_be_is_no_cause():
    """Half a standard deviation of one: nothing says that the effect rather than the parameter is there."""
    for seed in range(6):
        told = judge(problem := hidden(seed, 0.5), select_causes(problem))
        assert "first" not in {cause.effect.name for cause in told.fit.causes}, seed


def test_what_the_recording_rejects_beside_a_rival_is_not_told(rng):
    """A set that the table chose at no size, and that leaves only noise: a rival that fits better is told."""
    told = []
    for _ in range(CASES):
        first, other = rng.normal(size=(2, COUNT, 1))
        data = {"x": first + rng.normal(size=(COUNT, 1)), "y": rng.normal(size=(COUNT, 1))}
        problem = DepartingProblem(data, {})
        problem.offer({"first": {"x": first}, "alike": {"x": first + 0.3 * other}})
        step = select_causes(problem, most=1).chosen
        (alike,) = (i for i, row in enumerate(step.table.candidates) if row.effect.name == "alike")
        causes = step.table.causes(step.table.evaluate((alike,)))
        found = judgement._judge_settled(FittedSets(problem), replace(step, fit=fit_causes(problem, causes)), 0.01)
        ranking = rank_alternatives(
            found.step, found.fit.causes, found.unknown, found.dispersion, found.credits, found.needless
        )
        (cause,) = found.fit.causes
        told.append((cause.effect.name, ranking.probability(cause.key) > 0.9, ranking.groups))
    assert told.count(("first", True, ())) >= CASES - 1, told


def test_what_is_told_is_the_most_probable(rng):
    """Two effects that are all but alike: the page cannot name the one and give the other a higher probability."""
    for _ in range(CASES):
        first, other = rng.normal(size=(2, COUNT, 1))
        data = {"x": first + rng.normal(size=(COUNT, 1)), "y": rng.normal(size=(COUNT, 1))}
        problem = DepartingProblem(data, {})
        problem.offer({"first": {"x": first}, "alike": {"x": first + 0.05 * other}})
        step = select_causes(problem, most=1).chosen
        for name in ("first", "alike"):
            (place,) = (i for i, row in enumerate(step.table.candidates) if row.effect.name == name)
            causes = step.table.causes(step.table.evaluate((place,)))
            found = judgement._judge_settled(FittedSets(problem), replace(step, fit=fit_causes(problem, causes)), 0.01)
            ranking = rank_alternatives(
                found.step, found.fit.causes, found.unknown, found.dispersion, found.credits, found.needless
            ).ranking
            own = next(row[2] for row in ranking if row[0] == found.fit.causes[0].effect.name)
            assert own == max(row[2] for row in ranking), ranking


def test_what_is_refused_in_the_place_of_a_cause_does_not_speak_against_it(monkeypatch):
    """A departure that is likelier than a second cause, but does not predict what was left out, is no rival."""
    monkeypatch.setattr(weighing, "_predicts", lambda *_: False)
    for seed in range(6):
        problem = growing(seed, -2 * SHARE)
        step = select_causes(problem).chosen
        fit = fit_causes(problem, step.fit.causes)
        odds, instead = weighing.departures_instead(FittedSets(problem), step, fit)
        assert not instead and all(value <= 0 for value in odds.values()), seed
