"""The page of an analysis: verdict, polar pictures, orders, course over time, health of the streams, words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rotary_error_monitor.analysis.changes import Change
from rotary_error_monitor.analysis.motion import SegmentFigures
from rotary_error_monitor.analysis.result import Analysis, figures_of
from rotary_error_monitor.analysis.verdict import Judged, Outcome
from rotary_error_monitor.effects.effect import Estimate
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.metrology.circles import CENTRES
from rotary_error_monitor.metrology.spindle_figures import Value
from rotary_error_monitor.report.page import bullets, image, table, terms, verdict, whole_page

_STYLE = """.within { border-color: #0072b2; } .beyond { border-color: #d55e00; }
.open { border-color: #e69f00; } .no_limits { border-color: #666; }
td { font-variant-numeric: tabular-nums; }"""

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
    "hidden orders": "a graduation error of that order, if the ring has one that nobody calibrated, passes for radial "
    "error motion: the heads stand so that none contradicts",
}

_NAMES = {"residual_synchronous": "residual synchronous"}


def verdict_sentence(analysis: Analysis) -> str:
    """What is said first."""
    rows = analysis.judged
    if analysis.outcome is Outcome.NO_LIMITS:
        return f"No limits were given, so there is no verdict. {_largest(analysis)}"
    if analysis.outcome is Outcome.WITHIN:
        return f"The stage is good: it keeps {_all_of(len(rows))}, uncertainty included. {_closest(rows)}"
    worst = [row for row in rows if row.outcome is analysis.outcome]
    told = "; ".join(_against(row) for row in worst)
    if analysis.outcome is Outcome.BEYOND:
        return f"The stage is beyond its limits: {told}."
    return f"Whether the stage keeps its limits cannot be told: {told}."


def _all_of(count: int) -> str:
    return "its limit" if count == 1 else f"all its {count} limits"


def _against(row: Judged) -> str:
    limit = quantity(Estimate(row.limit, 0.0), row.unit)
    name = row.name.replace("_", " ")
    if row.value is None:
        return f"{name} is not told by this recording (limit {limit})"
    return f"{name} {amount(row.value, row.unit)} against {limit} ({row.where[1]}, {row.where[0]})"


def _closest(rows: tuple[Judged, ...]) -> str:
    told = [row for row in rows if row.value is not None]
    row = max(told, key=lambda row: (row.value.value + row.value.expanded) / row.limit if row.value else 0.0)
    return f"Closest is {_against(row)}."


def _largest(analysis: Analysis) -> str:
    """The largest total values, for who has no limits."""
    found: dict[str, tuple[Value, str, str, str]] = {}
    for segment in analysis.segments:
        for signal in segment.signals:
            value = signal.values["total"]
            if signal.quantity not in found or value.value > found[signal.quantity][0].value:
                found[signal.quantity] = value, signal.unit, signal.signal, segment.name
    parts = [f"{name} {amount(v, unit)} ({key}, {where})" for name, (v, unit, key, where) in found.items()]
    return (
        f"Largest total error motion: {'; '.join(parts)}." if parts else "No whole turn: no error motion value is told."
    )


def amount(value: Value, unit: str) -> str:
    """Value and expanded uncertainty, such as `1.72 ± 0.05 µm`."""
    return quantity(Estimate(value.value, value.expanded), unit)


def page(
    analysis: Analysis,
    pictures: Mapping[str, bytes],
    title: str,
    about: Mapping[str, str],
    changes: Sequence[Change] | None = None,
) -> str:
    """The whole page; `pictures` are PNGs by what they show, in their order; `changes` since another recording."""
    sections = [
        verdict(analysis.outcome.value, verdict_sentence(analysis)),
        table((), list(about.items())),
        _limits(analysis),
        "" if changes is None else _changes(changes),
        *(image(picture, alt) for alt, picture in pictures.items()),
        *(_segment(segment, analysis.period) for segment in analysis.segments),
        _others(analysis),
        _streams(analysis),
        "<h2>Notes</h2>" + bullets(analysis.remarks) if analysis.remarks else "",
        terms(_TERMS),
    ]
    return whole_page("Analysis", title, _STYLE, sections)


def _limits(analysis: Analysis) -> str:
    if not analysis.judged:
        return ""
    rows = [
        [
            row.name.replace("_", " "),
            quantity(Estimate(row.limit, 0.0), row.unit),
            "not told" if row.value is None else amount(row.value, row.unit),
            {Outcome.WITHIN: "within", Outcome.BEYOND: "beyond"}.get(row.outcome, "cannot be told"),
            f"{row.where[1]}, {row.where[0]}".strip(", "),
        ]
        for row in analysis.judged
    ]
    return "<h2>Limits</h2>" + table(["figure", "limit", "value ± U (k = 2)", "outcome", "where"], rows)


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
            change.name.replace("_", " ").replace(".", ": "),
            change.segment,
            *(quantity(Estimate(value, 0.0), change.unit) for value in (change.before, change.after)),
            quantity(Estimate(change.after - change.before, change.expanded_uncertainty), change.unit),
        ]
        for change in shown
    ]
    head = ["figure", "segment", "before", "now", "change ± U (k = 2)"]
    said = f"<p>{changes_sentence(changes)}</p>"
    return "<h2>What changed</h2>" + said + (table(head, rows) if rows else "")


def _segment(segment: SegmentFigures, period: float) -> str:
    names = list(dict.fromkeys(name for signal in segment.signals for name in signal.values))
    head = ["", *(_NAMES.get(name, name) for name in names), "MZC", "MCC", "MIC", "turns"]
    rows = []
    for signal in segment.signals:
        values = [amount(signal.values[n], signal.unit) if n in signal.values else "–" for n in names]
        centres = [signal.centres.get(name) for name in ("MZC", "MCC", "MIC")]
        about = ["–" if c is None else quantity(Estimate(c.value, 0.0), signal.unit) for c in centres]
        rows.append([signal.signal.replace("_", " "), *values, *about, str(signal.turns)])
    said = (
        f"{segment.turned:.3g} turns, {segment.samples:.0f} estimates a turn. Bandwidth {segment.cut_off} waves a "
        f"turn, {segment.bandwidth:.3g} Hz at this speed; an estimate each {period * 1e3:.3g} ms. Values ± U (k = 2)."
    )
    text = f"<p>{said}</p>" + table(head, rows) if rows else ""
    return f"<h2>{segment.name}</h2>" + text + (bullets(segment.remarks) if segment.remarks else "")


def _others(analysis: Analysis) -> str:
    """Figures of the recording as a whole."""
    rows = [
        [figure.name.replace("_", " ").replace(".", ": "), quantity(Estimate(figure.value, uncertainty), figure.unit)]
        for figure in figures_of(analysis)
        if not figure.segment
        for uncertainty in [figure.expanded_uncertainty or 0.0]
    ]
    remarks = analysis.positioning.remarks
    shown = table(["figure", "value ± U (k = 2)"], rows) if rows else ""
    return (
        "<h2>The recording as a whole</h2>" + shown + (bullets(remarks) if remarks else "") if rows or remarks else ""
    )


def _streams(analysis: Analysis) -> str:
    rows = [
        [
            stream.topic,
            str(stream.samples),
            f"{stream.rate:.5g} Hz",
            f"{stream.lost}",
            f"{stream.longest_gap * 1e3:.3g} ms",
            f"{round(stream.jitter * 1e6, 3):.3g} µs",
            str(stream.disordered),
            f"{stream.latency * 1e3:.3g} ms, {stream.latency_99 * 1e3:.3g} ms",
        ]
        for stream in analysis.streams
    ]
    head = ["stream", "samples", "rate", "lost", "longest gap", "jitter of stamps", "disordered", "late (median, 99 %)"]
    return "<h2>Health of the streams</h2>" + table(head, rows) + _fallen_out(analysis)


def _fallen_out(analysis: Analysis) -> str:
    return (
        bullets(list(_fall_outs(analysis))) if analysis.fallen_out else "<p>Every instrument was used throughout.</p>"
    )


def _fall_outs(analysis: Analysis) -> Iterator[str]:
    for each in analysis.fallen_out:
        yield f"{each.what} was not used for {each.duration:.3g} s, from {each.begin:.3f} s after the first estimate on"
