"""Error motion as it was estimated: radial in a polar plot, and all of it over time with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.metrology.spindle_figures import sensitive_direction
from rotary_error_monitor.report.palette import BLUE
from rotary_error_monitor.report.plot import Plot
from rotary_error_monitor.report.polar import draw_base, scale_radius
from rotary_error_monitor.report.traces import MOST_POINTS, Panel, Trace, fill_axes

_PANELS = (("radial", (0, 1), "m"), ("axial", (2,), "m"), ("tilt", (3, 4), "rad"), ("angular positioning", (5,), "rad"))
"""Components that share a panel, and their unit."""

_POLAR, _WIDTH, _ROW = 4.6, 6.6, 1.9
"""Width of the polar plot, and of the panels over time, and height of one of these, inches."""

_CIRCLE = np.linspace(0, 2 * np.pi, 361)


def draw_motion(
    time: Array, theta: Array, motion: Array, sigma: Array, offset: Array | None = None, height: float = 0.0
) -> Plot:
    """Figure of the radial error motion over the angle, and of all components over time.

    Args:
        time: (n,) s.
        theta: (n,) rotation, rad.
        motion: (n, k) the first k of exc eyc ezc eac ebc ecc, m and rad, NaN where not observable.
        sigma: (n, k) standard uncertainty.
        offset: (n, 6) of a tool, m and rad; None for none.
        height: of the radial error motion above the ring, m.
    """
    panels = [*_panels(time, motion, sigma, height), *_offset_panels(time, offset)]
    seen = np.isfinite(motion[:, :2]).all(axis=1) & np.isfinite(theta)
    radial, is_polar, rows = np.where(seen[:, None], motion[:, :2], np.nan), bool(seen.any()), max(len(panels), 1)
    width = _WIDTH + (_POLAR if is_polar else 0.0)
    figure = Plot(figsize=(width, max(_ROW * rows, _POLAR)), layout="constrained")
    ratios = (_POLAR, _WIDTH) if is_polar else (_WIDTH,)
    grid = figure.add_gridspec(rows, len(ratios), width_ratios=ratios)
    if is_polar:
        _draw_polar(figure.add_subplot(grid[:, 0], projection="polar"), theta, radial, height)
    fill_axes(panels, [figure.add_subplot(grid[row, -1]) for row in range(len(panels))])
    return figure


def _place(height: float) -> str:
    return f" at {height * 1e3:g} mm" if height else ""


def _panels(time: Array, motion: Array, sigma: Array, height: float) -> Iterator[Panel]:
    for name, columns, unit in _PANELS:
        seen = [i for i in columns if i < motion.shape[1] and np.isfinite(motion[:, i]).any()]
        traces = [Trace(time, motion[:, i] * 1e6, COMPONENTS[i]) for i in seen]
        if traces:
            spread = 1e6 * float(np.nanmedian(sigma[:, seen]))
            place = _place(height) if name == "radial" else ""
            yield Panel(f"{name}{place}, µ{unit}\n(median σ {spread:.2g})", tuple(traces))


def _offset_panels(time: Array, offset: Array | None) -> Iterator[Panel]:
    if offset is not None and np.isfinite(offset).any():
        yield Panel("tool offset, µm", tuple(Trace(time, offset[:, i] * 1e6, "xyz"[i]) for i in range(3)))


def _draw_polar(ax: Axes, theta: Array, radial: Array, height: float) -> None:
    """The radial error motion in the rotating sensitive direction over the angle, every turn."""
    step = max(1, len(theta) // MOST_POINTS)
    shown = 1e6 * sensitive_direction(radial, theta)[::step]
    lowest, highest = float(np.nanmin(shown)), float(np.nanmax(shown))
    base = draw_base(ax, _CIRCLE, highest - lowest)
    ax.plot(theta[::step], base + shown, lw=0.5, color=BLUE)
    scale_radius(ax, base, highest)
    ax.tick_params(labelsize=8)
    ax.set_title(f"radial{_place(height)}, rotating sensitive direction, µm", fontsize=9)
