"""Ticks of an axis drawn with one of them, put at all places: the drawing library makes five objects for each tick."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import NullLocator

from rotary_error_monitor.arrays import Array

_ROUNDING = 1e-10
"""Part of an axis by which a tick may lie beyond its end, as in the drawing library."""


@contextmanager
def quick_ticks(figure: Figure) -> Iterator[None]:
    """Within this the figure draws its ticks quickly; afterwards it is as before, to be changed by whoever has it.

    Names of its axes must have a place of their own, as `drawing.label` gives them.
    """
    stand_ins = [_Ticks(axis) for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) if _is_plain(axis)]
    for each in stand_ins:
        each.begin()
    try:
        yield
    finally:
        for each in stand_ins:
            each.end()


def _is_plain(axis: Axis) -> bool:
    """Whether an axis is drawn, and has ticks of one kind alone."""
    return axis.get_visible() and isinstance(axis.get_minor_locator(), NullLocator)


def _is_straight(axis: Axis) -> bool:
    """Whether ticks, all on the usual side, differ in their place alone."""
    side = axis.get_ticks_position()  # type: ignore[attr-defined]  # of all kinds of axis
    return side in ("bottom", "left") and not isinstance(axis.axes, PolarAxes)


class _Ticks(Artist):
    """What is drawn in the place of an axis, and looks the same: its first tick, with data of all of them."""

    def __init__(self, axis: Axis) -> None:
        super().__init__()
        self._axis = axis
        # of what lies equally high, an axis is drawn last: also after the frame, which is drawn after this
        self.set_zorder(math.nextafter(axis.get_zorder(), math.inf))

    def begin(self) -> None:
        """Take the place of the axis."""
        self._axis.axes.add_artist(self)
        self._axis.set_visible(False)

    def end(self) -> None:
        """Give it back."""
        self._axis.set_visible(True)
        self.remove()

    def draw(self, renderer: RendererBase) -> None:
        """Draw ticks, their names, lines across and the name of the axis."""
        axis = self._axis
        places = np.asarray(axis.get_majorticklocs(), float)
        formatter = axis.get_major_formatter()
        names = formatter.format_ticks(list(places))
        if formatter.get_offset():  # the place of what all names share depends on them; the library knows it
            axis.set_visible(True)
            axis.draw(renderer)
            axis.set_visible(False)
            return
        low, high = np.sort(axis.get_transform().transform(np.array(axis.get_view_interval())))
        at, beyond = axis.get_transform().transform(places), _ROUNDING * (high - low)
        seen = np.flatnonzero((at >= low - beyond) & (at <= high + beyond))
        draw = self._draw_together if _is_straight(axis) else self._draw_each
        draw(renderer, places[seen], [names[k] for k in seen])
        axis.label.draw(renderer)

    def _draw_each(self, renderer: RendererBase, places: Array, names: Sequence[str]) -> None:
        """One after another, as on a circle."""
        (tick,) = self._axis.get_major_ticks(1)
        for place, name in zip(places, names, strict=True):
            tick.update_position(place)
            for text in (tick.label1, tick.label2):
                text.set_text(name)
            tick.draw(renderer)

    def _draw_together(self, renderer: RendererBase, places: Array, names: Sequence[str]) -> None:
        """All lines across as one with gaps, all marks as one, then the names."""
        (tick,) = self._axis.get_major_ticks(1)
        is_ordinate = self._axis is self._axis.axes.yaxis
        ends = np.tile([0.0, 1.0, np.nan], len(places))
        for line, along, across in (
            (tick.gridline, np.repeat(places, 3), ends),
            (tick.tick1line, places, np.zeros(len(places))),
        ):
            before = line.get_data()
            line.set_data(*((across, along) if is_ordinate else (along, across)))
            line.draw(renderer)
            line.set_data(*before)
        text = tick.label1
        for place, name in zip(places, names, strict=True):
            (text.set_y if is_ordinate else text.set_x)(place)
            text.set_text(name)
            text.draw(renderer)
