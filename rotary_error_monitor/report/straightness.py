"""Pictures of a straightness: the spliced curve and what goes with it, and the runs it comes from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from rotary_error_monitor.calibration.straightness_runs import Placed
from rotary_error_monitor.calibration.straightness_step import StraightnessResult
from rotary_error_monitor.metrology.guideway_compensation import RotatedCurve
from rotary_error_monitor.metrology.positioning import COVERAGE
from rotary_error_monitor.metrology.profile_comparison import ProfileComparison
from rotary_error_monitor.metrology.reference_mirror import MirrorForm
from rotary_error_monitor.report.palette import BLUE, GREEN, GREY, VERMILION
from rotary_error_monitor.report.plot import Plot, save

WIDTH, PANEL = 9.0, 3.4
"""Of a picture and of the height of one of its panels, inches: as the other pictures of a calibration."""


def draw_straightness(path: Path, result: StraightnessResult) -> None:
    """Deviations with their expanded uncertainty, overlaps shaded; below, as far as there are, further panels.

    They hold the rotated curve, the direct measurement and the difference from it, and the mirror's form.
    """
    panels: list[Callable[[Axes], None]] = [lambda ax: _draw_curve(ax, result)]
    rotated, comparison, mirror = result.rotated, result.comparison, result.spliced.mirror
    if rotated is not None:
        panels.append(lambda ax: _draw_rotated(ax, rotated))
    if comparison is not None:
        panels += [lambda ax: _draw_both(ax, comparison), lambda ax: _draw_difference(ax, comparison)]
    if mirror is not None:
        panels.append(lambda ax: _draw_mirror(ax, mirror))
    figure = Plot(figsize=(WIDTH, 1.1 + PANEL * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False)
    for ax, draw in zip(axes[:, 0], panels, strict=True):
        draw(ax)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    save(figure, path)


def draw_runs(path: Path, result: StraightnessResult) -> None:
    """Of each placement its runs and their departures from the mean of their direction (Zhou et al. 2023, Figs 6-8)."""
    parts = result.placements
    figure = Plot(figsize=(1.4 * WIDTH, 0.8 + PANEL * len(parts)), layout="constrained")
    axes = figure.subplots(len(parts), 2, squeeze=False)
    for number, (part, (left, right)) in enumerate(zip(parts, axes, strict=True), start=1):
        _draw_runs_of(left, right, part)
        left.set_title(f"segment {number}: {len(part.runs)} runs", fontsize=9)
        left.set_ylabel("reading less line, µm")
        right.set_title(f"departure from the mean, standard deviation {part.combined.scatter * 1e6:.3f} µm", fontsize=9)
        right.set_ylabel("departure, µm")
        for ax in (left, right):
            ax.set_xlabel("position, mm")
            ax.grid(alpha=0.3)
        left.legend(fontsize=8)
    save(figure, path)


def _draw_curve(ax: Axes, result: StraightnessResult) -> None:
    spliced = result.spliced
    x, y = spliced.positions * 1e3, spliced.straightness().deviations * 1e6
    margin = COVERAGE * np.sqrt(np.maximum(np.diag(spliced.deviation_covariance()), 0.0)) * 1e6
    ax.plot(x, y, color=BLUE, label="deviation from the least squares line")
    ax.fill_between(x, y - margin, y + margin, color=BLUE, alpha=0.2, lw=0, label="expanded uncertainty (k = 2)")
    for number, overlap in enumerate(spliced.overlaps):
        label = "overlap" if number == 0 else None
        ax.axvspan(overlap.first * 1e3, overlap.last * 1e3, color=GREY, alpha=0.15, lw=0, label=label)
    ax.set(xlabel="position, mm", ylabel="deviation, µm")
    ax.set_title(f"Straightness {result.name}: {result.error * 1e6:.2f} µm")


def _draw_rotated(ax: Axes, rotated: RotatedCurve) -> None:
    label = f"rotated by {rotated.angle * 1e6:+.1f} µrad: {'rises' if rotated.rising else 'falls'}"
    ax.plot(rotated.positions * 1e3, rotated.errors * 1e6, color=GREEN, label=label)
    ax.set(xlabel="position, mm", ylabel="rotated curve, µm")


def _draw_both(ax: Axes, comparison: ProfileComparison) -> None:
    x = comparison.positions * 1e3
    ax.plot(x, comparison.first * 1e6, color=BLUE, label="spliced")
    ax.plot(x, comparison.second * 1e6, "--", color=VERMILION, label="measured directly")
    ax.set(xlabel="position, mm", ylabel="deviation, µm")


def _draw_difference(ax: Axes, comparison: ProfileComparison) -> None:
    x, margin = comparison.positions * 1e3, COVERAGE * comparison.uncertainty * 1e6
    label = f"spliced less direct, {comparison.largest * 1e6:.3f} µm at most"
    ax.plot(x, comparison.difference * 1e6, color=VERMILION, label=label)
    ax.fill_between(x, -margin, margin, color=GREY, alpha=0.2, lw=0, label="expanded uncertainty of both (k = 2)")
    ax.set(xlabel="position, mm", ylabel="difference, µm")


def _draw_mirror(ax: Axes, mirror: MirrorForm) -> None:
    x, y = mirror.distances * 1e3, mirror.heights * 1e6
    margin = COVERAGE * np.sqrt(np.maximum(np.diag(mirror.covariance), 0.0)) * 1e6
    ax.plot(x, y, color=GREEN, label=f"form of the mirror, {mirror.flatness * 1e6:.3f} µm")
    ax.fill_between(x, y - margin, y + margin, color=GREEN, alpha=0.2, lw=0, label="expanded uncertainty (k = 2)")
    ax.set(xlabel="distance from the mirror's start, mm", ylabel="height, µm")


def _draw_runs_of(left: Axes, right: Axes, part: Placed) -> None:
    line = np.polynomial.Polynomial.fit(part.combined.positions, part.combined.mean, 1)
    named = set()
    for run, departure in zip(part.runs, part.departures(), strict=True):
        colour, name = (BLUE, "forward") if run.direction > 0 else (VERMILION, "backward")
        height = np.mean(run.readings - line(run.positions))
        label = None if name in named else name
        named.add(name)
        x = run.positions * 1e3
        left.plot(x, (run.readings - line(run.positions) - height) * 1e6, color=colour, alpha=0.6, lw=0.8, label=label)
        right.plot(x, departure * 1e6, color=colour, alpha=0.6, lw=0.8)
