"""Picture of how axes and spindle lie beside each other: angles and distances with their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from rotary_error_monitor.calibration.axis_lines import SquarenessResult
from rotary_error_monitor.calibration.axis_table import LINEAR_LENGTH, AxisRelation
from rotary_error_monitor.report.palette import BLACK, BLUE, GREEN, GREY
from rotary_error_monitor.report.plot import Plot, save
from rotary_error_monitor.units import ARCSEC

ROW = 0.32
"""Height of a row, inches."""

FRAME = 1.3
"""Height of titles and of the names of the axes, inches."""


def draw_axes(path: Path, result: SquarenessResult) -> None:
    """Angles of linear axes, of rotary axes and spindle beside them, and distances, each with its bounds of 95 %."""
    angles = [row for row in result.relations if row.length is not None]
    apart = [row for row in result.relations if row.length is None]
    count = 1 + bool(apart)
    height = FRAME + ROW * max(len(angles), len(apart), 3)
    figure = Plot(figsize=(7.0 * count, height), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)
    _draw(axes[0, 0], angles, ARCSEC, "arcsec", "Angles")
    if apart:
        _draw(axes[0, 1], apart, 1e6, "µm", "Distances")
    save(figure, path)


def _draw(ax: Axes, rows: Sequence[AxisRelation], scale: float, unit: str, title: str) -> None:
    """A row each, the first above; between linear axes in another colour than those of rotary axes and spindle."""
    for place, row in enumerate(rows):
        found = row.relation
        shade = BLUE if row.length == LINEAR_LENGTH else GREEN
        ax.barh(place, found.value * scale, color=shade, height=0.6)
        bounds = [[(found.value - found.low) * scale], [(found.high - found.value) * scale]]
        ax.errorbar(found.value * scale, place, xerr=bounds, color=BLACK, capsize=3, lw=1.2)
    ax.set_yticks(range(len(rows)), [f"{row.item} {row.axes}" for row in rows])
    ax.invert_yaxis()
    ax.axvline(0.0, color=GREY, lw=0.8)
    ax.grid(axis="x", alpha=0.3)
    ax.set_xlabel(f"{unit}, with bounds of 95 %")
    ax.set_title(title)
