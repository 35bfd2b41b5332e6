"""The page of a diagnosis: one self-contained HTML file, and its figure as PNG."""

from __future__ import annotations

import base64
import html
from pathlib import Path

from rotary_error_monitor.effects.effect import Estimate
from rotary_error_monitor.gap.diagnosis import Diagnosis
from rotary_error_monitor.gap.problem import DiagnosableProblem
from rotary_error_monitor.gap.sentences import describe_estimate, verdict_sentence
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.report.picture import picture_of

_STYLE = """
body { font: 16px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.25rem; } h2 { font-size: 1.05rem; margin-top: 2rem; }
.verdict { font-size: 1.15rem; padding: .8rem 1rem; border-left: .4rem solid #444; background: #f4f4f4; }
.no_gap { border-color: #2a7f3f; } .explained { border-color: #1f5fa8; }
.partly_explained { border-color: #b8860b; } .unknown { border-color: #a3312a; }
table { border-collapse: collapse; } td, th { padding: .25rem .7rem; text-align: left; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; } img { max-width: 100%; }
"""


def write_report(problem: DiagnosableProblem, diagnosis: Diagnosis, folder: Path, title: str, painter: Painter) -> None:
    """Write `diagnosis.html` and `diagnosis.png` into a folder that exists."""
    picture = painter.draw(picture_of(problem, diagnosis))
    (folder / "diagnosis.png").write_bytes(picture)
    (folder / "diagnosis.html").write_text(page(diagnosis, picture, title), encoding="utf-8")


def page(diagnosis: Diagnosis, picture: bytes, title: str) -> str:
    """The whole page; the picture is in it, nothing is loaded from elsewhere."""
    image = base64.b64encode(picture).decode("ascii")
    sections = [
        f"<p class='verdict {diagnosis.verdict.value}'>{html.escape(verdict_sentence(diagnosis))}</p>",
        f"<img alt='gap, where it lies, ranking, residuals' src='data:image/png;base64,{image}'>",
        _gap(diagnosis),
        _causes(diagnosis),
        _where(diagnosis),
        _figures(diagnosis),
        _ranking(diagnosis),
        _next(diagnosis),
        _notes(diagnosis),
    ]
    return (
        "<!doctype html><html lang='en'><meta charset='utf-8'>"
        f"<title>Diagnosis: {html.escape(title)}</title><style>{_STYLE}</style>"
        f"<h1>{html.escape(title)}</h1>{''.join(sections)}</html>\n"
    )


def _table(head: list[str], rows: list[list[str]]) -> str:
    def cells(row: list[str], tag: str) -> str:
        return "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row)

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    return f"<table><tr>{cells(head, 'th')}</tr>{body}</table>"


def _gap(diagnosis: Diagnosis) -> str:
    gap = diagnosis.gap
    low, high = gap.interval
    rows = [
        [
            f"{gap.before:.4g}",
            f"{gap.after:.4g}",
            f"{gap.noise_floor:.4g}",
            f"{gap.shrink:.3f} ({low:.3f} to {high:.3f})",
        ]
    ]
    return "<h2>How far</h2>" + _table(["before", "after", "noise floor", "shrink (95 % interval)"], rows)


def _causes(diagnosis: Diagnosis) -> str:
    rows = []
    for found in diagnosis.causes:
        units = {parameter.name: parameter.unit for parameter in found.cause.effect.parameters}
        for name, estimate in found.parameters.items():
            rows.append(
                [
                    found.cause.effect.title or found.cause.effect.name,
                    found.cause.location,
                    f"{found.probability:.1%}",
                    name,
                    _number(estimate),
                    units.get(name, ""),
                    found.cause.effect.source,
                ]
            )
    head = ["effect", "where", "probability", "parameter", "value", "unit", "source"]
    return "<h2>Causes added to the model</h2>" + _table(head, rows) + _departures(diagnosis) if rows else ""


def _departures(diagnosis: Diagnosis) -> str:
    rows = [
        [found.cause.effect.title or found.cause.effect.name, found.cause.location, row.pattern, f"{row.share:.1%}"]
        for found in diagnosis.causes
        for row in found.departures
    ]
    head = ["effect", "where", "departs from its textbook form", "share of the effect, rms"]
    return "<h2>How they depart</h2>" + _table(head, rows) if rows else ""


def _number(estimate: Estimate) -> str:
    return describe_estimate(estimate)


def _where(diagnosis: Diagnosis) -> str:
    rows = [[s.channel, f"{s.share:.1%}", f"{s.gap_rms:.3g}", f"{s.noise_rms:.3g}", s.pattern] for s in diagnosis.where]
    head = ["channel", "share", "gap, rms (SI)", "noise, rms (SI)", "depends on"]
    return "<h2>Where</h2>" + (_table(head, rows) if rows else "<p>Nothing exceeds the noise.</p>")


def _figures(diagnosis: Diagnosis) -> str:
    rows = [[name.replace("_", " "), f"{value:.4g}"] for name, value in diagnosis.figures.items()]
    return "<h2>Figures</h2>" + _table(["figure", "value"], rows) if rows else ""


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [[r.effect, r.location, f"{r.probability:.1%}", f"{r.held_out_gap:.4g}"] for r in diagnosis.ranking]
    return "<h2>Which</h2>" + _table(["effect", "where", "probability", "held-out gap"], rows)


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
    parts = []
    if left:
        parts.append("<h2>What remains</h2><ul>" + "".join(f"<li>{html.escape(item)}</li>" for item in left) + "</ul>")
    if diagnosis.remarks:
        parts.append("<h2>Notes</h2><ul>" + "".join(f"<li>{html.escape(i)}</li>" for i in diagnosis.remarks) + "</ul>")
    return "".join(parts)
