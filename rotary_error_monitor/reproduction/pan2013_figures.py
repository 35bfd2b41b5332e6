"""Figures 11 to 19 of Pan et al. 2013 in the paper's form, from the measurements of a reproduction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.report.drawing import WIDE, drawn, label, new_axes
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import colour

Runs = list[tuple[int, Array, Array]]
"""Direction, positions and errors of each run."""

_HEIGHT = 2.7
"""Of a picture, inches."""

_PLANES = {"EYX": "XY", "EZX": "XZ", "EXY": "XY", "EZY": "YZ"}


def positioning(number: int, letter: str, path: Path) -> Drawn:
    """Figure 11, 12, 13, 18 or 19: positioning error of an axis over its targets, each run a line."""
    rotary = letter in "AC"
    target, error = ("target_deg", "deviation_arcsec") if rotary else ("target_mm", "deviation_um")
    what = "angular positioning error" if rotary else "positioning error"
    title = f"Figure {number}: {letter}-axis {what}"
    axes = ("target, °", "error, arcsec") if rotary else ("target, mm", "error, µm")
    return _over_position(title, *axes, _runs(path, target, error, "cycle"))


def straightness(number: int, name: str, path: Path) -> Drawn:
    """Figure 14, 15, 16 or 17: readings about their line of least squares over the position, each run a line."""
    runs = _runs(path, "position_mm", "reading_um", "run")
    positions, readings = (np.concatenate([run[k] for run in runs]) for k in (1, 2))
    line = np.polyfit(positions, readings, 1)
    about = [(way, at, values - np.polyval(line, at)) for way, at, values in runs]
    title = f"Figure {number}: {name[2]}-axis straightness error in {_PLANES[name]} plane"
    return _over_position(title, "position, mm", "error about the line, µm", about)


def _runs(path: Path, position: str, value: str, run: str) -> Runs:
    rows = np.genfromtxt(path, delimiter=",", names=True)
    keys = sorted({(float(r), float(d)) for r, d in zip(rows[run], rows["direction"], strict=True)})
    found = []
    for number, way in keys:
        mine = rows[(rows[run] == number) & (rows["direction"] == way)]
        found.append((int(way), np.asarray(mine[position], float), np.asarray(mine[value], float)))
    return found


def _over_position(title: str, x: str, y: str, runs: Runs) -> Drawn:
    ways = {1: "forward", -1: "backward"}
    figure, ax = new_axes(WIDE, _HEIGHT, list(ways.values()))
    for number, (way, name) in enumerate(ways.items()):
        for place, (_, at, values) in enumerate(run for run in runs if run[0] == way):
            ax.plot(at, values, color=colour(number), lw=0.8, alpha=0.7, label=None if place else name)
    ax.grid(alpha=0.3)
    label(figure, ax, title, x, y)
    values = np.concatenate([run[2] for run in runs])
    return drawn(figure, f"{title}; {len(runs)} runs, range {np.ptp(values):.4g} {y.rpartition(', ')[2]}")
