"""Picture of a calibration between centres in the form of Lou et al. 2019, Figures 7 to 9 and 11.

Differences of opposed and of neighbouring heads and tilts of the mirror over the turn, before and after, in both
directions, and their orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from rotary_error_monitor.calibration.assembly import AssemblyResult
from rotary_error_monitor.calibration.head_comparison import AssemblyComparison, ComparedSignal, HeadPair
from rotary_error_monitor.report.drawing import go_round
from rotary_error_monitor.report.palette import BLUE, GREY, VERMILION, colour
from rotary_error_monitor.report.plot import Plot, save
from rotary_error_monitor.units import ARCSEC

MOST_ORDERS = 40
"""Orders that are drawn at most: with more their lines run together; the last that stands out is always drawn."""

STANDS_OUT = 0.01
"""Part of the largest amplitude after calibration from which an order still is drawn where there are many."""


def draw_assembly(path: Path, result: AssemblyResult) -> None:
    """Draw what was compared; rows: opposed heads, neighbours, mirror, each before and after, and their orders."""
    comparison = result.comparison
    assert comparison is not None  # it is made with every result
    groups: list[tuple[str, Sequence[ComparedSignal], int]] = [
        ("opposed heads", [pair for pair in comparison.pairs if pair.opposed], comparison.highest),
        ("neighbouring heads", [pair for pair in comparison.pairs if not pair.opposed], comparison.highest),
        ("mirror", list(comparison.mirror), comparison.tilt_highest),
    ]
    shown = [group for group in groups if group[1]]
    figure = Plot(figsize=(16, 3.6 * len(shown) + 0.5), layout="constrained")
    grid = figure.add_gridspec(len(shown), 3, width_ratios=(1.15, 1.15, 1))
    for row, (title, signals, highest) in enumerate(shown):
        for column, after in enumerate((False, True)):
            ax = figure.add_subplot(grid[row, column])
            _draw_over_turn(ax, comparison, signals, after)
            ax.set_title(f"{title}, {'after' if after else 'before'} calibration", fontsize=10)
        _draw_orders(figure.add_subplot(grid[row, 2]), signals, highest)
    save(figure, path, dpi=100)


def _draw_over_turn(
    ax: Axes,
    comparison: AssemblyComparison,
    signals: Sequence[ComparedSignal],
    after: bool,
) -> None:
    """Means over a degree in arcsec: forward as a line, backward as dots; beside it µm at the ring."""
    for number, signal in enumerate(signals):
        angles, forward, backward = signal.by_direction(signal.after if after else signal.before)
        ax.plot(np.degrees(angles), forward * ARCSEC, color=colour(number), lw=1.2, label=signal.name)
        ax.plot(np.degrees(angles), backward * ARCSEC, ".", color=colour(number), ms=3)
    ways = [Line2D([], [], color=GREY, lw=1.2), Line2D([], [], color=GREY, ls="", marker=".", ms=5)]
    handles, names = ax.get_legend_handles_labels()
    ax.legend([*handles, *ways], [*names, "forward", "backward"], fontsize=7, ncols=3, loc="upper right")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.3 * (high - low))  # room for the legend
    go_round(ax)
    ax.set(xlabel="rotation, °", ylabel="arcsec")
    pairs = [signal for signal in signals if isinstance(signal, HeadPair)]
    if pairs:
        # of heads in even steps all chords of a group are alike
        scale = comparison.displacement(pairs[0], 1 / ARCSEC) * 1e6
        beside = ax.secondary_yaxis("right", functions=(lambda y: np.multiply(y, scale), lambda y: np.divide(y, scale)))
        alike = np.ptp([pair.chord for pair in pairs]) < 0.01
        beside.set_ylabel("µm at the ring" + ("" if alike else f" of {pairs[0].name}"))


def _draw_orders(ax: Axes, signals: Sequence[ComparedSignal], highest: int) -> None:
    """Amplitudes of orders, the largest of all signals: hollow before, filled after."""
    spectra = [signal.spectrum(highest) for signal in signals]
    before, after = (np.max([each[k] for each in spectra], axis=0) * ARCSEC for k in range(2))
    standing = np.flatnonzero(before > STANDS_OUT * before.max())
    last = min(highest, max(MOST_ORDERS, int(standing[-1]) + 1))
    orders = np.arange(1, last + 1)
    ax.plot(orders, before[:last], "o", mfc="none", color=BLUE, ms=5, label="before")
    ax.plot(orders, after[:last], "o", color=VERMILION, ms=3, label="after")
    ax.vlines(orders, np.minimum(before, after)[:last], np.maximum(before, after)[:last], color=GREY, lw=0.6)
    ax.set_yscale("log")
    ax.set(xlabel="order, waves a turn", ylabel="amplitude, arcsec (largest of these)")
    ax.set_title("orders", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
