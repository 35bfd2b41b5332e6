"""The page of a trend: for each stage its limits, what changed when, what drifts, and the recordings themselves."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from rotary_error_monitor.analysis.history import LimitStanding, StageHistory
from rotary_error_monitor.analysis.trend import LimitReach, Trend
from rotary_error_monitor.analysis.trend_result import FolderTrend, Unread, date_of
from rotary_error_monitor.analysis.verdict import Conformity
from rotary_error_monitor.gap.quantities import number, shared_power
from rotary_error_monitor.report.analysis import BADGES, OUTCOMES
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import (
    about,
    bullets,
    images,
    paragraph,
    section,
    table,
    terms,
    verdict,
    whole_page,
)
from rotary_error_monitor.report.wording import amount, counted, spoken, with_unit

_TERMS = {
    "figure": "error motion value or drift of a recording, as rotary_error_monitor analyse gives it (doc/analysis.md)",
    "step": "the level of a figure differs before and after, by more than its uncertainties make likely; the date is "
    "that of the first recording after it. Steps and slopes are told together: each must improve the fit by a penalty "
    "that follows from the rate of false alarms above, which holds for all figures of a stage together",
    "slope": "change in a day between the steps; told where it is distinguished from none in the same way",
    "now": "the fitted course at the latest recording",
    "± U": "expanded uncertainty, k = 2 (about 95 %), from the uncertainties of the recordings; multiplied by the "
    "scatter where that is above 1",
    "scatter": "of the values about the course, in their standard uncertainties; about 1 is expected. Where it is much "
    "larger, something changes from recording to recording that is not in the uncertainties, such as temperature or "
    "mounting, and may look like steps",
    "room left": "limit less the course at the latest recording, of the figure that is closest to the limit",
    "reached": "when the course meets the limit if the slope stays, and the interval of 95 % (Fieller 1954)",
    "beyond, within": "a value less U is above the limit, or a value and U below it (ISO 14253-1)",
}


def trend_sentence(trend: FolderTrend) -> str:
    """What is said first."""
    worst = [stage for stage in trend.stages if stage.outcome is trend.outcome]
    names = ", ".join(f"{stage.name} ({', '.join(_at_fault(stage))})" for stage in worst)
    count = len(trend.stages)
    stages = "the stage" if count == 1 else f"all {count} stages"
    said = {
        Conformity.NO_LIMITS: "No limits were given, so there is no verdict.",
        Conformity.WITHIN: f"By its latest recording {stages} kept all limits, uncertainty included.",
        Conformity.BEYOND: f"Beyond limits by the latest recording: {names}.",
        Conformity.OPEN: f"Whether limits are kept cannot be told from the latest recording: {names}.",
    }[trend.outcome]
    changed = sum(bool(stage.changed) for stage in trend.stages)
    recordings = len([row for stage in trend.stages for row in stage.recordings])
    left = len(trend.unread) + len(trend.undone)
    return (
        f"{said} {counted(recordings, 'recording')} of {counted(count, 'stage')}; something changed or drifts in "
        f"{counted(changed, 'stage') if changed else 'none'}."
        + (f" {counted(left, 'bag')} could not be used." if left else "")
    )


def _at_fault(stage: StageHistory) -> Iterator[str]:
    for standing in stage.standings:
        if standing.now.outcome is stage.outcome:
            yield spoken(standing.now.name)


def page(trend: FolderTrend, pictures: Mapping[str, Sequence[Drawn]], title: str, facts: Mapping[str, str]) -> str:
    """The whole page.

    Args:
        trend: what is shown.
        pictures: by the name of the stage, as `trend_figure.draw` gives them.
        title: of the page.
        facts: what was looked at, when, and by what this was made.
    """
    sections = [
        verdict(*BADGES[trend.outcome], trend_sentence(trend)),
        *(_stage(stage, pictures.get(stage.name, ())) for stage in trend.stages),
        _left_out("Bags that cannot be analysed", trend.unread),
        _left_out("Bags that were not read this time", trend.undone),
        section("Bags that are no longer there", bullets(trend.gone)) if trend.gone else "",
        terms(_TERMS),
        about(facts),
    ]
    return whole_page("Trend", title, sections)


def _stage(stage: StageHistory, pictures: Sequence[Drawn]) -> str:
    return section(
        stage.name,
        section("Limits", table(_LIMIT_HEAD, [_limit(stage, each) for each in stage.standings]), level=3),
        section(
            "What changed", _changes(stage, stage.changed) if stage.changed else paragraph(_nothing(stage)), level=3
        ),
        section("Over time", images(pictures), level=3),
        section("All figures", *_figures(stage.trends), level=3),
        section("Recordings", _recordings(stage), level=3),
    )


def _nothing(stage: StageHistory) -> str:
    if not stage.trends:
        return "Two recordings with a figure in common are needed to tell a change: there are none."
    return f"Nothing that exceeds the uncertainties, of {len(stage.trends)} figures."


_LIMIT_HEAD = (
    "figure",
    "limit",
    "latest recording ± U",
    "outcome",
    "room left ± U",
    "first beyond",
    "reached if it goes on",
    "latest of",
    "at",
)


def _limit(stage: StageHistory, standing: LimitStanding) -> list[str]:
    now, first, reaching = standing.now, standing.first_beyond, standing.reaching
    return [
        spoken(now.name),
        with_unit(now.limit, now.unit),
        "not told" if now.value is None else amount(now.value, now.unit),
        OUTCOMES[now.outcome],
        "–" if standing.margin is None else with_unit(standing.margin[0], now.unit, standing.margin[1]),
        "–" if first is None else f"{date_of(stage.recordings[first].started_ns)}, {stage.recordings[first].bag}",
        "–" if reaching is None else f"{_when(reaching[1])} ({spoken(reaching[0].series.name)})",
        spoken(now.where[1]) or "–",
        now.where[0] or "–",
    ]


def _when(reach: LimitReach) -> str:
    latest = "never" if reach.latest_ns is None else date_of(reach.latest_ns)[:10]
    return f"{date_of(reach.at_ns)[:10]}, between {date_of(reach.earliest_ns)[:10]} and {latest}"


def _changes(stage: StageHistory, trends: Sequence[Trend]) -> str:
    rows = [row for trend in trends for row in _rows(stage, trend)]
    return bullets(list(_events(stage, trends))) + table(
        ["figure", "segment", "what", "when", "from", "to", "change ± U (k = 2)"], rows
    )


def _events(stage: StageHistory, trends: Sequence[Trend]) -> Iterator[str]:
    """What happened, each event once: its date, how many figures show it, and which shows it best."""
    steps = sorted(((step.place, trend, step) for trend in trends for step in trend.steps), key=lambda row: row[0])
    for place, same in itertools.groupby(steps, key=lambda row: row[0]):
        rows = list(same)
        _, trend, step = max(rows, key=lambda row: abs(row[2].after - row[2].before) / row[2].expanded_uncertainty)
        levels = " to ".join(with_unit(level, trend.series.unit) for level in (step.before, step.after))
        first = stage.recordings[place]
        yield (
            f"{date_of(first.started_ns)}, from {first.bag} on: a step in {counted(len(rows), 'figure')}, "
            f"most clearly in {spoken(trend.series.name)}, from {levels}"
        )
    drifting = [trend for trend in trends if trend.has_slope]
    if drifting:
        best = max(drifting, key=lambda trend: abs(trend.slope) / trend.slope_uncertainty)
        slope = with_unit(best.slope, f"{best.series.unit}/day", best.slope_uncertainty)
        yield f"a slope of {counted(len(drifting), 'figure')}, most clearly of {spoken(best.series.name)}, {slope}"


def _rows(stage: StageHistory, trend: Trend) -> Iterator[list[str]]:
    series, unit = trend.series, trend.series.unit
    name = [spoken(series.name), series.segment or "–"]
    for step in trend.steps:
        levels = [with_unit(level, unit) for level in (step.before, step.after)]
        change = with_unit(step.after - step.before, unit, step.expanded_uncertainty)
        first = stage.recordings[step.place]
        yield [*name, "step", f"{date_of(first.started_ns)}, {first.bag}", *levels, change]
    if trend.has_slope:
        slope = with_unit(trend.slope, f"{unit}/day", trend.slope_uncertainty)
        levels = [with_unit(float(level), unit) for level in trend.at(series.started_ns[[0, -1]])]
        begin, end = (date_of(int(each))[:10] for each in series.started_ns[[0, -1]])
        yield [*name, "slope", f"{begin} to {end}", *levels, slope]


def _figures(trends: Sequence[Trend]) -> Iterator[str]:
    """A table for each unit, which the head tells."""
    for unit in dict.fromkeys(trend.series.unit for trend in trends):
        yield _figures_in([trend for trend in trends if trend.series.unit == unit], unit)


def _figures_in(trends: Sequence[Trend], unit: str) -> str:
    prefixed, power = shared_power([trend.now for trend in trends], unit)
    sloping = [trend for trend in trends if math.isfinite(trend.slope_uncertainty)]
    a_day, slope_power = shared_power([trend.slope for trend in sloping], f"{unit}/day")
    rows = []
    for trend in trends:
        told = math.isfinite(trend.slope_uncertainty)
        scatter = f"{trend.scatter:.2g}" if math.isfinite(trend.scatter) else "–"
        rows.append(
            [
                spoken(trend.series.name),
                trend.series.segment or "–",
                str(len(trend.series.places)),
                number(trend.now, trend.now_uncertainty, power),
                number(trend.slope, trend.slope_uncertainty, slope_power) if told else "–",
                str(len(trend.steps) or "–"),
                scatter + (" (large)" if trend.scatters else ""),
            ]
        )
    values = f"now ± U, {prefixed}", f"slope ± U, {a_day}"
    return table(["figure", "segment", "recordings", *values, "steps", "scatter"], rows)


def _recordings(stage: StageHistory) -> str:
    rows = [[date_of(row.started_ns), row.bag, "; ".join(row.remarks) or "–"] for row in stage.recordings]
    copies = [f"{bag} began when another did: a copy, which does not count" for bag in stage.copies]
    return table(["began (UTC)", "bag", "notes"], rows) + (bullets(copies) if copies else "")


def _left_out(title: str, bags: Sequence[Unread]) -> str:
    rows = [[each.bag, each.cell or "–", each.reason] for each in bags]
    return section(title, table(["bag", "cell", "why"], rows))
