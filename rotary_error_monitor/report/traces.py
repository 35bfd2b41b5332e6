"""Traces over time, panel below panel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rotary_error_monitor.report.palette import colour
from rotary_error_monitor.report.plot import Plot, save

MOST_POINTS = 20_000
"""Points of a trace that are drawn; of longer ones every n-th."""


@dataclass(frozen=True)
class Trace:
    """One line: times (n,) s, values (n,), its name."""

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    name: str


@dataclass(frozen=True)
class Panel:
    """One axes: what stands at its ordinate, with unit, and its lines.

    Attributes:
        log: logarithmic ordinate.
        own_time: the panel has a time axis of its own, not that of the panels above.
    """

    title: str
    traces: tuple[Trace, ...]
    log: bool = False
    own_time: bool = False


def draw_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Write a picture with one panel below the other.

    Raises:
        InputError: it cannot be written.
    """
    save(figure_of_panels(panels), path)


def figure_of_panels(panels: Sequence[Panel]) -> Plot:
    """Figure with one panel below the other."""
    figure = Plot(figsize=(9, 2.2 * len(panels)), layout="constrained")
    fill_axes(panels, figure.subplots(len(panels), 1, squeeze=False)[:, 0])
    return figure


def fill_axes(panels: Sequence[Panel], axes: Iterable[Axes]) -> None:
    """Draw each panel in its axes, the last one with the name of the time axis."""
    shared, ax = None, None
    for panel, ax in zip(panels, axes, strict=True):
        for number, trace in enumerate(panel.traces):
            step = max(1, len(trace.time) // MOST_POINTS)
            ax.plot(trace.time[::step], trace.values[::step], linewidth=0.8, color=colour(number), label=trace.name)
        ax.set_ylabel(panel.title, fontsize=8)
        ax.grid(alpha=0.3)
        ax.legend(loc="upper right", fontsize=7)
        if panel.log:
            ax.set_yscale("log")
        if not panel.own_time:
            if shared is not None:
                ax.sharex(shared)
            shared = shared or ax
    if ax is not None:
        ax.set_xlabel("time, s")
