"""The page's parts as HTML: each a pure function of what the model knows, so that all browsers share one drawing."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime

from rotary_error_monitor.dashboard import drawing
from rotary_error_monitor.dashboard.health import HealthRow, NodeStatus, Severity, verdict_of
from rotary_error_monitor.dashboard.model import AFTER, BEFORE, RADIAL, CellModel, ShownValue, ValueGroup
from rotary_error_monitor.signals.blocks import NANOSECONDS

PARTS = (
    *("verdict", "polar", "orbit", "figures", "offset", "correction", "gap", "recording", "health"),
    *("trend_radial", "trend_offset"),
)
"""Names of what `CardDrawer` draws."""

_TREND_PERIOD = 5.0
"""s between two drawings of a day at least: a minute is less than a pixel of it."""

_SHOWN_ROWS = 60
"""Rows of health, the worst first: nobody reads on, and who fills `/diagnostics` shall not fill the page."""

_MEGA, _GIGA = 1e6, 1e9
_WORDS = {Severity.OK: "OK", Severity.ATTENTION: "ATTENTION", Severity.FAULT: "FAULT"}
_SIGNS = {
    Severity.OK: '<circle cx="12" cy="12" r="11"/><path class="in" d="M6 12.5l4 4 8-9"/>',
    Severity.ATTENTION: '<path d="M12 1L23.5 22H.5Z"/><path class="in" d="M12 8v7M12 18v1.5"/>',
    Severity.FAULT: '<path d="M7.5 1h9L23 7.5v9L16.5 23h-9L1 16.5v-9Z"/><path class="in" d="M7 7l10 10M17 7L7 17"/>',
}
"""A shape each, so that nothing hangs on colour."""

_AXIS_KINDS = {"µm": ("linear", "um"), "µrad": ("rotary", "urad")}


@dataclass(frozen=True)
class ShownMoment:
    """A moment: `now` as for the model, and the timestamp (ns) that people read off."""

    now: float
    now_ns: int

    @property
    def local(self) -> datetime:
        """In the time zone of this computer."""
        return datetime.fromtimestamp(self.now_ns / NANOSECONDS).astimezone()


class CardDrawer:
    """Draws the parts of the page."""

    def __init__(self, model: CellModel, azimuths: Mapping[str, float], title: str) -> None:
        """Of a model.

        Args:
            model: what is shown.
            azimuths: of the stage's heads, rad.
            title: which stage and machine it is.
        """
        self._model, self._azimuths, self._title = model, dict(azimuths), title
        self._trends: tuple[float, dict[str, str]] = (-math.inf, {})

    def parts(self, clock: ShownMoment) -> dict[str, str]:
        """HTML of each part by its name, of `PARTS`."""
        model, now = self._model, clock.now
        rows, pictures, radius = model.rows(now), model.turns.pictures(), model.turns.radius
        old = model.group("motion", now).is_old
        polar, orbit = drawing.polar_svg(pictures, radius, self._azimuths), drawing.orbit_svg(pictures, radius)
        correction = model.health.find("compensation", "correction", now)
        return {
            "verdict": self._verdict(rows, clock),
            "polar": _figure(polar, drawing.scale_of(pictures, radius), old),
            "orbit": _figure(orbit, drawing.scale_of(pictures, radius, orbit=True), old),
            "figures": values_html(model.group("motion", now)),
            "offset": offset_html(model.group("before", now), model.group("after", now)),
            "correction": correction_html(correction, model.group("applied", now)),
            "gap": gap_html(model.health.find("gap_monitor", "verdict", now)),
            "recording": recording_html(
                model.health.find("recorder", "recording", now), model.health.find("recorder", "state", now)
            ),
            "health": health_html(rows),
            **self._trend(clock),
        }

    def _verdict(self, rows: tuple[HealthRow, ...], clock: ShownMoment) -> str:
        verdict = verdict_of(rows)
        more = f" (and {verdict.more} more below)" if verdict.more else ""
        simulated = "true" in self._model.health.figure("simulated", clock.now)
        badge = "<b class='badge'>SIMULATED</b> " if simulated else ""
        return (
            f"<div class='verdict {_WORDS[verdict.severity].lower()}'>{_sign(verdict.severity)}"
            f"<strong>{_WORDS[verdict.severity]}</strong><span>{html.escape(verdict.reason + more)}</span></div>"
            f"<p class='title'>{badge}{html.escape(self._title)} <time>{clock.local:%Y-%m-%d %H:%M:%S}</time></p>"
        )

    def _trend(self, clock: ShownMoment) -> dict[str, str]:
        drawn, parts = self._trends
        if clock.now - drawn >= _TREND_PERIOD:
            series = {name: self._model.trend.series(name, clock.now_ns) for name in (RADIAL, BEFORE, AFTER)}
            end = f"{clock.local:%H:%M}"
            radial = [(RADIAL, series[RADIAL], drawing.ORANGE, "")]
            offset = [(BEFORE, series[BEFORE], drawing.BLUE, "5 3"), (AFTER, series[AFTER], drawing.GREEN, "")]
            parts = {
                "trend_radial": f"<p>{RADIAL} at the ring, µm</p>{drawing.trend_svg(radial, end)}",
                "trend_offset": f"<p>{_key(drawing.BLUE, '5 3')}{BEFORE}, µm &ensp; {_key(drawing.GREEN, '')}{AFTER}, "
                f"µm</p>{drawing.trend_svg(offset, end)}",
            }
            self._trends = clock.now, parts
        return parts


def values_html(group: ValueGroup) -> str:
    """The components of error motion, each with its standard uncertainty."""
    if group.age is None:
        return "<p class='none'>no error motion yet</p>"
    return f"<table class='values{_old(group)}'>{''.join(map(_value_row, group.values))}</table>{_age(group)}"


def offset_html(before: ValueGroup, after: ValueGroup) -> str:
    """Tool offset without correction and what remains of it, side by side."""
    if before.age is None and after.age is None:
        return "<p class='none'>no tool offset yet: no compensation is heard</p>"
    head = "<tr><th></th><th>before</th><th>after</th><th></th></tr>"
    sizes = [
        math.hypot(*(v.value for v in group.values[:3])) if group.values else math.nan for group in (before, after)
    ]
    names = before.values or after.values
    columns = [[v.value for v in group.values] or [math.nan] * len(names) for group in (before, after)]
    rows = [
        ("shift", *sizes, "µm"),
        *((v.name, b, a, v.unit) for v, b, a in zip(names, *columns, strict=True)),
    ]
    cells = "".join(
        f"<tr><th>{name}</th><td>{_number(b)}</td><td>{_number(a)}</td><td class='unit'>{unit}</td></tr>"
        for name, b, a, unit in rows
    )
    old = before if before.is_old else after
    return f"<table class='values two{_old(old)}'>{head}{cells}</table>{_age(old)}"


def correction_html(status: NodeStatus | None, applied: ValueGroup) -> str:
    """Corrections in effect against their limits, and the latch."""
    parts = []
    if status is None:
        parts.append("<p class='none'>no compensation is heard</p>")
    else:
        latched = status.figures.get("latched") == "True"
        word = "LATCHED: corrections hold until a reset" if latched else "latch open"
        parts.append(f"<p class='latch {'latched' if latched else ''}'>{_sign(status.severity)} {word}</p>")
        parts.append(f"<p>{html.escape(status.message)}</p>")
    if applied.age is None:
        parts.append("<p class='none'>the controller says of no correction in effect</p>")
    else:
        figures = {} if status is None else status.figures
        rows = "".join(_axis_row(value, figures) for value in applied.values)
        parts.append(f"<table class='values{_old(applied)}'>{rows}</table>{_age(applied)}")
        parts.append("<p class='small'>in effect; bar: part of the error limit, mark: warning limit</p>")
    return "".join(parts)


def gap_html(status: NodeStatus | None) -> str:
    """The last verdict of the gap monitor."""
    if status is None:
        return "<p class='none'>no gap monitor is heard</p>"
    if not status.figures:
        return "<p class='none'>no verdict yet</p>"
    age = _float(status.figures.get("age_s"))
    causes = status.figures.get("causes", "none")
    lines = [f"<p>{_sign(status.severity)} {html.escape(status.message)}</p>"]
    if causes != "none":
        lines.append(f"<p>causes: {html.escape(causes)}</p>")
    if math.isfinite(age):
        turns = _float(status.figures.get("turns"))
        lines.append(f"<p class='small'>of {turns:.0f} turns that ended {_duration(age)} ago</p>")
    return "".join(lines)


def recording_html(status: NodeStatus | None, state: NodeStatus | None) -> str:
    """Whether there is a recording, where, how large, and what the disk has left."""
    if status is None:
        return "<p class='none'>no recorder is heard: nothing is recorded</p>"
    paused = state is not None and state.message == "inactive"
    bad = max(status.severity, Severity.ATTENTION if paused else Severity.OK)
    word = "paused: nothing is recorded" if paused else html.escape(status.message)
    figures = status.figures
    rows = [("bag", html.escape(figures.get("bag", "unknown")))]
    rows += [("size", _bytes(figures["size_mb"]))] if "size_mb" in figures else []
    rows += [("free on its disk", _bytes(figures["free_mb"]))] if "free_mb" in figures else []
    rows += [("messages", f"{_float(figures['messages']):,.0f}")] if "messages" in figures else []
    cells = "".join(f"<tr><th>{name}</th><td class='text'>{value}</td></tr>" for name, value in rows)
    return f"<p class='large'>{_sign(bad)} {word}</p><table class='values'>{cells}</table>"


def health_html(rows: Iterable[HealthRow]) -> str:
    """Nodes and streams, worst first; what is old is greyed."""
    rows = tuple(rows)
    if not rows:
        return "<p class='none'>nothing is heard on /diagnostics</p>"
    shown = rows[:_SHOWN_ROWS]
    bad = "".join(_health_row(row) for row in shown if row.severity)
    well = "".join(_health_row(row) for row in shown if not row.severity)
    left = len(rows) - _SHOWN_ROWS
    more = f"<p>and {left} more</p>" if left > 0 else ""
    return f"<ul class='health'>{bad}</ul><ul class='health well'>{well}</ul>{more}"


def _health_row(row: HealthRow) -> str:
    return (
        f"<li class='{'stale' if row.stale else ''}'>{_sign(row.severity)}<i>{_WORDS[row.severity]}</i>"
        f"<b>{html.escape(row.what)}</b><span>{html.escape(row.message)}</span></li>"
    )


def _figure(svg: str, scale: str, old: bool) -> str:
    return f"<div class='drawing{' old' if old else ''}'>{svg}<p class='small'>{html.escape(scale)}</p></div>"


def _value_row(value: ShownValue) -> str:
    spread = f"± {_number(value.deviation)}" if math.isfinite(value.deviation) else ""
    return (
        f"<tr><th>{html.escape(value.name)}</th><td class='large'>{_number(value.value)}</td>"
        f"<td class='spread'>{spread}</td><td class='unit'>{value.unit}</td></tr>"
    )


def _axis_row(value: ShownValue, figures: Mapping[str, str]) -> str:
    kind, unit = _AXIS_KINDS[value.unit]
    warning, error = (_float(figures.get(f"{kind}_{name}_{unit}")) for name in ("warning", "error"))
    bar = "".join(_bar(abs(value.value), warning, error)) if error > 0.0 else ""
    limits = f"of {warning:g} / {error:g}" if error > 0.0 else ""
    return (
        f"<tr><th>{html.escape(value.name)}</th><td>{_number(value.value)}</td><td class='unit'>{value.unit}</td>"
        f"<td class='bar'>{bar}</td><td class='spread'>{limits}</td></tr>"
    )


def _bar(size: float, warning: float, error: float) -> Iterator[str]:
    """How far a correction is from its warning (mark) and error limit (end)."""
    part = 100 * min(size / error, 1.0)
    colour = drawing.GREEN if size < warning else drawing.ORANGE
    yield '<svg viewBox="0 0 100 10" preserveAspectRatio="none"><rect width="100" height="10" fill="#ddd"/>'
    yield f'<rect width="{part:.1f}" height="10" fill="{colour}"/>'
    yield f'<path d="M{100 * warning / error:.1f} 0V10" stroke="#000" stroke-width="1.5"/></svg>'


def _sign(severity: Severity) -> str:
    return (
        f'<svg class="sign {_WORDS[severity].lower()}" viewBox="0 0 24 24" aria-hidden="true">{_SIGNS[severity]}</svg>'
    )


def _key(colour: str, dash: str) -> str:
    line = f'<path d="M0 6H28" stroke="{colour}" stroke-width="3" stroke-dasharray="{dash}"/>'
    return f'<svg class="key" viewBox="0 0 28 12">{line}</svg> '


def _old(group: ValueGroup) -> str:
    return " old" if group.is_old else ""


def _age(group: ValueGroup) -> str:
    return f"<p class='small'>{group.age:.0f} s old</p>" if group.is_old and group.age is not None else ""


def _number(value: float) -> str:
    """A number with a true minus; three digits after the point below ten, fewer above."""
    if not math.isfinite(value):
        return "–"
    digits = 3 if abs(value) < 9.9995 else 2 if abs(value) < 99.995 else 1
    text = f"{value:,.{digits}f}"
    return text.replace("-", "−" if text.strip("-0.") else "")


def _float(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _bytes(megabytes: str) -> str:
    size = _float(megabytes) * _MEGA
    return f"{size / _GIGA:,.2f} GB" if size >= _GIGA else f"{size / _MEGA:,.1f} MB"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
