"""Pictures of a commissioning: where the heads stand, how the stage turned, what the heads differ in over the turn."""

from __future__ import annotations

import math
from itertools import cycle

import numpy as np

from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.report.drawing import NARROW, drawn, label, new_axes
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLUE, GREY, colour

_MOST_POINTS = 4000
"""Of a line: more than there are pixels."""

_RING, _COURSE = 3.8, 3.8
"""Heights of the ring, and of what goes over time or angle, inches."""

_MARKERS = "osD^vP*X"
"""Of heads, beside their colours."""

_MARKED = 24
"""Samples with a marker, in each line."""


def draw(stage: StageDescription, result: Commissioning) -> list[Drawn]:
    """All three."""
    return [_heads(stage, result), _motion(result), _apart(result)]


def _heads(stage: StageDescription, result: Commissioning) -> Drawn:
    """The ring from +z: described azimuths in grey outside, where each head was found inside, with its sign."""
    figure, axes = new_axes(NARROW, _RING, left=0.3)
    turn = np.linspace(0.0, 2 * math.pi, 181)
    axes.plot(np.cos(turn), np.sin(turn), color=GREY, linewidth=1.0)
    for letter, azimuth in stage.azimuths.items():
        axes.plot(*(np.outer((1.0, 1.12), (math.cos(azimuth), math.sin(azimuth))).T), color=GREY, linewidth=1.0)
        axes.text(*_on_circle(1.25, azimuth), letter, color=GREY, ha="center", va="center")
    for number, ((letter, head), marker) in enumerate(zip(result.found.heads.items(), cycle(_MARKERS), strict=False)):
        azimuth = head.azimuth.value
        axes.plot(*_on_circle(1.0, azimuth), marker, color=colour(number), markersize=8)
        axes.text(*_on_circle(0.7, azimuth), f"{letter} {head.sign:+d}", ha="center", va="center", weight="bold")
    axes.set(xlim=(-1.45, 1.45), ylim=(-1.45, 1.45))
    axes.set_aspect("equal")
    axes.set(xticks=[], yticks=[])
    label(figure, axes, "Heads from +z: found inside, described outside", "x", "y")
    found = ", ".join(
        f"{letter} {math.degrees(head.azimuth.value):.1f}° {head.sign:+d}"
        for letter, head in result.found.heads.items()
    )
    return drawn(figure, f"Heads round the ring as described and as found, with the sign of their counting: {found}")


def _motion(result: Commissioning) -> Drawn:
    """Rotation over time."""
    heads = result.shown.heads
    time = np.asarray(heads.shaft.times, np.float64)
    chosen = _thinned(len(time))
    degrees = np.degrees(heads.theta[chosen])
    figure, axes = new_axes(NARROW, _COURSE)
    axes.plot(time[chosen] - time[0], degrees, color=BLUE, linewidth=1.2)
    axes.grid(visible=True, linewidth=0.4)
    label(figure, axes, "Rotation, as the first head counts", "time, s", "rotation, °")
    alt = f"Rotation over {time[-1] - time[0]:.1f} s, from {degrees.min():.1f}° to {degrees.max():.1f}°"
    return drawn(figure, alt)


def _apart(result: Commissioning) -> Drawn:
    """What each head reads beside the mean of all, less its zero, over the angle: once both ways where all is well."""
    heads = result.shown.heads
    apart = heads.shaft.readings - heads.shaft.readings[:, :1]
    apart -= np.median(apart, axis=0)
    apart -= 2 * math.pi * np.rint(apart / (2 * math.pi))  # whole turns between heads have no meaning
    apart = 1e6 * (apart - apart.mean(axis=1, keepdims=True))
    angle = np.degrees(np.mod(heads.theta, 2 * math.pi))
    chosen = _thinned(len(angle))
    figure, axes = new_axes(2 * NARROW, _COURSE, list(heads.names))
    for number, (name, values, marker) in enumerate(zip(heads.names, apart.T, cycle(_MARKERS), strict=False)):
        axes.plot(angle[chosen], values[chosen], ".", color=colour(number), markersize=1.5)
        some = np.searchsorted(np.sort(angle), np.linspace(0, 360, _MARKED, endpoint=False) + 3 * number)
        marked = np.argsort(angle)[np.minimum(some, len(angle) - 1)]
        axes.plot(angle[marked], values[marked], marker, color=colour(number), ms=5, label=name.replace("_", " "))
    axes.set_xlim(0, 360)
    axes.grid(visible=True, linewidth=0.4)
    label(figure, axes, "What the heads differ in from their mean", "angle, °", "difference, µrad")
    ranges = ", ".join(
        f"{name.replace('_', ' ')} {np.ptp(values):.3g} µrad" for name, values in zip(heads.names, apart.T, strict=True)
    )
    return drawn(figure, f"What each head reads beside the mean of all over the angle; peak to valley {ranges}")


def _on_circle(radius: float, azimuth: float) -> tuple[float, float]:
    return radius * math.cos(azimuth), radius * math.sin(azimuth)


def _thinned(count: int) -> slice:
    return slice(None, None, max(1, math.ceil(count / _MOST_POINTS)))
