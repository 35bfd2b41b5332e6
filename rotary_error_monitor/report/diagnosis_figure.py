"""The figure of a diagnosis: gap, where it lies, ranking, and residuals of the channels that matter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.views import View
from rotary_error_monitor.report.drawing import NARROW, WIDE, Sketch, drawn, label, new_axes, tiled
from rotary_error_monitor.report.drawn import Sheet
from rotary_error_monitor.report.palette import BLUE, GREEN, GREY, VERMILION
from rotary_error_monitor.report.picture import Picture

_OVERVIEW, _VIEW = 2.9, 2.4
"""Height of a picture of the overview, and of one of residuals, inches."""

_NAMES = 1.75
"""Room for names beside bars, inches."""

_NUMBERS = 0.82
"""Room for residuals of six characters beside their axis, inches."""

_LONGEST = 27
"""Characters of a name that have room there."""

_FEWEST = 4
"""Bars that there is room for at least, or one alone would be a block."""

_VISIBLE = 0.005
"""Probability that a bar shows."""


def draw(picture: Picture) -> Sheet:
    """The gap, where it lies, the ranking, and the residuals of the channels that matter before and after."""
    rows = [tuple(drawn(*each) for each in row) for row in sketches(picture)]
    return Sheet(tuple(rows), tiled(rows))


def sketches(picture: Picture) -> Iterator[tuple[Sketch, ...]]:
    """The same before it is drawn, row by row."""
    shares = [(_short(channel), share) for channel, share in picture.where]
    none = "nothing exceeds the noise"
    yield (
        _gap(picture),
        _bars("Where: share of the excess", shares, BLUE, none),
        _bars("Which: probability", picture.ranking, GREEN, "none of the known effects"),
    )
    # residuals are those of the textbook forms: what departs stays in them
    after = picture.gap[1][0].replace("\n", " ") if len(picture.gap) > 2 else ""
    for channel in picture.channels:
        views = [view for view in picture.views if view.channel == channel]
        yield tuple(_view(view, after, _span(views), WIDE if len(views) < 3 else NARROW) for view in views)
    missing = {view.channel for view in picture.views} - set(picture.channels)
    if missing:
        raise ValueError(f"views of channels that are not shown: {', '.join(sorted(missing))}")


def _gap(picture: Picture) -> Sketch:
    figure, ax = new_axes(NARROW, _OVERVIEW)
    names, sizes = zip(*picture.gap, strict=True)
    bars = ax.bar(names, sizes, color=[VERMILION, *[BLUE] * (len(names) - 2), GREY])
    ax.bar_label(bars, [f"{size:.3g}" for size in sizes], fontsize=9)
    ax.set_ylim(0, 1.12 * max(sizes))
    told = "" if picture.shrink is None else f", held out: shrink {picture.shrink:.1%}"
    label(figure, ax, f"Gap{told}", y="standard deviations of noise")
    said = ", ".join(f"{name} {size:.3g}" for name, size in picture.gap).replace("\n", " ")
    return Sketch(figure, f"Bars of the gap in standard deviations of the noise{told}: {said}")


def _bars(title: str, parts: Sequence[tuple[str, float]], colour: str, none: str) -> Sketch:
    """Named parts of one, the first on top; where none is visible that is said."""
    figure, ax = new_axes(NARROW, _OVERVIEW, left=_NAMES)
    places = np.arange(len(parts))[::-1]
    bars = ax.barh(places, [part for _, part in parts], 0.7, color=colour)
    ax.bar_label(bars, [f"{part:.0%}" if part >= _VISIBLE else "" for _, part in parts], fontsize=8, padding=2)
    ax.set_yticks(places, [_elided(name) for name, _ in parts], fontsize=8)
    ax.set_ylim(len(parts) - max(len(parts), _FEWEST) - 0.6, len(parts) - 0.4)
    ax.set_xlim(0, 1.32)  # room for the number beside a bar of all
    ax.set_xticks([0.0, 0.5, 1.0], ["0 %", "50 %", "100 %"])
    visible = [(name, part) for name, part in parts if part >= _VISIBLE]
    if not visible:
        ax.text(0.5, 0.5, none.replace(" the ", "\nthe ", 1), ha="center", va="center", transform=ax.transAxes)
    label(figure, ax, title)
    said = ", ".join(f"{name} {part:.0%}" for name, part in visible)
    return Sketch(figure, f"Bars. {title}: {said or none}")


def _view(view: View, after: str, span: tuple[float, float], width: float) -> Sketch:
    figure, ax = new_axes(width, _VIEW, ("before", after), left=_NUMBERS)
    _dots(ax, view.x, view.before, VERMILION, "before")
    if after:
        _dots(ax, view.x, view.after, BLUE, after)
    ax.set_ylim(*span)
    ax.locator_params(axis="x", nbins=5)
    ax.grid(alpha=0.3)
    label(figure, ax, _elided(_short(view.channel), 40), view.quantity, f"residual, {view.unit}", scale=6)
    compared = f"before and {after}" if after else "before"
    said = (
        f"Residuals of {view.channel} over {view.quantity}, {compared}, from {span[0]:.3g} to {span[1]:.3g} {view.unit}"
    )
    return Sketch(figure, said)


def _dots(ax: Axes, x: Array, y: Array, colour: str, name: str) -> None:
    ax.plot(x, y, ".", ms=1.6, color=colour, label=name)


def _span(views: Sequence[View]) -> tuple[float, float]:
    """Range of all residuals of a channel with a margin, the same for each picture of it."""
    values = np.concatenate([part for view in views for part in (view.before, view.after)])
    told = values[np.isfinite(values)]
    low, high = (float(told.min()), float(told.max())) if len(told) else (0.0, 0.0)
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _short(channel: str) -> str:
    return channel.split("/", 2)[-1].replace("/samples", "")


def _elided(name: str, longest: int = _LONGEST) -> str:
    return name if len(name) <= longest else f"{name[: longest - 1]}…"
