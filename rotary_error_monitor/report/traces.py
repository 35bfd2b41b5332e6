"""Traces over time, panel below panel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from rotary_error_monitor.report.palette import colour

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
    """Write a PNG with one panel below the other."""
    figure, axes = plt.subplots(len(panels), 1, figsize=(9, 2.2 * len(panels)), layout="constrained", squeeze=False)
    shared = None
    for panel, ax in zip(panels, axes[:, 0], strict=True):
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
    axes[-1, 0].set_xlabel("time, s")
    figure.savefig(path, dpi=110)
    plt.close(figure)
