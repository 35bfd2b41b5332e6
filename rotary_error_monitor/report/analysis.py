"""The page of an analysis: verdict, limits, polar plots, values, orders, course over time, streams, words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from rotary_error_monitor.analysis.changes import Change
from rotary_error_monitor.analysis.motion import SegmentFigures, SignalFigures
from rotary_error_monitor.analysis.result import AnalysisResult, Figure, figures_of
from rotary_error_monitor.analysis.verdict import Conformity, Judged
from rotary_error_monitor.gap.quantities import number, rounded, shared_power
from rotary_error_monitor.metrology.circles import CENTRES
from rotary_error_monitor.metrology.spindle_figures import ErrorMotionValue
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import (
    Tone,
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
from rotary_error_monitor.report.wording import amount, spoken, with_unit

_RPM = 30 / math.pi
"""Turns a minute in a rad/s."""

BADGES = {
    Conformity.WITHIN: (Tone.GOOD, "✓ Within limits"),
    Conformity.BEYOND: (Tone.BAD, "✗ Beyond limits"),
    Conformity.OPEN: (Tone.OPEN, "? Cannot be told"),
    Conformity.NO_LIMITS: (Tone.PLAIN, "No limits given"),
}
"""What is said first of a stage."""

OUTCOMES = {
    Conformity.WITHIN: "✓ within",
    Conformity.BEYOND: "✗ beyond",
    Conformity.OPEN: "? cannot be told",
}
"""What is told of one limit."""

_TERMS = {
    "error motion": "displacement or tilt of the axis of rotation from its mean line while it turns (ISO 230-7:2015)",
    "total": "largest minus smallest error motion over all turns",
    "synchronous": "the mean over the turns at each angle, largest minus smallest: what comes again in each turn",
    "asynchronous": "the largest spread of the turns at one angle: what does not come again",
    "fundamental": "twice the amplitude of the once-per-turn component of axial motion or tilt. Of radial motion, and "
    "in a rotating direction, it is eccentricity or setting up, and is taken off",
    "residual synchronous": "synchronous without the fundamental",
    "rotating, x, y": "sensitive direction: turning with the rotor, as of a boring tool, or fixed along x or y",
    "LSC, MZC, MCC, MIC": "centre of the polar picture: " + ", ".join(CENTRES.values()),
    "± U": "expanded uncertainty, k = 2 (about 95 %): of the estimate by its covariance, of other turns by their "
    "spread, and of the correction for what noise adds to a largest value, which is taken off",
    "bandwidth": "what is faster is filtered: half of the amplitude is left at that many waves a turn (Gaussian, ISO "
    "16610-21)",
    "hidden orders": "hatched bars: an error of that order in the form of what the sensors look at, if it has one that "
    "nobody calibrated, passes for error motion: of the ring's graduation, or of the target of displacement probes and "
    "tilt sensors. They stand so that none contradicts",
    "jitter of stamps": "standard deviation of the timestamps from even distances",
    "late": "time from the newest sample of a block to its arrival at the recorder",
}

_CENTRES = ("MZC", "MCC", "MIC")


def verdict_sentence(analysis: AnalysisResult) -> str:
    """What is said first."""
    rows = analysis.judged
    if analysis.outcome is Conformity.NO_LIMITS:
        return f"No limits were given, so there is no verdict. {_largest(analysis)}"
    if analysis.outcome is Conformity.WITHIN:
        return f"The stage is good: it keeps {_all_of(len(rows))}, uncertainty included. {_closest(rows)}"
    worst = [row for row in rows if row.outcome is analysis.outcome]
    told = "; ".join(_against(row) for row in worst)
    if analysis.outcome is Conformity.BEYOND:
        return f"The stage is beyond its limits: {told}."
    return f"Whether the stage keeps its limits cannot be told: {told}."


def verdict_box(analysis: AnalysisResult, items: Sequence[str] = ()) -> str:
    """What is said first, as HTML; the items stand below the sentence."""
    return verdict(*BADGES[analysis.outcome], verdict_sentence(analysis), items)


def _all_of(count: int) -> str:
    return "its limit" if count == 1 else f"all its {count} limits"


def _against(row: Judged) -> str:
    limit = with_unit(row.limit, row.unit)
    name = row.name.replace("_", " ")
    if row.value is None:
        return f"{name} is not told by this recording (limit {limit})"
    return f"{name} {amount(row.value, row.unit)} against {limit} ({spoken(row.where[1])}, {row.where[0]})"


def _closest(rows: tuple[Judged, ...]) -> str:
    told = [row for row in rows if row.value is not None]
    row = max(told, key=lambda row: (row.value.value + row.value.expanded) / row.limit if row.value else 0.0)
    return f"Closest is {_against(row)}."


def _largest(analysis: AnalysisResult) -> str:
    """The largest total values, for who has no limits."""
    found: dict[str, tuple[ErrorMotionValue, str, str, str]] = {}
    for segment in analysis.segments:
        for signal in segment.signals:
            value = signal.values["total"]
            if signal.quantity not in found or value.value > found[signal.quantity][0].value:
                found[signal.quantity] = value, signal.unit, signal.signal, segment.name
    parts = [f"{name} {amount(v, unit)} ({spoken(key)}, {where})" for name, (v, unit, key, where) in found.items()]
    return (
        f"Largest total error motion: {'; '.join(parts)}." if parts else "No whole turn: no error motion value is told."
    )


def page(
    analysis: AnalysisResult,
    pictures: Mapping[str, Sequence[Drawn]],
    title: str,
    facts: Mapping[str, str],
    changes: Sequence[Change] | None = None,
) -> str:
    """The whole page.

    Args:
        analysis: what is shown.
        pictures: by what they show, as `analysis_figure.draw` gives them.
        title: of the page.
        facts: what was analysed, when it was recorded, and by what this was made.
        changes: since another recording; None where there is none.
    """
    shown = {name: images(each) for name, each in pictures.items()}
    values = (_segment(segment, analysis.period) for segment in analysis.segments)
    sections = [
        verdict_box(analysis),
        _limits(analysis),
        section("Notes", bullets(analysis.remarks)) if analysis.remarks else "",
        "" if changes is None else _changes(changes),
        *(section(name, shown.pop(name)) for name in list(shown)[:1]),
        section("Error motion values ± U (k = 2)", *values),
        *(section(name, each) for name, each in shown.items()),
        _others(analysis),
        _streams(analysis),
        terms(_TERMS),
        about(facts),
    ]
    return whole_page("Analysis", title, sections)


def _limits(analysis: AnalysisResult) -> str:
    rows = [
        [
            row.name.replace("_", " "),
            with_unit(row.limit, row.unit),
            "not told" if row.value is None else amount(row.value, row.unit),
            OUTCOMES[row.outcome],
            spoken(row.where[1]) or "–",
            row.where[0] or "–",
        ]
        for row in analysis.judged
    ]
    return section("Limits", table(["figure", "limit", "worst value ± U (k = 2)", "outcome", "of", "at"], rows))


def changes_sentence(changes: Sequence[Change]) -> str:
    """Whether anything is another than in the other recording."""
    told = sum(change.is_told for change in changes)
    if not changes:
        return "The two recordings have no figure in common: other speeds, directions or heights."
    return f"Of {len(changes)} figures that both recordings tell, {told} changed by more than their uncertainty."


def _changes(changes: Sequence[Change]) -> str:
    """Those that are told, the largest beside its uncertainty first."""
    shown = sorted(filter(lambda change: change.is_told, changes), key=lambda change: -change.ratio)
    rows = [
        [
            spoken(change.name),
            change.segment or "–",
            *(with_unit(value, change.unit) for value in (change.before, change.after)),
            with_unit(change.after - change.before, change.unit, change.expanded_uncertainty),
        ]
        for change in shown
    ]
    head = ["figure", "segment", "before", "now", "change ± U (k = 2)"]
    return section("What changed", paragraph(changes_sentence(changes)), table(head, rows))


def _segment(segment: SegmentFigures, period: float) -> str:
    tables = [_quantity_table(list(same)) for _, same in groupby(segment.signals, key=lambda each: each.quantity)]
    speed = f" ({abs(segment.speed) * _RPM:.4g} r/min)" if segment.steady else ""
    said = (
        f"{segment.turned:.3g} turns, {segment.samples:.0f} estimates a turn. Bandwidth {segment.cut_off} waves a "
        f"turn, {segment.bandwidth:.3g} Hz at this speed; an estimate each {period * 1e3:.3g} ms."
    )
    return "".join(
        [
            f"<h3>{segment.name}{speed}</h3>",
            *([paragraph(said), *tables] if tables else []),
            bullets(segment.remarks) if segment.remarks else "",
        ]
    )


def _quantity_table(signals: Sequence[SignalFigures]) -> str:
    """Values of one quantity, all in one unit, which the head tells."""
    names = list(dict.fromkeys(name for signal in signals for name in signal.values))
    centres = [name for name in _CENTRES if any(name in signal.centres for signal in signals)]
    unit, power = shared_power([each.value for signal in signals for each in signal.values.values()], signals[0].unit)
    rows = []
    for signal in signals:
        values = [signal.values.get(name) for name in names]
        told = ["–" if each is None else number(each.value, each.expanded, power) for each in values]
        # as many digits as the value about the least-squares centre has: the turns scatter about any centre alike
        digits = signal.values["synchronous"].expanded
        about = [signal.centres.get(name) for name in centres]
        of_centres = ["–" if each is None else rounded(each.value, digits, power) for each in about]
        rows.append([spoken(signal.signal), *told, *of_centres, str(signal.turns)])
    return table(["signal", *(f"{spoken(name)}, {unit}" for name in (*names, *centres)), "turns"], rows)


def _others(analysis: AnalysisResult) -> str:
    """Figures of the recording as a whole."""
    rows = [[spoken(figure.name), _of_whole(figure)] for figure in figures_of(analysis) if not figure.segment]
    remarks = analysis.positioning.remarks
    return section(
        "The recording as a whole", table(["figure", "value ± U (k = 2)"], rows), bullets(remarks) if remarks else ""
    )


def _of_whole(figure: Figure) -> str:
    """Value with uncertainty and unit; a part of one in percent."""
    if figure.unit == "1":
        return f"{figure.value:.1%}"
    return with_unit(figure.value, figure.unit, figure.expanded_uncertainty or 0.0)


def _streams(analysis: AnalysisResult) -> str:
    rows = [
        [
            stream.topic,
            str(stream.samples),
            f"{stream.rate:.5g}",
            str(stream.lost),
            f"{stream.longest_gap * 1e3:.3g}",
            f"{round(stream.jitter * 1e6, 3):.3g}",
            str(stream.disordered),
            *("not told" if math.isnan(late) else f"{late * 1e3:.3g}" for late in (stream.latency, stream.latency_99)),
        ]
        for stream in analysis.streams
    ]
    head = ["stream", "samples", "rate, Hz", "lost", "longest gap, ms", "jitter of stamps, µs", "disordered"]
    return section(
        "Health of the streams", table([*head, "late, median, ms", "late, 99 %, ms"], rows), _fallen_out(analysis)
    )


def _fallen_out(analysis: AnalysisResult) -> str:
    return (
        bullets(list(_fall_outs(analysis))) if analysis.fallen_out else "<p>Every instrument was used throughout.</p>"
    )


def _fall_outs(analysis: AnalysisResult) -> Iterator[str]:
    for each in analysis.fallen_out:
        yield f"{each.what} was not used for {each.duration:.3g} s, from {each.begin:.3f} s after the first estimate on"
