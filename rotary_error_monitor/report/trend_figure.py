"""Pictures of a trend: for each stage the figures that matter most, over the dates of its recordings."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from rotary_error_monitor.analysis.history import StageHistory
from rotary_error_monitor.analysis.trend import Trend
from rotary_error_monitor.analysis.trend_result import FolderTrend, date_of
from rotary_error_monitor.arrays import Times
from rotary_error_monitor.metrology.spindle_figures import COVERAGE
from rotary_error_monitor.report.drawing import WIDE, drawn, in_rows, label, new_axes, tiled
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLUE, GREY, VERMILION
from rotary_error_monitor.report.wording import spoken, with_unit
from rotary_error_monitor.units import MICRO

MOST_PANELS = 12
"""Figures that are drawn of a stage: what fits on a page; the tables have all."""

_COLUMNS = 2
"""Pictures side by side in the one PNG of all."""

_HEIGHT = 2.5
"""Of a picture, inches."""

_NEAR = 2.0
"""A limit that is farther up than twice the largest value would press the values together; its table tells it."""

_VALUE, _COURSE, _LIMIT = "value ± U (k = 2)", "course", "limit"


def draw(trend: FolderTrend) -> dict[str, list[Drawn]]:
    """Pictures by the name of the stage; none of a stage without two recordings of a figure."""
    return {stage.name: list(_pictures(stage)) for stage in trend.stages if stage.trends}


def joined(pictures: Mapping[str, Sequence[Drawn]]) -> bytes:
    """One PNG of all; blank where there is none."""
    return tiled([row for each in pictures.values() for row in in_rows(each, _COLUMNS)])


def shown(stage: StageHistory) -> list[Trend]:
    """What is drawn: figures that limits are closest to, then those that change, then error motion values in order."""
    limited = [standing.closest for standing in stage.standings if standing.closest is not None]
    rising = [standing.reaching[0] for standing in stage.standings if standing.reaching is not None]
    changed = sorted(stage.changed, key=lambda trend: "_about_" in trend.series.name)  # the same about another centre
    totals = [trend for trend in stage.trends if trend.series.name.endswith(".total")]
    found = {id(trend): trend for trend in (*limited, *rising, *changed, *totals, *stage.trends)}
    return list(found.values())[:MOST_PANELS]


def _pictures(stage: StageHistory) -> Iterator[Drawn]:
    limits = {id(each.closest): each.now.limit for each in stage.standings if each.closest is not None}
    limits |= {id(each.reaching[0]): each.now.limit for each in stage.standings if each.reaching is not None}
    for trend in shown(stage):
        yield _picture(stage, trend, limits.get(id(trend)))


def _picture(stage: StageHistory, trend: Trend, limit: float | None) -> Drawn:
    series = trend.series
    near = None if limit is None or limit > _NEAR * float(series.values.max()) else limit
    figure, ax = new_axes(WIDE, _HEIGHT, (_VALUE, _COURSE, *(() if near is None else (_LIMIT,))))
    _draw(ax, stage, trend, near)
    name = ", ".join(filter(None, (spoken(series.name), series.segment)))
    label(figure, ax, name, _axis(stage), f"µ{series.unit}")
    return drawn(figure, f"{name}, of {stage.name}: {_in_words(stage, trend)}")


def _axis(stage: StageHistory) -> str:
    """Name of the axis, which tells the stage as far as its name can be drawn: it is anything that a bag says."""
    name = "".join(letter if letter.isascii() and letter.isprintable() else "?" for letter in stage.name)
    return f"date (UTC), {name}".replace("$", r"\$")


def _in_words(stage: StageHistory, trend: Trend) -> str:
    unit, stamps = trend.series.unit, trend.series.started_ns
    begin, end = (date_of(int(stamp))[:10] for stamp in stamps[[0, -1]])
    now = with_unit(trend.now, unit, trend.now_uncertainty)
    steps = "; a step on ".join(["", *(date_of(stage.recordings[step.place].started_ns)[:10] for step in trend.steps)])
    return f"{len(stamps)} recordings from {begin} to {end}, now {now}{steps}{'; a slope' if trend.has_slope else ''}"


def _draw(ax: Axes, stage: StageHistory, trend: Trend, limit: float | None) -> None:
    series = trend.series
    expanded = COVERAGE * series.uncertainties * MICRO
    dates = _dates(series.started_ns)
    ax.errorbar(dates, series.values * MICRO, expanded, color=BLUE, fmt=".", ms=5, lw=1.0, label=_VALUE)
    edges = [*trend.course.starts, len(dates)]
    for first, after in itertools.pairwise(edges):
        own = series.started_ns[[first, after - 1]]
        ax.plot(_dates(own), trend.at(own) * MICRO, color=VERMILION, lw=1.4, label=None if first else _COURSE)
    for step in trend.steps:
        begun = np.array([stage.recordings[step.place].started_ns])
        ax.axvline(_dates(begun)[0], color=VERMILION, lw=1.0, ls=":")
    if limit is not None:
        ax.axhline(limit * MICRO, color=GREY, lw=1.2, ls="--", label=_LIMIT)
    locator = AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]  # matplotlib has no types here
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    ax.xaxis.get_offset_text().set_fontsize(ax.xaxis.get_ticklabels()[0].get_fontsize())
    ax.grid(alpha=0.3)


def _dates(stamps_ns: Times) -> np.ndarray[tuple[int, ...], np.dtype[np.datetime64]]:
    return stamps_ns.astype("datetime64[ns]")
