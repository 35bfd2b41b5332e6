"""Picture of a flatness prediction: surfaces, the wheel's trajectory, and flatness over the reversal error."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from numpy.typing import NDArray

from rotary_error_monitor.calibration.grinding import FlatnessPrediction
from rotary_error_monitor.calibration.workpiece import MeasuredSurface
from rotary_error_monitor.report.palette import BLUE, GREY, VERMILION
from rotary_error_monitor.report.plot import Plot, save

PANEL = 2.8
"""Height of a panel, inches: a workpiece of 1400 mm by 500 mm about as it is."""


def draw_flatness(path: Path, prediction: FlatnessPrediction, measured: Mapping[str, MeasuredSurface]) -> None:
    """Surfaces before compensation and after it, the wheel's trajectory, and flatness over the reversal error.

    The predicted surfaces are those of the largest reversal error; `measured` ones, by when, come below them.
    """
    comparison = prediction.comparisons[-1]
    reversal = prediction.errors.reversal[-1] * 1e6
    surfaces = (
        ("before", comparison.before),
        (f"after, curves as measured, reversal error {reversal:g} µm", comparison.unrotated),
        (f"after, curves rotated, reversal error {reversal:g} µm", comparison.rotated),
    )
    largest = max(float(np.abs(surface.heights).max()) for _, surface in surfaces) * 1e6
    count = len(surfaces) + len(measured)
    largest = max(largest, *(float(np.abs(each.heights).max()) * 1e6 for each in measured.values()), 0.0)
    figure = Plot(figsize=(8, PANEL * (count + 2)), layout="constrained")
    axes = figure.subplots(count + 2, 1)
    for ax, (name, surface) in zip(axes, surfaces, strict=False):
        mesh = _draw_map(ax, prediction, surface.heights, largest)
        ax.set_title(f"{name}: flatness {surface.flatness * 1e6:.2f} µm, {surface.reversals} reversals", fontsize=9)
    for ax, (name, found) in zip(axes[len(surfaces) :], measured.items(), strict=False):
        _draw_points(ax, prediction, found, largest)
        ax.set_title(f"measured {name}: flatness {found.flatness * 1e6:.2f} µm", fontsize=9)
    figure.colorbar(mesh, ax=axes[:count], label="height, µm")
    trajectory = prediction.trajectory - prediction.trajectory.mean()
    mesh = _draw_map(axes[count], prediction, trajectory, float(np.abs(trajectory).max()) * 1e6)
    axes[count].set_title(f"trajectory: what {prediction.vertical} adds over the workpiece, rotated", fontsize=9)
    figure.colorbar(mesh, ax=axes[count], label="height of the wheel, µm")
    axes[count].set_xlabel(f"{prediction.feeds[0]}, mm")
    _draw_benefit(axes[count + 1], prediction)
    save(figure, path)


def _draw_map(ax: Axes, prediction: FlatnessPrediction, heights: NDArray[np.float64], largest: float) -> QuadMesh:
    first, second = prediction.curves
    ax.set_ylabel(f"{prediction.feeds[1]}, mm")
    return ax.pcolormesh(
        first.positions * 1e3,
        second.positions * 1e3,
        heights.T * 1e6,
        cmap="RdBu_r",
        vmin=-largest,
        vmax=largest,
        rasterized=True,
    )


def _draw_points(ax: Axes, prediction: FlatnessPrediction, found: MeasuredSurface, largest: float) -> None:
    ax.set_ylabel(f"{prediction.feeds[1]}, mm")
    ax.tripcolor(
        found.first * 1e3,
        found.second * 1e3,
        found.heights * 1e6,
        shading="gouraud",
        cmap="RdBu_r",
        vmin=-largest,
        vmax=largest,
        rasterized=True,
    )


def _draw_benefit(ax: Axes, prediction: FlatnessPrediction) -> None:
    x = np.array(prediction.errors.reversal) * 1e6
    ax.axhline(prediction.comparisons[0].before.flatness * 1e6, color=GREY, ls=":", label="before compensation")
    ways = (("curves as measured", VERMILION, "unrotated"), ("curves rotated", BLUE, "rotated"))
    for name, colour, which in ways:
        y = [getattr(each, which).flatness * 1e6 for each in prediction.comparisons]
        ax.plot(x, y, "o-", color=colour, label=name)
    ax.set(xlabel=f"reversal error of {prediction.vertical}, µm", ylabel="flatness at worst, µm")
    ax.set_ylim(bottom=0.0)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
