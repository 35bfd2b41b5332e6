"""Pictures of a commissioning: where the heads stand, how the stage turned, what the heads differ in over the turn."""

from __future__ import annotations

import io
import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.description.stage import StageDescription

# of Okabe and Ito (2008), told apart by people who see few colours
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
_GREY = "#999999"
_MOST_POINTS = 4000
"""Of a line: more than there are pixels."""


def draw(stage: StageDescription, result: Commissioning) -> bytes:
    """A PNG of all three."""
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.subplot_mosaic([["heads", "motion"], ["apart", "apart"]], height_ratios=(1.0, 1.1))
    _draw_heads(places["heads"], stage, result)
    _draw_motion(places["motion"], result)
    _draw_apart(places["apart"], result)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=100)
    return content.getvalue()


def _draw_heads(axes: Axes, stage: StageDescription, result: Commissioning) -> None:
    """The ring from +z: described azimuths in grey outside, where each head was found inside, with its sign."""
    turn = np.linspace(0.0, 2 * math.pi, 181)
    axes.plot(np.cos(turn), np.sin(turn), color=_GREY, linewidth=1.0)
    for letter, azimuth in stage.azimuths.items():
        axes.plot(*(np.outer((1.0, 1.12), (math.cos(azimuth), math.sin(azimuth))).T), color=_GREY, linewidth=1.0)
        axes.text(*_on_circle(1.25, azimuth), letter, color=_GREY, ha="center", va="center")
    for colour, (letter, head) in zip(_repeated(len(result.found.heads)), result.found.heads.items(), strict=True):
        azimuth = head.azimuth.value
        axes.plot(*_on_circle(1.0, azimuth), "o", color=colour)
        axes.text(*_on_circle(0.72, azimuth), f"{letter} {head.sign:+d}", color=colour, ha="center", va="center")
    axes.set(title="heads from +z: found inside, described outside", xlim=(-1.45, 1.45), ylim=(-1.45, 1.45))
    axes.set_aspect("equal")
    axes.set(xticks=[], yticks=[], xlabel="x", ylabel="y")


def _draw_motion(axes: Axes, result: Commissioning) -> None:
    """Rotation over time."""
    heads = result.shown.heads
    time = np.asarray(heads.shaft.times, np.float64)
    chosen = _thinned(len(time))
    axes.plot(time[chosen] - time[0], np.degrees(heads.theta[chosen]), color=_COLOURS[0], linewidth=1.2)
    axes.set(title="rotation, as the first head counts", xlabel="time, s", ylabel="degrees")
    axes.grid(visible=True, linewidth=0.4)


def _draw_apart(axes: Axes, result: Commissioning) -> None:
    """What each head reads beside the mean of all, less its zero, over the angle: once both ways where all is well."""
    heads = result.shown.heads
    apart = heads.shaft.readings - heads.shaft.readings[:, :1]
    apart -= np.median(apart, axis=0)
    apart -= 2 * math.pi * np.rint(apart / (2 * math.pi))  # whole turns between heads have no meaning
    apart = 1e6 * (apart - apart.mean(axis=1, keepdims=True))
    angle = np.degrees(np.mod(heads.theta, 2 * math.pi))
    chosen = _thinned(len(angle))
    for colour, name, values in zip(_repeated(len(heads.names)), heads.names, apart.T, strict=True):
        axes.plot(angle[chosen], values[chosen], ".", color=colour, markersize=2.0, label=name.replace("_", " "))
    axes.set(title="what the heads differ in", xlabel="angle, degrees", ylabel="µrad", xlim=(0, 360))
    axes.grid(visible=True, linewidth=0.4)
    axes.legend(loc="upper right", fontsize="small", markerscale=4)


def _on_circle(radius: float, azimuth: float) -> tuple[float, float]:
    return radius * math.cos(azimuth), radius * math.sin(azimuth)


def _repeated(count: int) -> list[str]:
    return [_COLOURS[k % len(_COLOURS)] for k in range(count)]


def _thinned(count: int) -> slice:
    return slice(None, None, max(1, math.ceil(count / _MOST_POINTS)))
