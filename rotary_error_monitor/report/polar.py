"""Polar plots of error motion: small displacements about a base circle, as in ISO 230-7."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rotary_error_monitor.pipeline.last_turn import rounded_down
from rotary_error_monitor.report.palette import GREY

_BASE = 1.5
"""Radius of the base circle, in ranges of the error motion."""


def draw_base(ax: Axes, angles: NDArray[np.floating[Any]], span: float) -> float:
    """Draw the base circle at angles (k,) rad for error motion of a range, µm; gives its radius."""
    base = _BASE * max(span, 1e-6)
    ax.plot(angles, np.full(len(angles), base), color=GREY, lw=1.0, ls="--")
    return base


def scale_radius(ax: Axes, base: float, highest: float) -> None:
    """Have the radius end beyond the highest value, µm, with three circles named by their distance from the base."""
    ax.set_ylim(0, base + 1.05 * highest)
    step = rounded_down(base / 2.2)
    ticks = base + step * np.array([-1, 0, 1])
    names = [f"{value:+.3g}" if value else "0" for value in (-step, 0.0, step)]
    ax.set_yticks(ticks, names, fontsize=8)
    for text in ax.get_yticklabels():
        text.set_bbox({"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.8})
        text.set_zorder(5)
    ax.set_axisbelow(False)
