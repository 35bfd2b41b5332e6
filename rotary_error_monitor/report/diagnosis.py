"""The page of a diagnosis: one self-contained HTML file, and its figure as PNG."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from pathlib import Path

from rotary_error_monitor.gap.diagnosis import Diagnosis, FoundCause
from rotary_error_monitor.gap.problem import DiagnosableProblem
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.gap.sentences import verdict_sentence
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.report.page import bullets, image, table, terms, verdict, whole_page
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.report.picture import picture_of

_STYLE = """.no_gap { border-color: #2a7f3f; } .explained { border-color: #1f5fa8; }
.partly_explained { border-color: #b8860b; } .unknown { border-color: #a3312a; }"""

_TERMS = {
    "gap": "measured minus predicted, as a root mean square in standard deviations of the noise that the twin states; "
    "1 is noise alone",
    "before, after": "without the causes in the twin, and with them; each condition (speed, direction, pose) is "
    "predicted with causes that were sized on all the others (held out)",
    "noise floor": "what no model can fall below: the noise of neighbouring samples",
    "shrink": "part of what exceeds the noise floor that the causes take away",
    "share": "part of the excess over noise that lies in a channel; all add up to 100 %",
    "probability": "that a cause is at work, and not another effect that looks like it, or something unknown",
}

_UNITS = {"um": "µm", "urad": "µrad", "arcsec": "″", "nm": "nm", "counts": "counts", "rad": "rad"}
"""Units that end the name of a figure, and how people write them."""

_NOTHING = 1e-6
"""Figures below this, in the units that people read, are rounding."""

_STEPS_OF_UNKNOWN = (
    "Look at what remains below: an order of the rotation points to a part with that many periods a turn, a moment to "
    "an event, a course over time to temperature or creep.",
    "Record again at another speed, in both directions, with another load: what changes with the gap narrows it down.",
    "If you know an effect that could do it, describe it in a few lines of Python and name it with --effects "
    "(doc/effects.md); rotary_error_monitor effects lists those that are known.",
)


def write_report(
    problem: DiagnosableProblem,
    diagnosis: Diagnosis,
    folder: Path,
    title: str,
    painter: Painter,
    about: Mapping[str, str] | None = None,
) -> None:
    """Write `diagnosis.html` and `diagnosis.png` into a folder that exists; `about` says what was diagnosed, when."""
    picture = painter.draw(picture_of(problem, diagnosis))
    (folder / "diagnosis.png").write_bytes(picture)
    (folder / "diagnosis.html").write_text(page(diagnosis, picture, title, about or {}), encoding="utf-8")


def page(diagnosis: Diagnosis, picture: bytes, title: str, about: Mapping[str, str]) -> str:
    """The whole page; the picture is in it, nothing is loaded from elsewhere."""
    sections = [
        verdict(diagnosis.verdict.value, verdict_sentence(diagnosis)),
        _about(about),
        image(picture, "gap, where it lies, ranking, residuals"),
        _gap(diagnosis),
        _causes(diagnosis),
        _steps(diagnosis),
        _where(diagnosis),
        _figures(diagnosis),
        _ranking(diagnosis),
        _next(diagnosis),
        _notes(diagnosis),
        terms(_TERMS),
    ]
    return whole_page("Diagnosis", title, _STYLE, sections)


def _about(about: Mapping[str, str]) -> str:
    return table((), list(about.items())) if about else ""


def _gap(diagnosis: Diagnosis) -> str:
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
    return "<h2>How far, in standard deviations of the noise</h2>" + table(head, [row])


def _causes(diagnosis: Diagnosis) -> str:
    rows = [row for found in diagnosis.causes for row in _rows_of(found)]
    head = ["effect", "where", "probability", "parameter", "value", "what to do about it", "source"]
    return "<h2>Causes added to the model</h2>" + table(head, rows) + _departures(diagnosis) if rows else ""


def _rows_of(found: FoundCause) -> Iterator[list[str]]:
    """A row for each parameter; what is of the effect stands in the first."""
    effect = found.cause.effect
    units = effect.units(found.cause.location)
    own = [_named(found), found.cause.location, f"{found.probability:.1%}"], [effect.remedy, effect.source]
    for name, estimate in found.parameters.items():
        yield [*own[0], name, quantity(estimate, units.get(name, "1")), *own[1]]
        own = ["", "", ""], ["", ""]


def _named(found: FoundCause) -> str:
    effect = found.cause.effect
    return f"{effect.title} ({effect.name})" if effect.title else effect.name


def _departures(diagnosis: Diagnosis) -> str:
    rows = [
        [_named(found), found.cause.location, row.pattern, f"{row.share:.1%}"]
        for found in diagnosis.causes
        for row in found.departures
    ]
    head = ["effect", "where", "departs from its textbook form", "share of the effect, rms"]
    return "<h2>How they depart</h2>" + table(head, rows) if rows else ""


def _steps(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict is not Verdict.UNKNOWN:
        return ""
    return "<h2>What to do next</h2>" + bullets(_STEPS_OF_UNKNOWN)


def _where(diagnosis: Diagnosis) -> str:
    rows = []
    for share in diagnosis.where:
        unit, factor = share.shown_in
        gap, noise = (f"{factor * size:.4g} {unit}".strip() for size in (share.gap_rms, share.noise_rms))
        rows.append([share.channel, f"{share.share:.1%}", gap, noise, share.pattern])
    head = ["channel", "share", "gap, rms", "noise, rms", "depends on"]
    return "<h2>Where</h2>" + (table(head, rows) if rows else "<p>Nothing exceeds the noise.</p>")


def _figures(diagnosis: Diagnosis) -> str:
    rows = [_figure(name, value) for name, value in diagnosis.figures.items()]
    return "<h2>Figures</h2>" + table(["figure", "value"], rows) if rows else ""


def _figure(name: str, value: float) -> list[str]:
    """Name and value of a figure, its unit taken from the end of its name."""
    what, _, last = name.rpartition("_")
    told = 0.0 if abs(value) < _NOTHING else value
    if what and last in _UNITS:
        return [what.replace("_", " "), f"{told:.4g} {_UNITS[last]}"]
    return [name.replace("_", " "), f"{told:.4g}"]


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [[r.effect, r.location, f"{r.probability:.1%}", f"{r.held_out_gap:.4g}"] for r in diagnosis.ranking]
    return "<h2>Which</h2>" + table(["effect", "where", "probability", "gap with it, held out"], rows)


def _next(diagnosis: Diagnosis) -> str:
    if not diagnosis.indistinguishable:
        return ""
    items = "".join(
        "<li>"
        + html.escape(", ".join(f"{name} {place}".strip() for name, place in group.effects))
        + f"<br>{html.escape(group.advice)}</li>"
        for group in diagnosis.indistinguishable
    )
    return f"<h2>What to measure next</h2><p>This recording cannot tell these apart:</p><ul>{items}</ul>"


def _notes(diagnosis: Diagnosis) -> str:
    left = [f"{finding.channel}: {finding.pattern}" for finding in diagnosis.remainder]
    parts = [("What remains", left), ("Notes", diagnosis.remarks)]
    return "".join(f"<h2>{title}</h2>{bullets(items)}" for title, items in parts if items)
