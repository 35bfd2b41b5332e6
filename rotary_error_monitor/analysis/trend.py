"""One figure over recordings: steps with their dates, slope, what it is now, and when it reaches a limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.analysis.partition import LevelCourse, fit_course
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.spindle_figures import COVERAGE

DAY_NS = 86_400_000_000_000
"""Slopes are told for a day: wear of a stage that is in use shows over days to months."""


@dataclass(frozen=True)
class Series:
    """One figure in n recordings of a stage, those in which it has an uncertainty.

    Attributes:
        name: of the figure, such as `tilt_x.total`.
        segment: direction and speed as the latest recording calls it; empty for whole recordings.
        unit: SI.
        places: (n,) which recordings of the stage, ascending in time.
        started_ns: (n,) when they began, ns.
        values: (n,) in `unit`.
        uncertainties: (n,) standard uncertainties, above 0.
    """

    name: str
    segment: str
    unit: str
    places: tuple[int, ...]
    started_ns: Times
    values: Array
    uncertainties: Array


@dataclass(frozen=True)
class TrendStep:
    """A change from one recording to the next.

    Attributes:
        previous, place: numbers of the recordings between which it lies, among those of the stage.
        before, after: levels at that time, in the unit of the figure.
        expanded_uncertainty: of their difference, k = 2.
    """

    previous: int
    place: int
    before: float
    after: float
    expanded_uncertainty: float


@dataclass(frozen=True)
class LimitReach:
    """When a limit is reached if the slope stays: timestamps (ns), an interval of 95 %; no end where none is told."""

    at_ns: int
    earliest_ns: int
    latest_ns: int | None


@dataclass(frozen=True)
class Trend:
    """What a series shows.

    Attributes:
        series: as it is.
        course: what was fitted, times in days after the latest recording.
        steps: in their order.
        scatter: of values about the course, in their standard uncertainties (Birge ratio); 1 expected, NaN where
            nothing is left over to tell it.
        scatters: whether it is larger than uncertainties alone would make it in `false_alarms` of all series.
    """

    series: Series
    course: LevelCourse
    steps: tuple[TrendStep, ...]
    scatter: float
    scatters: bool

    @property
    def _widening(self) -> float:
        return _widening(self.scatter)

    @property
    def slope(self) -> float:
        """For a day, as fitted between the steps; `has_slope` says whether it is told from none."""
        return self.course.free_slope

    @property
    def slope_uncertainty(self) -> float:
        """Expanded, k = 2; infinite where no level has two values at two times."""
        return COVERAGE * self._widening * math.sqrt(self.course.covariance[-1, -1])

    @property
    def has_slope(self) -> bool:
        """Whether the slope is told from none."""
        return self.course.has_slope

    @property
    def now(self) -> float:
        """The course at the latest recording."""
        return float(self.course.levels[-1])

    @property
    def now_uncertainty(self) -> float:
        """Expanded, k = 2; not below the level's surest recording: what recordings share does not average out."""
        fitted = self._widening * math.sqrt(self.course.covariance[-2, -2])
        return COVERAGE * max(fitted, float(self.series.uncertainties[self.course.starts[-1] :].min()))

    def at(self, started_ns: Times) -> Array:
        """The course (m,) at recordings of the series, by their beginning."""
        days = (started_ns - self.series.started_ns[-1]) / DAY_NS
        first = self.series.started_ns[list(self.course.starts)]
        level = np.searchsorted(first, started_ns, side="right") - 1
        return np.asarray(self.course.levels[level] + self.course.slope * days)

    def reach(self, limit: float) -> LimitReach | None:
        """When it rises to a limit; None where it does not rise, or is there already.

        The interval holds all times at which the course is not told from the limit (Fieller 1954).
        """
        course, now = self.course, self.now
        if not (course.has_slope and course.slope > 0 and now < limit):
            return None
        wide = (COVERAGE * self._widening) ** 2
        both, slope = (course.covariance[i, -1] for i in (-2, -1))
        square = course.slope**2 - wide * slope
        middle = (limit - now) * course.slope + wide * both
        rest = (limit - now) ** 2 - self.now_uncertainty**2
        root = math.sqrt(max(middle**2 - square * rest, 0.0))
        # the forms that do not divide by what may be near 0
        earliest = 0.0 if rest <= 0 else rest / (middle + root) if middle + root > 0 else math.inf
        latest = (middle + root) / square if square > 0 else math.inf
        latest_ns = self._date(latest)
        at_ns, earliest_ns = self._date((limit - now) / course.slope), self._date(earliest)
        if at_ns is None or earliest_ns is None:
            return None
        return LimitReach(at_ns, earliest_ns, latest_ns)

    def _date(self, days: float) -> int | None:
        """Timestamp (ns); None beyond what 64 bits hold, the year 2262."""
        stamp = float(self.series.started_ns[-1]) + days * DAY_NS
        return int(self.series.started_ns[-1]) + round(days * DAY_NS) if stamp < float(2**63 - 1) else None


def estimate_trend(series: Series, false_alarms: float) -> Trend:
    """Steps and slope of a series of two recordings at least.

    Args:
        series: of one figure.
        false_alarms: largest chance that a step or a slope is told where there is none.
    """
    days = (series.started_ns - series.started_ns[-1]) / DAY_NS
    course = fit_course(days, series.values, series.uncertainties**2, false_alarms)
    freedom = len(days) - len(course.levels) - course.has_slope
    scatter = math.sqrt(course.chi_square / freedom) if freedom > 0 else math.nan
    unlikely = freedom > 0 and chi_square_tail(course.chi_square, freedom) < false_alarms
    return Trend(series, course, tuple(_steps(series, course, days, _widening(scatter))), scatter, unlikely)


def _widening(scatter: float) -> float:
    """Where values scatter more than they should, what follows from them is as much less sure (PDG's factor S)."""
    return max(1.0, scatter) if math.isfinite(scatter) else 1.0


def _steps(series: Series, course: LevelCourse, days: Array, widening: float) -> Sequence[TrendStep]:
    found = []
    for number, start in enumerate(course.starts[1:], start=1):
        c = course.covariance
        levels = [float(course.levels[k] + course.slope * days[start]) for k in (number - 1, number)]
        variance = c[number, number] + c[number - 1, number - 1] - 2 * c[number, number - 1]
        places = series.places[start - 1], series.places[start]
        found.append(TrendStep(*places, levels[0], levels[1], COVERAGE * widening * math.sqrt(variance)))
    return found
