"""Figures 4, 6 to 13 and 15 to 17 of Zhou et al. 2023 in the paper's form, from the files of a reproduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.measurements import read_straightness
from rotary_error_monitor.calibration.straightness_runs import Placed, ReadingSettings, place_runs
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.report.drawing import WIDE, drawn, label, new_axes
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import GREY, colour
from rotary_error_monitor.reproduction.units import MM, UM

Line = tuple[Array, Array]


_HEIGHT, _MAP = 2.7, 2.9
"""Of a picture of lines and of a map, inches."""

_BAR = 0.9
"""Room right of a map for its scale, inches."""


class SurfaceTable:
    """A table over X and Z, a row a point of a grid.

    Attributes:
        x: (n,) m.
        z: (m,) m.
    """

    def __init__(self, path: Path) -> None:
        """Read it."""
        self._rows = np.genfromtxt(path, delimiter=",", names=True)
        self.x, self.z = (np.unique(self._rows[f"{letter}_mm"]) * MM for letter in "XZ")

    def values(self, column: str) -> Array:
        """(n, m) of a column in µm, m."""
        order = np.lexsort((self._rows["Z_mm"], self._rows["X_mm"]))
        return np.asarray(self._rows[column][order].reshape(self.x.size, self.z.size) * UM)

    def levelled(self, column: str) -> Array:
        """(n, m) the same less the plane of least squares, m."""
        values = self.values(column)
        x, z = (grid.ravel() for grid in np.meshgrid(self.x, self.z, indexing="ij"))
        plane = np.stack([np.ones(x.size), x, z], axis=1)
        rest = values.ravel() - plane @ np.linalg.lstsq(plane, values.ravel(), rcond=None)[0]
        return np.asarray(rest.reshape(values.shape))


def placements(path: Path, noise: float) -> list[Placed]:
    """Runs along each placement of a table, by its name in order, and their means; `noise` of a reading, m."""
    return [place_runs(each, ReadingSettings(noise)) for each in read_straightness(path).values()]


def stated_curve(machine: Path, component: str) -> Line:
    """Positions and straightness of a machine file, m, without its rotation."""
    table = load_machine(machine).errors[component].table
    assert table is not None
    return np.array(table.positions), np.array(table.forward)


def mirror_form(path: Path) -> Drawn:
    """Figure 4: form of mirror No. 1."""
    rows = np.genfromtxt(path, delimiter=",", names=True)
    line = rows["distance_mm"] * MM, rows["height_um"] * UM
    return _lines("Figure 4: form of mirror No. 1", "distance, mm", "height, µm", {"form": line})


def runs(number: int, part: Placed) -> Drawn:
    """Figure 6 or 8: all runs along a placement, less the line of their mean and each run's own height."""
    straight = np.polynomial.Polynomial.fit(part.combined.positions, part.combined.mean, 1)
    lines: dict[str, Line] = {}
    for run in part.runs:
        readings = run.readings - straight(run.positions)
        way = "forward" if run.direction > 0 else "backward"
        count = sum(name.startswith(way) for name in lines) + 1
        lines[f"{way} {count}"] = (run.positions, readings - readings.mean())
    low, high = (np.round(edge, -1) for edge in part.combined.positions[[0, -1]] / MM)
    return _lines(f"Figure {number}: Z at {low:g} to {high + 0.0:g} mm", "position, mm", "straightness, µm", lines)


def repeatability(part: Placed) -> Drawn:
    """Figure 7: what each run departs from the mean of the five of its direction."""
    lines = {
        f"run {number}": (run.positions, departure)
        for number, (run, departure) in enumerate(zip(part.runs, part.departures(), strict=True), 1)
    }
    return _lines("Figure 7: runs less the mean of their direction", "position, mm", "deviation, µm", lines)


def straightness(title: str, line: Line) -> Drawn:
    """Figure 9, 10 or 12: a straightness over its guideway."""
    return _lines(title, "position, mm", "straightness, µm", {"straightness": line})


def difference(spliced: Line, direct: Line) -> Drawn:
    """Figure 11: a spliced straightness less a direct one, about its line, where both have values."""
    at = spliced[0][(spliced[0] >= direct[0][0]) & (spliced[0] <= direct[0][-1])]
    apart = np.interp(at, *spliced) - np.interp(at, *direct)
    apart = apart - np.polynomial.Polynomial.fit(at, apart, 1)(at)
    title = "Figure 11: spliced less directly measured"
    return _lines(title, "position, mm", "difference, µm", {"difference": (at, apart)})


def rotated(machine: Path, component: str) -> Drawn:
    """Figure 13: a straightness as measured, and rotated until it is monotone."""
    at, measured = stated_curve(machine, component)
    description = load_machine(machine)
    low, high = description.axis(component[2]).travel
    slope = description.errors[component].poly[1] / ((high - low) / 2)
    curves = {"as measured": (at, measured), "rotated": (at, measured + slope * (at - (low + high) / 2))}
    return _lines(f"Figure 13: rotation of {component}", "position, mm", "error, µm", curves)


def surface(title: str, of: SurfaceTable, values: Array) -> Drawn:
    """Figure 15, 16 or 17: heights (n, m), m, over the workpiece."""
    figure, ax = new_axes(WIDE, _MAP)
    box = ax.get_position()
    ax.set_position((box.x0, box.y0, box.width - _BAR / WIDE, box.height))
    largest = float(np.abs(values - values.mean()).max()) / UM
    heights = (values - values.mean()).T / UM
    mesh = ax.pcolormesh(of.x / MM, of.z / MM, heights, cmap="RdBu_r", vmin=-largest, vmax=largest, rasterized=True)
    bar = figure.add_axes((box.x1 - 0.6 * _BAR / WIDE, box.y0, 0.03, box.height))
    figure.colorbar(mesh, cax=bar)
    bar.tick_params(labelsize=8)
    label(figure, ax, f"{title}, µm", "X, mm", "Z, mm")
    return drawn(figure, f"{title}, over X and Z; range {np.ptp(values) / UM:.3g} µm")


def _lines(title: str, x: str, y: str, lines: Mapping[str, Line]) -> Drawn:
    several = len(lines) > 1
    named: Sequence[str] = list(lines) if 1 < len(lines) < 4 else ()
    figure, ax = new_axes(WIDE, _HEIGHT, named)
    ax.axhline(0.0, color=GREY, lw=0.5)
    width = 1.0 if len(lines) < 4 else 0.5
    for number, (name, (at, values)) in enumerate(lines.items()):
        ax.plot(at / MM, values / UM, color=colour(number), lw=width, label=name if name in named else None)
    ax.grid(alpha=0.3)
    label(figure, ax, title, x, y)
    unit = y.rpartition(", ")[2]
    ranges = [f"{name} {np.ptp(values) / UM:.3g}" for name, (_, values) in lines.items()]
    told = f"ranges {', '.join(ranges)}" if several else f"range {ranges[0].rpartition(' ')[2]}"
    return drawn(figure, f"{title}, over the {x.partition(',')[0]}; {told} {unit}")
