"""Pictures of an analysis: polar plots, order spectra, course over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rotary_error_monitor.analysis.motion import SegmentFigures, SignalFigures
from rotary_error_monitor.analysis.result import AnalysisResult
from rotary_error_monitor.analysis.signals import RADIAL, ROTATING
from rotary_error_monitor.report.drawing import (
    NARROW,
    WIDE,
    Sketch,
    draw_bars,
    drawn,
    in_rows,
    label,
    new_axes,
    scale_by_powers,
    tiled,
)
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLACK, BLUE, ORANGE, colour
from rotary_error_monitor.report.polar import draw_base, scale_radius
from rotary_error_monitor.report.wording import amount, spoken

POLAR, ORDERS, COURSE = "Polar plots", "Orders", "Course over time"

_HIDDEN = "hidden orders"

_MOST_ORDERS = 30
"""Bars that are told apart; JSON has the orders above."""

_POLAR_HEIGHT, _HEIGHT = 3.9, 2.5
"""Of a polar plot, and of another picture, inches."""

_LOWEST, _FAINTEST = 0.1, 0.003
"""Where the axis of a spectrum begins, in the least uncertainty and in the largest amplitude, whichever is less: bars
below tell nothing."""

_FEW = 100
"""Points of a line that are told apart."""

COLUMNS = {POLAR: 3, ORDERS: 2, COURSE: 2}
"""Pictures side by side where all are in one PNG."""

_Line = tuple[NDArray[np.floating[Any]], NDArray[np.float64]]


def draw(analysis: AnalysisResult) -> dict[str, list[Drawn]]:
    """Pictures by what they show; none of what there is nothing of."""
    found = {name: [drawn(*each) for each in sketches(analysis, name)] for name in (POLAR, ORDERS, COURSE)}
    return {name: pictures for name, pictures in found.items() if pictures}


def sketches(analysis: AnalysisResult, shown: str) -> Iterator[Sketch]:
    """Pictures of `POLAR`, `ORDERS` or `COURSE`, one after another."""
    if shown == COURSE:
        yield from _courses(analysis)
    for segment in analysis.segments:
        if shown == POLAR:
            yield from (_polar(segment, signal) for signal in _rotating(segment))
        if shown == ORDERS:
            yield from (_orders(segment, signals) for signals in _with_spectra(segment))


def joined(pictures: Mapping[str, Sequence[Drawn]]) -> bytes:
    """One PNG of all; blank where there is none."""
    return tiled([row for name, each in pictures.items() for row in in_rows(each, COLUMNS[name])])


def _rotating(segment: SegmentFigures) -> list[SignalFigures]:
    return [each for each in segment.signals if each.quantity == RADIAL and each.direction == ROTATING]


def _with_spectra(segment: SegmentFigures) -> Iterator[list[SignalFigures]]:
    """Signals of one quantity, at the largest height, which holds tilt as well."""
    shown = [signal for signal in segment.signals if signal.spectrum is not None]
    highest = max((signal.height for signal in shown if signal.height is not None), default=0.0)
    there = [signal for signal in shown if signal.height in (None, highest)]
    for _, same in groupby(there, key=lambda signal: signal.quantity):
        yield list(same)


def _polar(segment: SegmentFigures, signal: SignalFigures) -> Sketch:
    figure, ax = new_axes(NARROW, _POLAR_HEIGHT, ("all turns", "synchronous"), polar=True, left=0.4)
    shift = signal.centres["LSC"].shift
    once = shift[0] * np.cos(signal.angles) + shift[1] * np.sin(signal.angles) + signal.synchronous.mean()
    lowest, mean, highest = (
        np.append(values, values[0]) * 1e6
        for values in (signal.lowest - once, signal.synchronous - once, signal.highest - once)
    )
    angles = np.append(signal.angles, signal.angles[0] + 2 * np.pi)
    base = draw_base(ax, angles, float(np.ptp(np.concatenate([lowest, highest]))))
    ax.fill_between(angles, base + lowest, base + highest, color=ORANGE, alpha=0.6, lw=0, label="all turns")
    ax.plot(angles, base + mean, color=BLUE, lw=1.4, label="synchronous")
    scale_radius(ax, base, float(highest.max()))
    place = "" if signal.height is None else f", {signal.height * 1e3:g} mm"
    label(figure, ax, f"{segment.name}{place}: radial, µm")
    alt = (
        f"Polar plot about the least-squares centre, {segment.name}, {spoken(signal.signal)}: synchronous error motion "
        f"{amount(signal.values['synchronous'], signal.unit)}, and the band of all turns"
    )
    return Sketch(figure, alt)


def _orders(segment: SegmentFigures, signals: Sequence[SignalFigures]) -> Sketch:
    figure, ax = new_axes(
        WIDE, _HEIGHT, [*(signal.direction for signal in signals), _HIDDEN, *map(_uncertainty, signals)]
    )
    width = 0.8 / len(signals)
    least, highest = [], 0.0
    hatched = next((signal for signal in signals if signal.spectrum is not None and signal.spectrum.hidden), None)
    for number, signal in enumerate(signals):
        name = _HIDDEN if signal is hatched else None
        _draw_bars(ax, signal, number, (number - (len(signals) - 1) / 2) * width, width, name)
        assert signal.spectrum is not None
        highest = max(highest, 1e6 * float(signal.spectrum.amplitude.max()))
        least.append(2e6 * float(signal.spectrum.uncertainty[signal.spectrum.orders <= _MOST_ORDERS].min()))
    scale_by_powers(ax)
    if min(least) > 0.0 and highest > 0.0:
        ax.set_ylim(bottom=min(_LOWEST * min(least), _FAINTEST * highest))
    unit = "µrad" if signals[0].unit == "rad" else "µm"
    height = signals[0].height
    place = "" if height is None else f" at {height * 1e3:g} mm"
    label(figure, ax, f"{segment.name}: {signals[0].quantity}{place}", "order, waves a turn", f"amplitude, {unit}")
    return Sketch(figure, f"Order spectrum, {segment.name}, {signals[0].quantity}{place}: {_peaks(signals, unit)}")


def _draw_bars(ax: Axes, signal: SignalFigures, number: int, shift: float, width: float, name: str | None) -> None:
    """Amplitudes of one direction, hollow (called `name`) where a form error passes for them, and their uncertainty."""
    spectrum = signal.spectrum
    assert spectrum is not None
    shown = spectrum.orders <= _MOST_ORDERS
    orders, amplitudes = spectrum.orders[shown], spectrum.amplitude[shown] * 1e6
    hidden = np.isin(orders, spectrum.hidden)
    told = colour(number)
    draw_bars(ax, orders[~hidden] + shift, amplitudes[~hidden], width, facecolor=told, lw=0, label=signal.direction)
    if hidden.any():
        style: dict[str, Any] = {"facecolor": "white", "edgecolor": told, "hatch": "////", "lw": 0.8}
        draw_bars(ax, orders[hidden] + shift, amplitudes[hidden], width, label=name, **style)
    line = ("-", "--", ":")[number % 3]
    twice = 2 * spectrum.uncertainty[shown] * 1e6
    ax.plot(orders, twice, color=BLACK, lw=1, ls=line, label=_uncertainty(signal))


def _uncertainty(signal: SignalFigures) -> str:
    return f"U of {signal.direction} (k = 2)"


def _peaks(signals: Sequence[SignalFigures], unit: str) -> str:
    parts = []
    for signal in signals:
        assert signal.spectrum is not None
        peak = int(np.argmax(signal.spectrum.amplitude))
        size = float(signal.spectrum.amplitude[peak]) * 1e6
        parts.append(f"{signal.direction} is largest at order {signal.spectrum.orders[peak]}, {size:.3g} {unit}")
    return "; ".join(parts)


def _courses(analysis: AnalysisResult) -> Iterator[Sketch]:
    panels = [*_drift_panels(analysis), *((name, {name: each}) for name, each in _acting(analysis).items())]
    for title, lines in panels:
        figure, ax = new_axes(WIDE, _HEIGHT, list(lines) if len(lines) > 1 else ())
        for number, (name, (time, values)) in enumerate(lines.items()):
            style: dict[str, Any] = {"lw": 0.9}
            if len(time) < _FEW:
                style = {"marker": "osD^"[number % 4], "ms": 3.5, "ls": ":"}
            ax.plot(time, values, color=colour(number), label=name if len(lines) > 1 else None, **style)
        ax.grid(alpha=0.3)
        ax.set_xlim(0, (analysis.span_ns[1] - analysis.span_ns[0]) * 1e-9)
        what, _, unit = title.rpartition(", ")
        named = what[0].upper() + what[1:]
        label(figure, ax, named, "time after the first estimate, s", title)
        shown = f": {', '.join(lines)}" if len(lines) > 1 else ""
        yield Sketch(figure, f"{named} over time, from {_range(lines)} {unit}{shown}")


def _range(lines: Mapping[str, _Line]) -> str:
    values = np.concatenate([values for _, values in lines.values()])
    told = values[np.isfinite(values)]
    return f"{told.min():.3g} to {told.max():.3g}" if len(told) else "nothing to nothing"


def _drift_panels(analysis: AnalysisResult) -> Iterator[tuple[str, Mapping[str, _Line]]]:
    for unit, title in (("m", "mean of a turn, µm"), ("rad", "mean of a turn, µrad")):
        lines = {
            spoken(drift.signal): ((drift.times_ns - analysis.span_ns[0]) * 1e-9, drift.means * 1e6)
            for drift in analysis.drifts
            if drift.unit == unit
        }
        if lines:
            yield title, lines


def _acting(analysis: AnalysisResult) -> Mapping[str, _Line]:
    begin, end = analysis.span_ns
    found = {}
    for name, samples in analysis.acting.items():
        inside = (samples.times_ns >= begin) & (samples.times_ns <= end)
        found[name] = (samples.times_ns[inside] - begin) * 1e-9, samples.values[inside]
    return found
