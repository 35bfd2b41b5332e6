"""Pictures of an analysis: polar plots, order spectra, course over time. Colours: Okabe and Ito's, for everybody."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread, imsave
from numpy.typing import NDArray

from rotary_error_monitor.analysis.motion import SegmentFigures, SignalFigures
from rotary_error_monitor.analysis.result import Analysis
from rotary_error_monitor.analysis.signals import RADIAL, ROTATING
from rotary_error_monitor.pipeline.error_motion_view import rounded_down

POLAR, ORDERS, COURSE = "polar plots of the error motion", "order spectra", "course over time"

_BLUE, _ORANGE, _GREY = "#0072b2", "#d55e00", "#999999"
_COLOURS = (_BLUE, _ORANGE, "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_MOST_ORDERS = 30
"""Bars that are told apart at half of the width, 4 mm each with its label; JSON has the orders above."""

_COLUMNS = 2
"""Pictures side by side: of three the text would be unreadable at 800 pixels."""

_WIDTH, _POLAR, _ROW = 9.0, 4.4, 2.6
"""Width of a picture, height of a polar plot and of another one, inches: text stays readable at 800 pixels."""

_Pair = tuple[SegmentFigures, SignalFigures]
_Line = tuple[NDArray[np.floating[Any]], NDArray[np.float64]]

_ABOVE, _BELOW, _BESIDE = 0.65, 0.55, 0.75
"""Room for titles and labels around axes, inches."""

_BASE = 1.5
"""Radius of the base circle of a polar plot, in ranges of the error motion."""


def draw(analysis: Analysis) -> dict[str, bytes]:
    """PNGs by what they show; none of what there is nothing of."""
    shown = [(segment, signal) for segment in analysis.segments for signal in segment.signals]
    polar = [pair for pair in shown if pair[1].quantity == RADIAL and pair[1].direction == ROTATING]
    spectra = [pair for pair in shown if pair[1].spectrum is not None]
    pictures: dict[str, bytes] = {}
    if polar:
        pictures[POLAR] = _grid(polar, _draw_polar, _POLAR, polar=True)
    if spectra:
        pictures[ORDERS] = _grid(_one_height(spectra), _draw_orders, _ROW, polar=False)
    if analysis.drifts:
        pictures[COURSE] = _course(analysis)
    return pictures


def joined(pictures: Mapping[str, bytes]) -> bytes:
    """One PNG with one picture below the other; blank where there is none."""
    parts = [np.asarray(imread(io.BytesIO(content))) for content in pictures.values()]
    width = max((part.shape[1] for part in parts), default=1)
    canvas = np.ones((sum(part.shape[0] for part in parts) or 1, width, 4), np.float32)
    top = 0
    for part in parts:
        canvas[top : top + part.shape[0], : part.shape[1]] = part
        top += part.shape[0]
    buffer = io.BytesIO()
    imsave(buffer, canvas, format="png")
    return buffer.getvalue()


def _one_height(pairs: Sequence[_Pair]) -> list[_Pair]:
    """Those of the largest height, which hold tilt as well."""
    heights = [signal.height for _, signal in pairs if signal.height is not None]
    return [pair for pair in pairs if pair[1].height in (None, max(heights, default=0.0))]


def _grid(pairs: Sequence[_Pair], draw_one: Callable[..., None], height: float, *, polar: bool) -> bytes:
    rows = math.ceil(len(pairs) / _COLUMNS)
    figure = _figure(rows, height)
    for number, (segment, signal) in enumerate(pairs):
        ax = figure.add_subplot(rows, _COLUMNS, number + 1, projection="polar" if polar else None)
        draw_one(ax, segment, signal)
    return _png(figure)


def _figure(rows: int, height: float) -> Figure:
    """Figure of rows of axes with room for their labels: having it found takes longer than all else."""
    figure = Figure(figsize=(_WIDTH, height * rows), dpi=100)
    room = height - _ABOVE - _BELOW
    figure.subplots_adjust(
        left=_BESIDE / _WIDTH,
        right=1 - 0.3 / _WIDTH,
        top=1 - _ABOVE / (height * rows),
        bottom=_BELOW / (height * rows),
        hspace=(_ABOVE + _BELOW) / room,
        wspace=0.3,
    )
    return figure


def _draw_polar(ax: Axes, segment: SegmentFigures, signal: SignalFigures) -> None:
    shift = signal.centres["LSC"].shift
    once = shift[0] * np.cos(signal.angles) + shift[1] * np.sin(signal.angles) + signal.synchronous.mean()
    lowest, mean, highest = (
        np.append(values, values[0]) * 1e6
        for values in (signal.lowest - once, signal.synchronous - once, signal.highest - once)
    )
    angles = np.append(signal.angles, signal.angles[0] + 2 * np.pi)
    base = _BASE * max(float(np.ptp(np.concatenate([lowest, highest]))), 1e-6)
    ax.plot(angles, np.full(len(angles), base), color=_GREY, lw=0.8, ls="--")
    ax.fill_between(angles, base + lowest, base + highest, color=_ORANGE, alpha=0.35, lw=0, label="all turns")
    ax.plot(angles, base + mean, color=_BLUE, lw=1.2, label="synchronous")
    ax.set_ylim(0, base + 1.05 * float(highest.max()))
    step = rounded_down(base / 3)
    ticks = base + step * np.array([-1, 0, 1])
    ax.set_yticks(ticks, [f"{value:+.3g}" if value else "0" for value in (-step, 0.0, step)], fontsize=8)
    place = "" if signal.height is None else f" at {signal.height * 1e3:g} mm"
    ax.set_title(f"{segment.name}\nradial, rotating direction{place}, µm about LSC", fontsize=9)
    ax.legend(loc="lower right", fontsize=7, bbox_to_anchor=(1.1, -0.08))


def _draw_orders(ax: Axes, segment: SegmentFigures, signal: SignalFigures) -> None:
    spectrum = signal.spectrum
    assert spectrum is not None
    shown = spectrum.orders <= _MOST_ORDERS
    orders = spectrum.orders[shown]
    hidden = np.isin(orders, spectrum.hidden)
    for part, hatch, label in ((~hidden, "", "amplitude"), (hidden, "////", "or graduation (hidden)")):
        if not part.any():
            continue
        bars = spectrum.amplitude[shown][part] * 1e6
        ax.bar(orders[part], bars, color="white" if hatch else _BLUE, edgecolor=_BLUE, hatch=hatch, label=label)
    ax.plot(orders, 2 * spectrum.uncertainty[shown] * 1e6, color=_ORANGE, lw=1, marker=".", ms=3, label="U (k = 2)")
    ax.set_yscale("log")
    ax.minorticks_off()
    ax.set_xlabel("order, waves a turn", fontsize=8)
    ax.set_ylabel("µrad" if signal.unit == "rad" else "µm", fontsize=8)
    ax.tick_params(labelsize=8)
    ax.set_title(f"{segment.name}, {signal.signal.replace('_', ' ')}", fontsize=9)
    ax.legend(fontsize=7)


def _course(analysis: Analysis) -> bytes:
    panels = [*_drift_panels(analysis), *((name, {name: each}) for name, each in _acting(analysis).items())]
    figure = _figure(len(panels), _ROW)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (title, lines) in zip(axes, panels, strict=True):
        for number, (name, (time, values)) in enumerate(lines.items()):
            style = {"marker": ".", "ls": ":"} if len(time) < 200 else {"lw": 0.8}
            ax.plot(time, values, color=_COLOURS[number % len(_COLOURS)], label=name, **style)
        ax.set_ylabel(title, fontsize=8)
        ax.tick_params(labelsize=8)
        ax.grid(alpha=0.3)
        if len(lines) > 1:
            ax.legend(fontsize=7)
    axes[-1].set_xlabel("time after the first estimate, s", fontsize=8)
    return _png(figure)


def _drift_panels(analysis: Analysis) -> Iterator[tuple[str, Mapping[str, _Line]]]:
    for unit, title in (("m", "mean of a turn, µm"), ("rad", "mean of a turn, µrad")):
        lines = {
            drift.signal.replace("_", " "): ((drift.times_ns - analysis.span_ns[0]) * 1e-9, drift.means * 1e6)
            for drift in analysis.drifts
            if drift.unit == unit
        }
        if lines:
            yield title, lines


def _acting(analysis: Analysis) -> Mapping[str, _Line]:
    begin, end = analysis.span_ns
    found = {}
    for name, samples in analysis.acting.items():
        inside = (samples.times_ns >= begin) & (samples.times_ns <= end)
        found[name] = (samples.times_ns[inside] - begin) * 1e-9, samples.values[inside]
    return found


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)  # type: ignore[no-untyped-call]  # matplotlib has no types here
    return buffer.getvalue()
