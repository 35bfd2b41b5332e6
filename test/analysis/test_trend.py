"""Steps, slopes and dates of limits in series whose truth and uncertainties are known: rates over many seeds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from draws import seeds
from scipy.stats import binom, chi2, norm
from scipy.stats import t as student_t

from rotary_error_monitor.analysis.history import RecordingFigures, histories
from rotary_error_monitor.analysis.partition import fit_course, partition, penalty_of
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.analysis.trend import DAY_NS, Series, estimate_trend
from rotary_error_monitor.analysis.verdict import Conformity
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits

BEGIN_NS = 1_763_700_000_000_000_000
RATE = 0.05


def drawn(rng, count, step=0.0, slope=0.0, at=None):
    """Series on uneven days with uneven uncertainties; `step` and `slope` times the days in mean uncertainties."""
    days = np.sort(rng.uniform(0, 100, count))
    own = rng.uniform(0.5, 2.0, count) * 1e-7
    truth = 3e-6 + step * own.mean() * (np.arange(count) >= (count // 2 if at is None else at))
    truth += slope * own.mean() * (days - days[0]) / (days[-1] - days[0])
    stamps = BEGIN_NS + (days * DAY_NS).astype(np.int64)
    values = truth + own * rng.standard_normal(count)
    return Series("tilt_x.total", "forward 4 rad/s", "rad", tuple(range(count)), stamps, values, own), truth


def at_most(rate, count):
    """How often of `count` something of this rate happens at most, but for one of a million test runs."""
    return binom.isf(1e-6, count, rate)


@pytest.mark.few(2)
@pytest.mark.parametrize("count", [2, 30, 3, 6, 12])
def test_nothing_is_told_of_what_does_not_change_but_for_the_named_rate(count):
    rng = np.random.default_rng(count)
    runs = 250
    trends = [estimate_trend(drawn(rng, count)[0], RATE) for _ in range(runs)]
    assert sum(bool(trend.steps) or trend.has_slope for trend in trends) <= at_most(RATE, runs)


def test_the_penalty_of_two_values_is_the_textbook_quantile():
    """One step is possible: its square over its variance is chi-square with one degree of freedom."""
    for rate in (0.5, 0.05, 1e-4, 1e-9):
        assert penalty_of(2, rate) == pytest.approx(chi2.isf(rate, 1), rel=1e-9)
    assert penalty_of(3, RATE) < penalty_of(10, RATE) < penalty_of(1000, RATE) < penalty_of(1000, RATE / 100)


@pytest.mark.parametrize(("count", "size"), [(10, 4.0), (10, 6.0), (40, 4.0)])
def test_a_step_of_four_uncertainties_and_more_is_told_with_its_date(count, size):
    """As often as the best test of a step at this known place, with the same penalty, tells it; less a tenth, for its
    place, and the slope that it could be, are not known."""
    rng = np.random.default_rng(round(10 * count + size))
    runs, found, inside, best = 120, 0, 0, 0.0
    for _ in range(runs):
        series, truth = drawn(rng, count, step=size)
        weights = 1 / series.uncertainties**2
        first, second = weights[: count // 2].sum(), weights[count // 2 :].sum()
        change = truth[-1] - truth[0]
        power = change / math.sqrt(1 / first + 1 / second)
        best += norm.sf(math.sqrt(penalty_of(count, RATE)) - power)
        trend = estimate_trend(series, RATE)
        if len(trend.steps) == 1 and not trend.has_slope:
            (step,) = trend.steps
            found += abs(step.place - count // 2) <= 1
            inside += abs(step.after - step.before - change) <= step.expanded_uncertainty
            assert step.previous == step.place - 1
    assert found >= 0.9 * best - 3 * math.sqrt(0.1 * 0.9 * runs)
    assert found >= 0.85 * runs
    # 95 % where the place is known; that it was chosen to be as large as can be takes some
    assert inside >= 0.88 * found


@pytest.mark.parametrize("count", [6, 12, 30])
def test_a_slope_is_told_as_one_and_its_uncertainty_holds_it(count):
    rng = np.random.default_rng(count)
    runs, told, inside = 120, 0, 0
    for _ in range(runs):
        series, truth = drawn(rng, count, slope=15.0)
        trend = estimate_trend(series, RATE)
        told += trend.has_slope and not trend.steps
        days = (series.started_ns - series.started_ns[0]) / DAY_NS
        inside += abs(trend.slope - (truth[-1] - truth[0]) / days[-1]) <= trend.slope_uncertainty
    assert told >= 0.9 * runs
    assert inside >= 0.93 * runs - 3 * math.sqrt(0.05 * 0.95 * runs)


def test_a_step_on_a_slope_is_both():
    rng = np.random.default_rng(3)
    runs, told = 100, 0
    for _ in range(runs):
        series, _ = drawn(rng, 40, step=-10.0, slope=25.0)
        trend = estimate_trend(series, RATE)
        told += trend.has_slope and len(trend.steps) == 1 and abs(trend.steps[0].place - 20) <= 1
    assert told >= 0.9 * runs


def test_the_date_of_a_limit_lies_in_its_interval():
    """Fieller's interval: 95 % of them hold the true date, also where it is far from what was seen."""
    rng = np.random.default_rng(11)
    runs, told, inside = 200, 0, 0
    for _ in range(runs):
        series, truth = drawn(rng, 12, slope=12.0)
        slope = (truth[-1] - truth[0]) / (series.started_ns[-1] - series.started_ns[0])
        limit = truth[-1] + 2 * (truth[-1] - truth[0])
        true_ns = series.started_ns[-1] + (limit - truth[-1]) / slope
        reach = estimate_trend(series, RATE).reach(limit)
        if reach is not None:
            told += 1
            latest = math.inf if reach.latest_ns is None else reach.latest_ns
            assert reach.earliest_ns <= reach.at_ns <= latest
            inside += reach.earliest_ns <= true_ns <= latest
    assert told >= 0.95 * runs
    assert inside >= 0.93 * told - 3 * math.sqrt(0.05 * 0.95 * told)


