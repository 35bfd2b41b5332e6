"""Picture of an autocollimator's calibration in the form of Lou et al. 2019, Figures 4 and 5."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from rotary_error_monitor.calibration.collimator import CollimatorResult
from rotary_error_monitor.report.palette import BLUE, GREY, ORANGE, VERMILION
from rotary_error_monitor.report.plot import Plot, save
from rotary_error_monitor.units import ARCSEC

ARROW = 0.15
"""Length of the longest residual on the detector, as a part of the steps' extent."""

POINTS = 101
"""Of a curve that is drawn: a cubic over them departs from its chords by less than the width of a line."""


def draw_collimator(path: Path, result: CollimatorResult) -> None:
    """Readings over what the reference shows and what is left of them, by axis; beside it the steps on the detector."""
    figure = Plot(figsize=(14, 7), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(1.3, 1), width_ratios=(1, 1, 1.05))
    for axis in range(2):
        above = figure.add_subplot(grid[0, axis])
        _draw_readings(above, result, axis)
        _draw_residual(figure.add_subplot(grid[1, axis], sharex=above), result, axis)
    _draw_detector(figure.add_subplot(grid[:, 2]), result)
    save(figure, path)


def _draw_readings(ax: Axes, result: CollimatorResult, axis: int) -> None:
    found = result.calibration
    tilts = _along(result, axis)
    # what the other axis shows is taken off, so that all steps lie about one line
    alone = np.tile(tilts[0], (len(found.used), 1))
    alone[:, axis] = found.steps.reference[:, axis]
    shown = alone[:, axis] * ARCSEC
    read = (found.response.readings(alone) + found.fit.residual)[:, axis] * ARCSEC
    ax.plot(
        tilts[:, axis] * ARCSEC, found.response.readings(tilts)[:, axis] * ARCSEC, color=GREY, label="fitted response"
    )
    ax.plot(shown[found.used], read[found.used], "o", ms=4, color=BLUE, label="mean reading of a step")
    _draw_left_out(ax, result, shown, read)
    ax.set_ylabel(f"reading {'xy'[axis]}, arcsec")
    ax.set_title(f"{'XY'[axis]}: calibration", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    ax.tick_params(labelbottom=False)


def _draw_residual(ax: Axes, result: CollimatorResult, axis: int) -> None:
    found = result.calibration
    shown, left = found.steps.reference[:, axis] * ARCSEC, found.residual[:, axis] * ARCSEC
    tilts = _along(result, axis)
    band = found.expanded(tilts)[:, axis] * ARCSEC
    at = tilts[:, axis] * ARCSEC
    ax.fill_between(at, -band, band, color=BLUE, alpha=0.2, lw=0, label="expanded uncertainty (95 %)")
    explained = float(found.plausible_residual[axis]) * ARCSEC
    for sign in (1, -1):
        label = "reference and noise explain" if sign > 0 else None
        ax.axhline(sign * explained, color=ORANGE, ls="--", lw=1, label=label)
    ax.plot(shown[found.used], left[found.used], "o", ms=4, color=BLUE)
    largest = float(np.abs(left[found.used]).max())
    inside = np.abs(left) < 3 * max(explained, largest)
    _draw_left_out(ax, result, np.where(inside, shown, np.nan), left)
    most = 2 * max(explained, largest, float(band.max()))
    ax.set_ylim(-most, most)
    ax.set(xlabel=f"reference {'xy'[axis]}, arcsec", ylabel="residual, arcsec")
    ax.set_title(f"{'XY'[axis]}: residual ±{largest:.2f} arcsec", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7, ncols=2, loc="upper center")


def _draw_detector(ax: Axes, result: CollimatorResult) -> None:
    """The spot on the quadrants as Figure 4 has it: a tilt about y moves it along +x, one about x along -y."""
    found = result.calibration
    tilt, left = found.steps.reference * ARCSEC, found.residual * ARCSEC
    spots, off = (np.stack([pair[:, 1], -pair[:, 0]], axis=1) for pair in (tilt, left))
    extent = float(np.abs(spots).max())
    largest = float(np.hypot(*off[found.used].T).max())
    scale = ARROW * extent / largest if largest > 0 else 1.0
    ax.axhline(0, color=GREY, lw=0.8)
    ax.axvline(0, color=GREY, lw=0.8)
    for (x, y), name in zip(((1, 1), (-1, 1), (-1, -1), (1, -1)), ("q1", "q2", "q3", "q4"), strict=True):
        ax.text(x * 1.15 * extent, y * 1.15 * extent, name, color=GREY, ha="center", va="center")
    ax.plot(*spots[found.used].T, "o", ms=4, color=BLUE)
    _draw_left_out(ax, result, *spots.T)
    for spot, arrow in zip(spots[found.used], off[found.used] * scale, strict=True):
        ax.plot(*np.stack([spot, spot + arrow]).T, color=BLUE, lw=1)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * result.range[0] * found.response.gain
    edge = found.response.corrected(corners.astype(np.float64)) * ARCSEC
    ax.plot(edge[:, 1], -edge[:, 0], "--", color=ORANGE, lw=1)
    ax.set_xlim(-1.3 * extent, 1.3 * extent)
    ax.set_ylim(-1.3 * extent, 1.3 * extent)
    ax.set_aspect("equal")
    ax.set(xlabel="reference y: spot along x of the detector, arcsec", ylabel="less reference x: spot along y, arcsec")
    ax.set_title(f"Steps on the detector, residuals {scale:.0f} times\n(dashed: range)", fontsize=10)


def _draw_left_out(ax: Axes, result: CollimatorResult, x: np.ndarray, y: np.ndarray) -> None:
    if not result.calibration.used.all():
        out = ~result.calibration.used
        ax.plot(x[out], y[out], "x", color=VERMILION, label="left out")


def _along(result: CollimatorResult, axis: int) -> np.ndarray:
    """(p, 2) tilts along one axis over the steps that were used, rad; the other axis in the middle of its steps."""
    used = result.calibration.steps.reference[result.calibration.used]
    tilts = np.tile(np.median(used, axis=0), (POINTS, 1))
    tilts[:, axis] = np.linspace(used[:, axis].min(), used[:, axis].max(), POINTS)
    return tilts
