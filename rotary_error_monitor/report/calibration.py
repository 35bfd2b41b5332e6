"""Pictures of a calibration: positioning, and which error costs what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rotary_error_monitor.calibration.steps import PositioningResult
from rotary_error_monitor.calibration.volume import ErrorCost, VolumetricMap
from rotary_error_monitor.metrology.positioning import COVERAGE
from rotary_error_monitor.report.palette import BLUE, VERMILION
from rotary_error_monitor.report.plot import Plot, save
from rotary_error_monitor.units import ARCSEC

MOST_BARS = 20


def draw_positioning(path: Path, result: PositioningResult) -> None:
    """Readings, means by direction and their band of two standard deviations, as ISO 230-2 draws them."""
    rotary = result.runs.rotary
    where, scale = (180 / math.pi, ARCSEC) if rotary else (1e3, 1e6)
    figure = Plot(figsize=(9, 4.5), layout="constrained")
    ax = figure.subplots()
    targets = result.runs.targets * where
    ways = [("forward", BLUE, result.runs.forward, result.figures.forward)]
    if result.runs.backward is not None and result.figures.backward is not None:
        ways.append(("backward", VERMILION, result.runs.backward, result.figures.backward))
    for name, colour, readings, figures in ways:
        ax.plot(targets, readings * scale, ".", color=colour, alpha=0.5)
        ax.plot(targets, figures.mean * scale, color=colour, label=f"{name}, mean")
        margin = COVERAGE * figures.spread
        ax.fill_between(
            targets, (figures.mean - margin) * scale, (figures.mean + margin) * scale, color=colour, alpha=0.15, lw=0
        )
    ax.set(xlabel=f"target, {'deg' if rotary else 'mm'}", ylabel=f"deviation, {'arcsec' if rotary else 'µm'}")
    ax.set_title(f"Positioning {result.name} (ISO 230-2)\n{_figures_in_words(result, scale)}", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    save(figure, path)


def _figures_in_words(result: PositioningResult, scale: float) -> str:
    """The figures that a drawing is read for, with their 95 % intervals."""
    figures, bounds = result.figures.bidirectional, result.bounds.bidirectional
    if figures is None or bounds is None:
        one, own = result.figures.forward, result.bounds.forward
        rows = [("A", one.accuracy, own.accuracy), ("R", one.repeatability, own.repeatability)]
    else:
        rows = [
            ("A", figures.accuracy, bounds.accuracy),
            ("R", figures.repeatability, bounds.repeatability),
            ("B", figures.reversal_error, bounds.reversal_error),
        ]
    unit = "arcsec" if result.runs.rotary else "µm"
    words = [f"{name} {size * scale:.2f} ({low * scale:.2f} to {high * scale:.2f})" for name, size, (low, high) in rows]
    return f"{', '.join(words)} {unit}; in brackets 95 %"


def draw_errors(path: Path, costs: Sequence[ErrorCost], chart: VolumetricMap) -> None:
    """Map of the tool offset over two axes, position and orientation, beside the errors ranked by what they cost."""
    figure = Plot(figsize=(13, 6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.2))
    maps = (
        (chart.position_error * 1e6, "position error, µm"),
        (chart.orientation_error * 1e6, "orientation error, µrad"),
    )
    for row, (values, title) in enumerate(maps):
        ax = figure.add_subplot(grid[row, 0])
        scales = [180 / math.pi if rotary else 1e3 for rotary in chart.rotary]
        first, second = chart.first * scales[0], chart.second * scales[1]
        mesh = ax.pcolormesh(first, second, values.T, shading="gouraud", cmap="viridis")
        figure.colorbar(mesh, ax=ax, label=title)
        units = ["deg" if rotary else "mm" for rotary in chart.rotary]
        ax.set(xlabel=f"{chart.axes[0]}, {units[0]}", ylabel=f"{chart.axes[1]}, {units[1]}")
    ax = figure.add_subplot(grid[:, 1])
    shown = list(costs[:MOST_BARS])[::-1]
    ax.barh([cost.name for cost in shown], [cost.position_largest * 1e6 for cost in shown], color=BLUE, alpha=0.25)
    ax.barh([cost.name for cost in shown], [cost.position_rms * 1e6 for cost in shown], color=BLUE)
    ax.set_xlabel("tool position error by this error alone, µm:\nroot mean square (dark) and largest (light)")
    save(figure, path)
