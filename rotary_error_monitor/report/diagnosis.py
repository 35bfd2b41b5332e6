"""The page of a diagnosis: one self-contained HTML file, and its pictures as one PNG."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence

from rotary_error_monitor.gap.diagnosis import DiagnosisResult, FoundCause
from rotary_error_monitor.gap.problem import DiagnosableProblem
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.gap.sentences import describe_cause, verdict_sentence, what_is_left, what_shrinks
from rotary_error_monitor.gap.verdict import Verdict
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
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.report.picture import picture_of

BADGES = {
    Verdict.NO_GAP: (Tone.GOOD, "✓ No gap"),
    Verdict.EXPLAINED: (Tone.GOOD, "Explained"),
    Verdict.PARTLY_EXPLAINED: (Tone.OPEN, "Partly explained"),
    Verdict.UNKNOWN: (Tone.BAD, "? Unknown"),
}
"""What is said first of a recording."""

_TERMS = {
    "gap": "measured minus predicted, as a root mean square in standard deviations of the noise that the twin states; "
    "1 is noise alone",
    "before, after": "without the causes in the twin, and with them; each condition (speed, direction, pose) is "
    "predicted with causes that were sized on all the others (held out)",
    "noise floor": "what no model can fall below: the noise of neighbouring samples",
    "shrink": "part of what exceeds the noise floor that the causes take away",
    "share": "part of the excess over noise that lies in a channel; all add up to 100 %",
    "depends on": "what the excess goes with, and in brackets how much of it that describes",
    "key figures": "what people in the field ask for: of a stage or a machine, how wrong the causes make the tool's "
    "offset, as a root mean square over the recording",
    "probability": "that a cause is at work, and not another effect that looks like it, or something unknown",
}

_UNITS = {"um": "µm", "urad": "µrad", "arcsec": "″", "nm": "nm", "counts": "counts", "rad": "rad"}
"""Units that end the name of a figure, and how people write them."""

_MOST_RANKED = 12
"""Candidates that a reader looks at; JSON has the others."""

_NOTHING = 1e-6
"""Figures below this, in the units that people read, are rounding."""

_STEPS_OF_UNKNOWN = (
    "Look at what remains below: an order of the rotation points to a part with that many periods a turn, a moment to "
    "an event, a course over time to temperature or creep.",
    "Record again at another speed, in both directions, with another load: what changes with the gap narrows it down.",
    "If you know an effect that could do it, describe it in a few lines of Python and name it with --effects "
    "(doc/effects.md); rotary_error_monitor effects lists those that are known.",
)


def report_files(
    problem: DiagnosableProblem, diagnosis: DiagnosisResult, title: str, painter: Painter, facts: Mapping[str, str]
) -> dict[str, bytes]:
    """Contents of `diagnosis.html` and `diagnosis.png`; `facts` say what was diagnosed, when, and by what."""
    sheet = painter.draw(picture_of(problem, diagnosis))
    return {
        "diagnosis.html": page(diagnosis, sheet.rows, title, facts).encode(),
        "diagnosis.png": sheet.whole,
    }


def page(diagnosis: DiagnosisResult, pictures: Sequence[Sequence[Drawn]], title: str, facts: Mapping[str, str]) -> str:
    """The whole page; the pictures, in rows, are in it, nothing is loaded from elsewhere."""
    sections = [
        verdict_box(diagnosis),
        *(images(row) for row in pictures[:1]),
        _causes(diagnosis),
        _steps(diagnosis),
        _next(diagnosis),
        _gap(diagnosis),
        _where(diagnosis),
        section("Residuals", *(images(row) for row in pictures[1:])),
        _figures(diagnosis),
        _ranking(diagnosis),
        _notes(diagnosis),
        terms(_TERMS),
        about(facts),
    ]
    return whole_page("Diagnosis", title, sections)


def verdict_box(diagnosis: DiagnosisResult) -> str:
    """What is said first, as HTML, with the causes and what is left below the sentence."""
    tone, badge = BADGES[diagnosis.verdict]
    if not diagnosis.causes:
        return verdict(tone, badge, verdict_sentence(diagnosis))
    shrinks = what_shrinks(diagnosis)
    causes = [describe_cause(found) for found in diagnosis.causes]
    left = what_is_left(diagnosis)
    return verdict(tone, badge, f"{shrinks[0].upper()}{shrinks[1:]}, by:", [*causes, *([left] if left else [])])


def _gap(diagnosis: DiagnosisResult) -> str:
    gap = diagnosis.gap
    low, high = gap.interval
    head, row = ["before"], [f"{gap.before:.4g}"]
    if diagnosis.causes:
        if gap.textbook is not None:
            head += ["after, textbook forms alone", "shrink by these"]
            row += [f"{gap.textbook:.4g}", f"{gap.textbook_shrink:.1%}"]
        head += ["after", "shrink (95 % interval)"]
        row += [f"{gap.after:.4g}", f"{gap.shrink:.1%} ({low:.1%} to {high:.1%})"]
    head, row = [*head, "noise floor"], [*row, f"{gap.noise_floor:.4g}"]
    return section("How far, in standard deviations of the noise", table(head, [row]))


def _causes(diagnosis: DiagnosisResult) -> str:
    rows = [row for found in diagnosis.causes for row in _rows_of(found)]
    head = ["effect", "where", "probability", "parameter", "value", "what to do about it", "source"]
    return section("Causes added to the model", table(head, rows), _departures(diagnosis))


def _rows_of(found: FoundCause) -> Iterator[list[str]]:
    """A row for each parameter; what is of the effect stands in the first."""
    effect = found.cause.effect
    units = effect.units(found.cause.location)
    own = [_named(found), found.cause.location or "–", f"{found.probability:.1%}"], [effect.remedy, effect.source]
    for name, estimate in found.parameters.items():
        yield [*own[0], name, quantity(estimate, units.get(name, "1")), *own[1]]
        own = ["", "", ""], ["", ""]


def _named(found: FoundCause) -> str:
    effect = found.cause.effect
    return f"{effect.title} ({effect.name})" if effect.title else effect.name


def _departures(diagnosis: DiagnosisResult) -> str:
    rows = [
        [_named(found), found.cause.location or "–", row.pattern, f"{row.share:.1%}"]
        for found in diagnosis.causes
        for row in found.departures
    ]
    head = ["effect", "where", "departs from its textbook form", "share of the effect, rms"]
    return f"<h3>How they depart</h3>{table(head, rows)}" if rows else ""


def _steps(diagnosis: DiagnosisResult) -> str:
    if diagnosis.verdict is not Verdict.UNKNOWN:
        return ""
    return section("What to do next", bullets(_STEPS_OF_UNKNOWN))


def _where(diagnosis: DiagnosisResult) -> str:
    rows = []
    for share in diagnosis.where:
        unit, factor = share.shown_in
        gap, noise = (f"{factor * size:.3g} {unit}".strip() for size in (share.gap_rms, share.noise_rms))
        rows.append([share.channel, f"{share.share:.1%}", gap, noise, share.pattern])
    head = ["channel", "share", "gap, rms", "noise, rms", "depends on"]
    return section("Where", table(head, rows) or paragraph("Nothing exceeds the noise."))


def _figures(diagnosis: DiagnosisResult) -> str:
    return section("Key figures", table(["figure", "value"], [_figure(*each) for each in diagnosis.figures.items()]))


def _figure(name: str, value: float) -> list[str]:
    """Name and value of a figure, its unit taken from the end of its name."""
    what, _, last = name.rpartition("_")
    told = 0.0 if abs(value) < _NOTHING else value
    if what and last in _UNITS:
        return [what.replace("_", " "), f"{told:.3g} {_UNITS[last]}"]
    return [name.replace("_", " "), f"{told:.3g}"]


def _ranking(diagnosis: DiagnosisResult) -> str:
    shown = diagnosis.ranking[:_MOST_RANKED]
    rows = [[r.effect, r.location or "–", f"{r.probability:.1%}", f"{r.held_out_gap:.4g}"] for r in shown]
    more = len(diagnosis.ranking) - len(shown)
    return section(
        "Which",
        table(["effect", "where", "probability", "gap with it, held out"], rows),
        paragraph(f"{more} more are in diagnosis.json.") if more else "",
    )


def _next(diagnosis: DiagnosisResult) -> str:
    if not diagnosis.indistinguishable:
        return ""
    items = "".join(
        "<li>"
        + html.escape(", ".join(f"{name} {place}".strip() for name, place in group.effects))
        + f"<br>{html.escape(group.advice)}</li>"
        for group in diagnosis.indistinguishable
    )
    return section("What to measure next", paragraph("This recording cannot tell these apart:"), f"<ul>{items}</ul>")


def _notes(diagnosis: DiagnosisResult) -> str:
    left = [f"{finding.channel}: {finding.pattern}" for finding in diagnosis.remainder]
    parts = [("What remains", left), ("Notes", diagnosis.remarks)]
    return "".join(section(title, bullets(items)) for title, items in parts if items)