def test_no_date_of_a_limit_that_is_passed_or_falls_away():
    rng = np.random.default_rng(5)
    series, truth = drawn(rng, 20, slope=20.0)
    trend = estimate_trend(series, RATE)
    assert trend.reach(truth[-1] + 1e-6) is not None
    assert trend.reach(truth[-1] - 1e-6) is None
    falling, truth = drawn(rng, 20, slope=-20.0)
    assert estimate_trend(falling, RATE).reach(truth[-1] + 1e-6) is None


def test_scatter_beyond_the_uncertainties_is_said_and_widens_what_follows():
    rng = np.random.default_rng(2)
    runs, usual, understated = 60, 0, 0
    for _ in range(runs):
        series, _ = drawn(rng, 40)
        usual += estimate_trend(series, RATE).scatters
        less = replace(series, uncertainties=series.uncertainties / math.sqrt(2))
        trend = estimate_trend(less, RATE)
        understated += trend.scatters or bool(trend.steps) or trend.has_slope
        slope_alone = trend.slope_uncertainty / (2 * math.sqrt(trend.course.covariance[-1, -1]))
        assert slope_alone == pytest.approx(max(1.0, trend.scatter), rel=1e-9)
    assert usual <= at_most(RATE, runs)
    # chi-square of 39 degrees of freedom, doubled, beyond the quantile of the rate
    power = chi2.sf(chi2.isf(RATE, 39) / 2, 39)
    assert understated >= power * runs - 3 * math.sqrt(power * (1 - power) * runs)
    series, _ = drawn(rng, 8)
    calm = estimate_trend(replace(series, values=np.full(8, 3e-6)), RATE)
    assert calm.scatter == 0.0 and calm.now == pytest.approx(3e-6, rel=1e-12)
    assert calm.now_uncertainty == pytest.approx(2 * series.uncertainties.min(), rel=1e-12)


def test_what_recordings_share_does_not_average_out_of_the_level():
    """An error of a description that is the same in all of them, half of the variance that each states."""
    rng, inside, runs = np.random.default_rng(11), 0, 200
    for _ in range(runs):
        series, truth = drawn(rng, 30)
        size = float(series.uncertainties.min())
        shared = rng.normal(0.0, size)
        both = replace(series, values=series.values + shared, uncertainties=np.hypot(series.uncertainties, size))
        trend = estimate_trend(both, RATE)
        inside += abs(trend.now - truth[-1]) <= trend.now_uncertainty
    assert inside >= 0.95 * runs - 3 * math.sqrt(0.95 * 0.05 * runs)


@pytest.mark.parametrize("count", [10, 20])
def test_steps_and_levels_are_as_uncertain_as_their_values_scatter(count):
    """Uncertainties stated at half of what they are; k = 2 covers what Student's t has of the values left over."""
    rng = np.random.default_rng(count)
    runs, told, steps, levels, unwidened = 300, 0, 0, 0, 0
    for _ in range(runs):
        series, truth = drawn(rng, count, step=30.0)
        trend = estimate_trend(replace(series, uncertainties=series.uncertainties / 2), 1e-4)
        if len(trend.steps) != 1 or trend.has_slope:
            continue
        (step,) = trend.steps
        wrong = abs(step.after - step.before - (truth[-1] - truth[0]))
        told += 1
        steps += wrong <= step.expanded_uncertainty
        levels += abs(trend.now - truth[-1]) <= trend.now_uncertainty
        unwidened += wrong <= step.expanded_uncertainty / max(1.0, trend.scatter)
    assert told >= 0.6 * runs
    # less 0.03, for series that scatter most show steps more and are left out
    least = (student_t.cdf(2, count - 2) - student_t.sf(2, count - 2) - 0.03) * told - 3 * math.sqrt(0.1 * 0.9 * told)
    assert min(steps, levels) >= least > unwidened


