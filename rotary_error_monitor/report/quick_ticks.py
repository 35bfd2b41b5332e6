"""Ticks of axes drawn with one tick an axis, put at all places: the drawing library makes five objects for each tick."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import NullLocator

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
        axis = self._axis
        places = axis.get_majorticklocs()
        names = axis.major.formatter.format_ticks(places)
        if axis.major.formatter.get_offset():  # its place depends on the names, and the library knows it
            axis.set_visible(True)
            axis.draw(renderer)
            axis.set_visible(False)
            return
        low, high = np.sort(axis.get_transform().transform(np.array(axis.get_view_interval())))
        at = axis.get_transform().transform(np.asarray(places, float))
        beyond = _ROUNDING * (high - low)
        seen = np.flatnonzero((at >= low - beyond) & (at <= high + beyond))
        draw = self._draw_together if _is_straight(axis) else self._draw_each
        draw(renderer, np.asarray(places, float)[seen], [names[k] for k in seen])
        axis.label.draw(renderer)

    def _draw_each(self, renderer: RendererBase, places: np.ndarray, names: list[str]) -> None:
        """One after another, as on a circle."""
        (tick,) = self._axis.get_major_ticks(1)
        for place, name in zip(places, names, strict=True):
            tick.update_position(place)
            tick.label1.set_text(name)
            tick.draw(renderer)

    def _draw_together(self, renderer: RendererBase, places: np.ndarray, names: list[str]) -> None:
        (tick,) = self._axis.get_major_ticks(1)
        along = 0 if self._axis is self._axis.axes.xaxis else 1
        across = np.tile([0.0, 1.0, np.nan], len(places))
        for line, here, there in (
            (tick.gridline, np.repeat(places, 3), across),
            (tick.tick1line, places, np.zeros(len(places))),
        ):
            if line.get_visible():
                before = line.get_data()
                line.set_data(*(here, there)[:: 1 - 2 * along])
                line.draw(renderer)
                line.set_data(*before)
        text = tick.label1
        for place, name in zip(places, names, strict=True):
            (text.set_y if along else text.set_x)(place)
            text.set_text(name)
            text.draw(renderer)
