"""The reliability diagram: stated probabilities against how often they came true."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.report.palette import BLUE, GREY
from rotary_error_monitor.report.plot import Plot, save


def draw_reliability(path: Path, stated: Array, share: Array, interval: Array, title: str) -> None:
    """Write the diagram as SVG or PNG, as the suffix of the file says.

    Args:
        path: the file.
        stated: (b,) mean of the probabilities of each bin.
        share: (b,) part of the statements of each bin that were right.
        interval: (b, 2) least and largest frequency that such a part fits.
        title: of the diagram.
    """
    figure = Plot(figsize=(5, 5), layout="constrained")
    ax = figure.subplots()
    ax.plot([0, 1], [0, 1], "--", color=GREY, lw=1, label="as stated")
    beside = np.maximum(np.stack([share - interval[:, 0], interval[:, 1] - share]), 0.0)
    ax.errorbar(stated, share, beside, fmt="o", color=BLUE, capsize=3, label="observed, 95 % interval")
    ax.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal", title=title)
    ax.set(xlabel="stated probability", ylabel="observed frequency")
    ax.legend(loc="upper left")
    save(figure, path, dpi=100)