@pytest.mark.parametrize("seed", seeds(20))
def test_the_partition_is_the_best_of_all(seed):
    """Every partition of nine values by hand."""
    rng = np.random.default_rng(seed)
    values, variances = rng.normal(0, 2, 9), rng.uniform(0.2, 2, 9)
    penalty = rng.uniform(0.5, 8)

    def cost(starts):
        pieces = np.split(np.arange(9), starts[1:])
        means = [np.average(values[piece], weights=1 / variances[piece]) for piece in pieces]
        squares = [((values[p] - m) ** 2 / variances[p]).sum() for p, m in zip(pieces, means, strict=True)]
        return sum(squares) + penalty * (len(pieces) - 1)

    every = [(0, *[k for k in range(1, 9) if mask >> (k - 1) & 1]) for mask in range(256)]
    assert cost(partition(values, variances, penalty)) == pytest.approx(min(map(cost, every)), rel=1e-12)


def test_units_and_an_offset_do_not_matter():
    rng = np.random.default_rng(8)
    days, own = np.arange(12.0) - 11, rng.uniform(0.5, 2, 12)
    values = own * rng.standard_normal(12) + 6 * (days > -5)
    plain = fit_course(days, values, own**2, RATE)
    other = fit_course(days, 1e-9 * values + 1e-3, (1e-9 * own) ** 2, RATE)
    assert plain.starts == other.starts and plain.has_slope == other.has_slope
    assert (other.levels - 1e-3) * 1e9 == pytest.approx(plain.levels, rel=1e-4)


def recorded(bag, day, tilt, expanded=1e-7, stage="A", cell="/", speed=4.0):
    segment = f"forward {speed:.4g} rad/s"
    figures = (
        Figure("tilt_x.total", segment, tilt, expanded, "rad", tilt, 4, 100, 60.0),
        Figure("tilt_y.total", segment, 0.1 * tilt, expanded, "rad", tilt, 4, 100, 60.0),
        Figure("lvdt_at_16mm.difference_rms", "", 1e-8, None, "m"),
    )
    return RecordingFigures(bag, stage, cell, BEGIN_NS + day * DAY_NS, figures, {segment: speed})


def test_recordings_are_grouped_and_ordered_and_speeds_that_are_alike_are_one():
    rows = [recorded(f"b{day}", day, 1e-6, speed=4.0 + 0.002 * day) for day in (3, 1, 2)]
    rows += [recorded("other", 1, 1e-6, stage="B"), recorded("left", 1, 1e-6, cell="/left")]
    rows += [recorded("fast", 4, 1e-6, speed=5.0), recorded("copy", 2, 9e-6)]
    found = histories(rows, ErrorMotionLimits(), RATE)
    assert [(each.stage, each.cell, each.name) for each in found] == [
        *(("A", "/", "A"), ("A", "/left", "A in /left"), ("B", "/", "B"))
    ]
    assert [row.bag for row in found[0].recordings] == ["b1", "b2", "b3", "fast"]
    assert found[0].copies == ("copy",)
    assert {(t.series.name, t.series.segment, t.series.places) for t in found[0].trends} == {
        (f"tilt_{axis}.total", "forward 4.006 rad/s", (0, 1, 2)) for axis in "xy"
    }
    assert found[0].outcome is Conformity.NO_LIMITS and found[1].trends == ()


def test_a_limit_tells_who_passed_it_first_and_what_is_left():
    tilts = (1.0e-6, 1.1e-6, 3.0e-6, 1.2e-6, 1.3e-6)
    rows = [recorded(f"b{day}", day, tilt) for day, tilt in enumerate(tilts)]
    (found,) = histories(rows, ErrorMotionLimits(tilt_total=2e-6, axial_total=1e-6), RATE)
    standing, untold = found.standings
    assert (standing.now.name, standing.now.outcome, standing.first_beyond) == ("tilt_total", Conformity.WITHIN, 2)
    assert standing.closest is not None and standing.closest.series.name == "tilt_x.total"
    assert standing.margin is not None and standing.margin[0] == pytest.approx(2e-6 - standing.closest.now, rel=1e-12)
    assert untold.now.outcome is Conformity.OPEN and untold.margin is None and untold.first_beyond is None
    assert found.outcome is Conformity.OPEN
    (beyond,) = histories(rows[:3], ErrorMotionLimits(tilt_total=2e-6), RATE)
    assert beyond.outcome is Conformity.BEYOND


def test_the_rate_is_of_all_figures_of_a_stage_together():
    rng = np.random.default_rng(4)
    runs, alarms = 60, 0
    for _ in range(runs):
        rows = []
        for day in range(6):
            figures = tuple(
                Figure(f"radial_x_at_{k}mm.total", "s", 1e-6 + 1e-8 * rng.standard_normal(), 2e-8, "m")
                for k in range(20)
            )
            rows.append(RecordingFigures(f"b{day}", "A", "/", BEGIN_NS + day * DAY_NS, figures, {"s": 4.0}))
        (found,) = histories(rows, ErrorMotionLimits(), RATE)
        alarms += bool(found.changed)
    assert alarms <= at_most(RATE, runs)
