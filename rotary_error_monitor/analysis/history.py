"""The recordings of a stage in the order of time: their figures as series, and how it stands beside its limits."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.analysis.runs import ALIKE
from rotary_error_monitor.analysis.trend import LimitReach, Series, Trend, estimate_trend
from rotary_error_monitor.analysis.verdict import Conformity, Judged, Told, judge_values
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.metrology.spindle_figures import COVERAGE, ErrorMotionValue


@dataclass(frozen=True)
class RecordingFigures:
    """What one recording says of a stage.

    Attributes:
        bag: by which it is called.
        stage: that it is of.
        cell: namespace of the stage's cell, `/` for none.
        started_ns: when it began, ns.
        figures: as `analyse` gives them.
        speeds: of its segments with their sign, rad/s, by their names.
        remarks: what a reader should know.
    """

    bag: str
    stage: str
    cell: str
    started_ns: int
    figures: tuple[Figure, ...]
    speeds: Mapping[str, float]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class LimitStanding:
    """A stage beside one of its limits.

    Attributes:
        now: as the latest recording is judged.
        first_beyond: number of the first recording that is beyond the limit; None where none is.
        closest: series with the least room left at the latest recording, uncertainty included; None where none is.
        margin: limit less its course at the latest recording, in the limit's unit, and the expanded uncertainty.
        reaching: series that reaches the limit first, and when; None where none rises.
    """

    now: Judged
    first_beyond: int | None
    closest: Trend | None
    margin: tuple[float, float] | None
    reaching: tuple[Trend, LimitReach] | None


@dataclass(frozen=True)
class StageHistory:
    """The recordings of one stage.

    Attributes:
        stage, cell: which it is.
        recordings: in the order of time.
        trends: of figures with an uncertainty that two recordings have.
        outcome: of the latest recording beside all limits.
        standings: by limit.
        copies: bags that began at the same time as another: copies of it, which count once.
    """

    stage: str
    cell: str
    recordings: tuple[RecordingFigures, ...]
    trends: tuple[Trend, ...]
    outcome: Conformity
    standings: tuple[LimitStanding, ...]
    copies: tuple[str, ...]

    @property
    def name(self) -> str:
        """Stage and, where it is in a namespace, cell."""
        return self.stage if self.cell == "/" else f"{self.stage} in {self.cell}"

    @property
    def changed(self) -> tuple[Trend, ...]:
        """Figures that have a step or a slope."""
        return tuple(trend for trend in self.trends if trend.steps or trend.has_slope)


def histories(
    recordings: Iterable[RecordingFigures], limits: ErrorMotionLimits, false_alarms: float
) -> tuple[StageHistory, ...]:
    """The recordings by stage, and what they show.

    Args:
        recordings: in any order.
        limits: of every stage.
        false_alarms: largest chance that anything is told to change of a stage that does not change.
    """
    ordered = sorted(recordings, key=lambda each: (each.stage, each.cell, each.started_ns, each.bag))
    grouped = itertools.groupby(ordered, key=lambda each: (each.stage, each.cell))
    return tuple(_history(*key, list(rows), limits, false_alarms) for key, rows in grouped)


def _history(
    stage: str, cell: str, rows: Sequence[RecordingFigures], limits: ErrorMotionLimits, false_alarms: float
) -> StageHistory:
    first = {row.started_ns: row for row in reversed(rows)}
    kept = tuple(row for row in rows if first[row.started_ns] is row)
    series = [each for each in _series(kept) if len(each.places) > 1]
    # as likely for one of many as is named for all of them together (Bonferroni)
    trends = tuple(estimate_trend(each, false_alarms / len(series)) for each in series)
    judged = [judge_values(list(_told(row)), limits) for row in kept]
    standings = tuple(_standing(number, judged, trends) for number in range(len(limits.stated)))
    copies = tuple(row.bag for row in rows if first[row.started_ns] is not row)
    return StageHistory(stage, cell, kept, trends, judged[-1][0], standings, copies)


def _series(rows: Sequence[RecordingFigures]) -> Iterator[Series]:
    """Figures that have an uncertainty, over those recordings that tell them."""
    names = _common_names(rows)
    found: dict[tuple[str, str], dict[int, Figure]] = defaultdict(dict)
    for place, row in enumerate(rows):
        for figure in row.figures:
            if figure.expanded_uncertainty:
                found[figure.name, names.get((place, figure.segment), "")][place] = figure
    for (name, segment), figures in found.items():
        places = tuple(figures)
        yield Series(
            name,
            segment,
            figures[places[-1]].unit,
            places,
            np.array([rows[place].started_ns for place in places], np.int64),
            np.array([figure.value for figure in figures.values()]),
            np.array([figure.expanded_uncertainty for figure in figures.values()], np.float64) / COVERAGE,
        )


def _common_names(rows: Sequence[RecordingFigures]) -> Mapping[tuple[int, str], str]:
    """Name of each segment (recording, own name) in all recordings: that of the latest one at a like speed."""
    speeds: dict[tuple[bool, bool], list[tuple[float, int, str]]] = defaultdict(list)
    for place, row in enumerate(rows):
        for name, speed in row.speeds.items():
            speeds[speed > 0, name.endswith("changing")].append((abs(speed), place, name))
    found: dict[tuple[int, str], str] = {}
    for same in speeds.values():
        left = sorted(same)
        while left:
            alike = [row for row in left if row[0] <= left[0][0] * (1 + ALIKE)]
            latest = max(alike, key=lambda row: row[1])[2]
            found |= {(place, name): latest for _, place, name in alike}
            left = left[len(alike) :]
    return found


def _told(row: RecordingFigures) -> Iterator[Told]:
    """Values that limits are for: error motion values of segments."""
    for figure in row.figures:
        if figure.segment and figure.expanded_uncertainty is not None:
            signal, _, name = figure.name.rpartition(".")
            measured = figure.value if figure.measured is None else figure.measured
            value = ErrorMotionValue(figure.value, measured, figure.expanded_uncertainty / COVERAGE)
            yield Told(signal.partition("_")[0], name, value, figure.segment, signal)


def _standing(
    number: int, judged: Sequence[tuple[Conformity, tuple[Judged, ...]]], trends: Sequence[Trend]
) -> LimitStanding:
    now = judged[-1][1][number]
    beyond = [place for place, (_, rows) in enumerate(judged) if rows[number].outcome is Conformity.BEYOND]
    limited = [trend for trend in trends if _is_limited(trend.series, now.name)]
    own = [trend for trend in limited if trend.series.places[-1] == len(judged) - 1]  # of others nobody knows now
    closest = max(own, key=lambda trend: trend.now + trend.now_uncertainty, default=None)
    rising = [(trend, when) for trend in own for when in [trend.reach(now.limit)] if when is not None]
    return LimitStanding(
        now,
        beyond[0] if beyond else None,
        closest,
        None if closest is None else (now.limit - closest.now, closest.now_uncertainty),
        min(rising, key=lambda pair: pair[1].at_ns, default=None),
    )


def _is_limited(series: Series, limit: str) -> bool:
    quantity, _, figure = limit.partition("_")
    signal, _, name = series.name.rpartition(".")
    return bool(series.segment) and (signal.partition("_")[0], name) == (quantity, figure)
