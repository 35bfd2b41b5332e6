"""Steps and a slope in a series of values with known uncertainties: optimal partitioning at a named false-alarm rate.

Jackson et al., An algorithm for optimal partitioning of data on an interval, IEEE Signal Process. Lett. 12 (2005);
pruned as PELT (Killick, Fearnhead and Eckley, J. Am. Stat. Assoc. 107, 2012).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaln, logsumexp

from rotary_error_monitor.arrays import Array

MOST_ROUNDS = 20
"""Times that slope and steps are found in turn: three settle nearly all, and none is needed to keep the rate."""

LEAST_FOR_SLOPE = 3
"""Values from which a slope is told from a step."""


@dataclass(frozen=True)
class LevelCourse:
    """Levels between steps, and a slope that all of them share.

    Attributes:
        starts: first value of each level, 0 the first.
        levels: (m,) of each level, at `times` = 0.
        slope: for one unit of the times; 0 where none is told.
        has_slope: whether one is told.
        covariance: (m + 1, m + 1) of the levels and of the slope, whether it is told or not.
        free_slope: slope as fitted beside these levels, whether it is told or not.
        chi_square: sum of the squares of the residuals over their variances.
    """

    starts: tuple[int, ...]
    levels: Array
    slope: float
    has_slope: bool
    covariance: Array
    free_slope: float
    chi_square: float

    @property
    def terms(self) -> int:
        """How many steps and slopes are told."""
        return len(self.starts) - 1 + self.has_slope


@functools.lru_cache(maxsize=1024)  # the figures of a stage have few numbers of values between them
def penalty_of(count: int, false_alarms: float) -> float:
    """What a step or a slope must take off chi-square to be told.

    Of n values there are n - 1 places for a step and one slope (none of two values, of which a step says as much): m
    terms, and C(m, j) sets of j of them. Where nothing changes, a set takes off a chi-square of j degrees of freedom;
    any set is chosen only if that exceeds j times the penalty b, so that `sum_j C(m, j) P(chi2_j > j b)` bounds the
    rate whatever the uncertainties are. This is the b at which that sum is the rate.

    Args:
        count: values, 2 at least.
        false_alarms: largest chance that a step or a slope is told where there is none, above 0 and below 1.
    """
    from scipy.stats import chi2  # loads for a second or two

    most_terms = count if count >= LEAST_FOR_SLOPE else count - 1
    terms = np.arange(1, most_terms + 1)
    sets = gammaln(most_terms + 1) - gammaln(terms + 1) - gammaln(most_terms - terms + 1)

    def excess(penalty: float) -> float:
        return float(logsumexp(sets + chi2.logsf(terms * penalty, terms)) - np.log(false_alarms))

    least = float(chi2.isf(min(false_alarms, 0.5), 1))  # one term alone needs as much
    most = least + 10.0 + 4.0 * np.log(count)
    while excess(most) > 0:
        most *= 2
    return float(brentq(excess, 0.0, most))


def partition(values: Array, variances: Array, penalty: float) -> tuple[int, ...]:
    """First value of each level of the piecewise constant course of least chi-square plus penalty for each step.

    Args:
        values: (n,) in their order.
        variances: (n,) of them, above 0.
        penalty: for each step.
    """
    weights = 1.0 / variances
    sums = [np.concatenate([[0.0], np.cumsum(weights * power)]) for power in (np.ones_like(values), values, values**2)]
    best = np.full(len(values) + 1, -penalty)
    last = np.zeros(len(values) + 1, np.intp)
    places = np.array([0])
    for end in range(1, len(values) + 1):
        weight, first, second = (each[end] - each[places] for each in sums)
        costs = best[places] + second - first**2 / weight
        chosen = int(np.argmin(costs))
        best[end], last[end] = costs[chosen] + penalty, places[chosen]
        places = np.append(places[costs <= best[end]], end)
    starts: list[int] = []
    end = len(values)
    while end:
        end = int(last[end])
        starts.append(end)
    return tuple(reversed(starts))


def fit_course(times: Array, values: Array, variances: Array, false_alarms: float) -> LevelCourse:
    """The likeliest course of constant, line, steps, and steps on a line, each term at the price of `penalty_of`.

    Args:
        times: (n,) ascending, of any unit; n is 2 at least.
        values: (n,).
        variances: (n,) of them, above 0.
        false_alarms: largest chance that a step or a slope is told where there is none.
    """
    penalty = penalty_of(len(values), false_alarms)
    shift = float(np.average(values, weights=1 / variances))  # differences of large sums would lose digits
    scale = float(np.sqrt(variances.min()))
    y, v = (values - shift) / scale, variances / scale**2
    steps = [_fit(times, y, v, starts, False) for starts in ((0,), partition(y, v, penalty))]
    lines: list[LevelCourse] = []
    if len(y) >= LEAST_FOR_SLOPE:
        lines.append(_fit(times, y, v, (0,), True))
        lines += [_steps_on_a_line(times, y, v, penalty, begin) for begin in (lines[0], steps[1])]
    found = min((*steps, *lines), key=lambda each: each.chi_square + penalty * each.terms)
    return LevelCourse(
        found.starts,
        found.levels * scale + shift,
        found.slope * scale,
        found.has_slope,
        found.covariance * scale**2,
        found.free_slope * scale,
        found.chi_square,
    )


def _steps_on_a_line(times: Array, values: Array, variances: Array, penalty: float, begin: LevelCourse) -> LevelCourse:
    """Slope and steps in turn, from those of `begin` on, until the steps stay; then without those that do not pay.

    Steps that were found beside a wrong slope hold it in its place, each too small to be told by itself.
    """
    found = _fit(times, values, variances, begin.starts, True)
    for _ in range(MOST_ROUNDS):
        starts = partition(values - found.slope * times, variances, penalty)
        if starts == found.starts:
            break
        found = _fit(times, values, variances, starts, True)
    while len(found.starts) > 1:
        without = [tuple(each for each in found.starts if each != start) for start in found.starts[1:]]
        best = min((_fit(times, values, variances, each, True) for each in without), key=lambda each: each.chi_square)
        if best.chi_square > found.chi_square + penalty:
            break
        found = best
    return found


def _fit(times: Array, values: Array, variances: Array, starts: tuple[int, ...], slope: bool) -> LevelCourse:
    """Weighted least squares of levels and, if `slope`, a slope."""
    number = np.searchsorted(starts, np.arange(len(values)), side="right") - 1
    weights = 1 / variances
    total = np.bincount(number, weights)
    means = [np.bincount(number, weights * each) / total for each in (times, values)]
    t, y = times - means[0][number], values - means[1][number]
    moment = float(weights @ t**2)  # 0 where each level has one value, or all are at one time
    free = float(weights @ (t * y)) / moment if moment > 0 else 0.0
    told = free if slope else 0.0
    covariance = np.diag(np.append(1 / total, np.inf if moment <= 0 else 1 / moment))
    if slope and moment > 0:
        covariance[:-1, :-1] += np.outer(means[0], means[0]) / moment
        covariance[-1, :-1] = covariance[:-1, -1] = -means[0] / moment
    levels = means[1] - told * means[0]
    return LevelCourse(
        starts, levels, told, slope and moment > 0, covariance, free, float(weights @ (y - told * t) ** 2)
    )
