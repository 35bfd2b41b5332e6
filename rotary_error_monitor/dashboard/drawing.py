"""Lines of the page as SVG: polar plot and orbit of the last turns, and the trend of the day."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.dashboard.trend import MINUTES
from rotary_error_monitor.pipeline.last_turn import LARGEST_PART, TurnPicture, rounded_down

# of Okabe and Ito (2008), told apart by people who see few colours
BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
_GREY, _PALE = "#777", "#ccc"

_HALF = 150.0
"""Half of the side of a picture, in its own units."""

_RING = 100.0
"""Radius of the ring in a polar plot."""

_OLDER_POINTS = 120
"""Of a turn before the last: its line is thin, and a corner each 3° is less than its width from the curve."""

_WIDE, _TALL, _LEFT = 720.0, 130.0, 62.0
"""Size of a trend, and where its axis of time begins."""


def polar_svg(pictures: Sequence[TurnPicture], radius: float, azimuths: Mapping[str, float]) -> str:
    """Polar plot of the radial error motion of the last turns, the one under way on top, with its scale.

    Args:
        pictures: of one magnification, the latest last.
        radius: of the ring, m.
        azimuths: of the heads, rad.
    """
    magnification = pictures[-1].magnification if pictures else 0.0
    unit = _RING / radius
    division = _division(magnification, radius)
    parts = [_circle(_RING, _GREY, "")]
    if division:
        size = division * magnification * unit
        parts += [_circle(_RING + sign * size, _PALE, "4 4") for sign in (1, -1)]
        parts += [_text(0, -_RING - sign * size - 3, f"{sign * division * 1e6:+g} µm", 10) for sign in (1, -1)]
    for letter, azimuth in azimuths.items():
        x, y = 0.5 * _RING * math.cos(azimuth), 0.5 * _RING * math.sin(azimuth)
        parts.append(_text(x, -y + 4, letter, 12))
    parts.append(_cross(6))
    parts += [_trace(picture.polar[:, :2] * unit, latest) for picture, latest in _turns(pictures)]
    return _svg(parts, "polar plot of the radial error motion")


def orbit_svg(pictures: Sequence[TurnPicture], radius: float) -> str:
    """Orbit of the axis of rotation in the last turns, on a grid in µm."""
    magnification = pictures[-1].magnification if pictures else 0.0
    unit = _RING / (LARGEST_PART * radius)
    division = _division(magnification, radius)
    parts = []
    if division:
        step = division * magnification * unit
        for count in range(-int(_HALF / step), int(_HALF / step) + 1):
            at = count * step
            parts.append(f'<path d="M{at:.1f},{-_HALF}V{_HALF}M{-_HALF},{at:.1f}H{_HALF}" stroke="{_PALE}"/>')
            if count:
                parts.append(_text(at, 12, f"{count * division * 1e6:g}", 10))
                parts.append(_text(4, at + 4, f"{-count * division * 1e6:g}", 10, "start"))
        parts += [_text(_HALF - 4, -6, "x, µm", 11, "end"), _text(6, -_HALF + 12, "y, µm", 11, "start")]
    parts.append(_cross(_HALF))
    parts += [_trace(picture.orbit[:, :2] * unit, latest) for picture, latest in _turns(pictures)]
    return _svg(parts, "orbit of the axis of rotation")


def scale_of(pictures: Sequence[TurnPicture], radius: float, *, orbit: bool = False) -> str:
    """Magnification and scale in words; what is not observable says so."""
    magnification = pictures[-1].magnification if pictures else 0.0
    if not magnification:
        return "radial error motion is not observable"
    times = magnification / LARGEST_PART if orbit else magnification
    division = f"one division {_division(magnification, radius) * 1e6:g} µm"
    drawn = "" if orbit else f", ring of radius {radius * 1e3:g} mm"
    return f"× {times:,.0f}{drawn}; {division}; thick: the turn under way, thin: those before"


def trend_svg(series: Sequence[tuple[str, NDArray[np.float64], str, str]], end: str) -> str:
    """The course of a day.

    Args:
        series: name, (1440,) values in µm with the oldest first, colour and dash pattern of each line.
        end: the time of the day at its right end, HH:MM.
    """
    finite = [values[np.isfinite(values)] for _, values, _, _ in series]
    largest = max((float(values.max()) for values in finite if len(values)), default=0.0)
    step = rounded_down(largest) / 2 if largest > 0.0 else 0.5
    top = step * max(1, math.ceil(largest / step))
    while top / step > 3:
        step *= 2
    parts = list(_trend_axes(top, step, end))
    for _, values, colour, dash in series:
        x = _LEFT + (_WIDE - _LEFT) * (np.arange(MINUTES) + 0.5) / MINUTES
        y = _TALL - (_TALL - 10) * values / top
        for piece in _pieces(np.column_stack([x, y])):
            parts.append(_line(piece, colour, 1.6, dash) + _dot(piece[-1], colour))
    names = html.escape(", ".join(name for name, *_ in series), quote=True)
    return f'<svg viewBox="0 0 {_WIDE + 14:g} {_TALL + 22:g}" role="img" aria-label="{names}">{"".join(parts)}</svg>'


def _trend_axes(top: float, step: float, end: str) -> Iterator[str]:
    for count in range(int(top / step + 1e-9) + 1):
        y = _TALL - (_TALL - 10) * count * step / top
        yield f'<path d="M{_LEFT},{y:.1f}H{_WIDE}" stroke="{_PALE}"/>'
        yield _text(_LEFT - 5, y + 4, f"{count * step:g}", 12, "end")
    yield _text(2, 18, "µm", 12, "start")
    hour, minute = int(end[:2]), int(end[3:])
    for back in range(24):
        at = MINUTES - minute - 60 * back
        if (hour - back) % 6 == 0:
            x = _LEFT + (_WIDE - _LEFT) * at / MINUTES
            yield f'<path d="M{x:.1f},10V{_TALL}" stroke="{_PALE}"/>'
            yield _text(x, _TALL + 16, f"{(hour - back) % 24:02d}:00", 12)


def _division(magnification: float, radius: float) -> float:
    """Size, m, of a division: the largest round one that the largest displacement may take."""
    return rounded_down(LARGEST_PART * radius / magnification * (1 + 1e-9)) if magnification else 0.0


def _turns(pictures: Sequence[TurnPicture]) -> Iterator[tuple[TurnPicture, bool]]:
    return ((picture, place == len(pictures) - 1) for place, picture in enumerate(pictures))


def _trace(points: NDArray[np.float64], latest: bool) -> str:
    if len(points) < 2:
        return ""
    if not latest:
        points = points[:: max(1, len(points) // _OLDER_POINTS)]
    return _line(points * [1.0, -1.0], ORANGE if latest else BLUE, 2.2 if latest else 1.0)


def _pieces(points: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Runs without a gap."""
    there = np.flatnonzero(np.isfinite(points[:, 1]))
    if len(there):
        yield from (points[run] for run in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1))


def _line(points: NDArray[np.float64], colour: str, width: float, dash: str = "") -> str:
    shown = " ".join(f"{x:.1f},{y:.1f}" for x, y in points.tolist())
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<polyline points="{shown}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed}/>'


def _dot(point: NDArray[np.float64], colour: str) -> str:
    return f'<circle cx="{point[0]:.1f}" cy="{point[1]:.1f}" r="2.5" fill="{colour}"/>'


def _circle(radius: float, colour: str, dash: str) -> str:
    return f'<circle r="{radius:.1f}" fill="none" stroke="{colour}" stroke-dasharray="{dash}"/>'


def _cross(size: float) -> str:
    return f'<path d="M{-size},0H{size}M0,{-size}V{size}" stroke="{_GREY}"/>'


def _text(x: float, y: float, words: str, size: int, anchor: str = "middle") -> str:
    shown = html.escape(words)
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="#444">{shown}</text>'


def _svg(parts: Sequence[str], title: str) -> str:
    box = f"{-_HALF:g} {-_HALF:g} {2 * _HALF:g} {2 * _HALF:g}"
    return f'<svg viewBox="{box}" role="img" aria-label="{title}">{"".join(parts)}</svg>'
