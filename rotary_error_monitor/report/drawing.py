"""Small pictures that a page places side by side or one below the other, as its width allows."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray
from PIL import Image

from rotary_error_monitor.report.drawn import DENSITY, INCH, Drawn
from rotary_error_monitor.report.plot import Plot
from rotary_error_monitor.report.quick_ticks import quick_ticks
from rotary_error_monitor.report.wording import power_of_ten

Picture = TypeVar("Picture")

NARROW, WIDE = 3.6, 5.45
"""Widths of a picture, inches: three narrow ones or two wide ones fill the page, one fills a telephone."""

_COLOURS = 64
"""Of a picture: a few lines, each with its soft edges. A page is a third as large as with all."""

_ALL_WHITE = 0xFFFFFFFF
"""A dot of paper: red, green, blue and opacity, a byte each."""

_COMPRESSION = 5
"""Of a PNG: 6, as usual, takes half as much time again, and all of a page are 7 % smaller."""

_SIZE, _TITLE = 9, 10
"""Of text, points."""

_BESIDE, _RIGHT, _ABOVE, _BELOW = 0.76, 0.15, 0.35, 0.52
"""Room for labels and title around axes, inches: having it found takes longer than all else."""

_NAME_BELOW, _NAME_BESIDE = 0.23, 0.17
"""Where the name of an axis begins below, and ends at the left, inches from the edge: beyond the names of its ticks."""

_ROW, _MARGIN = 0.2, 0.08
"""Height of a row of a legend, and room around title and legend, inches."""

_SIGN, _LETTER = 0.42, 0.072
"""Width of a line's sign in a legend, and of a letter, inches."""

_WHITE = 247
"""From this on a part of a colour is that of the paper: fewer colours must not make it grey."""


class Sketch(NamedTuple):
    """A picture that is not drawn yet: its figure, and what it shows, in words."""

    figure: Plot
    alt: str


def drawn(figure: Figure, alt: str) -> Drawn:
    """The picture of a figure; `alt` says what it shows."""
    renderer = _renderer(*figure.bbox.size, figure.dpi)
    renderer.clear()  # type: ignore[no-untyped-call]  # matplotlib has no types here
    with quick_ticks(figure):
        figure.draw(renderer)
    return Drawn(_png(np.asarray(renderer.buffer_rgba())), alt)  # type: ignore[no-untyped-call]


@lru_cache(maxsize=4)
def _renderer(width: float, height: float, dpi: float) -> RendererAgg:
    """What draws pictures of a size, dots: it keeps how large texts are, and pictures of a page share many."""
    return RendererAgg(width, height, dpi)  # type: ignore[no-untyped-call]  # matplotlib has no types here


def new_axes(
    width: float, height: float, names: Sequence[str] = (), *, left: float = _BESIDE, polar: bool = False
) -> tuple[Plot, Axes]:
    """Figure with one axes; sizes in inches.

    Args:
        width: of the figure.
        height: of the figure.
        names: that the legend will hold.
        left: room left of the axes.
        polar: axes of radius over angle, with their angles around them.
    """
    figure = Plot(figsize=(width, height), dpi=INCH * DENSITY)
    around = _ROW if polar else 0.0
    above = _ABOVE + around + _ROW * math.ceil(len(names) / _columns(names, width))
    place = left / width, _BELOW / height, 1 - (left + _RIGHT) / width, 1 - (_BELOW + above) / height
    ax = figure.add_axes(place, projection="polar" if polar else None)
    ax.tick_params(labelsize=_SIZE)
    return figure, ax


def go_round(ax: Axes) -> None:
    """Have the axis of angles go over a turn, 0 to 360 degrees, on a grid."""
    ax.set_xlim(0, 360)
    ax.set_xticks(range(0, 361, 60))
    ax.grid(alpha=0.3)


def label(figure: Figure, ax: Axes, title: str, x: str = "", y: str = "", scale: float = 1.0) -> None:
    """Title, names of the axes with units, and a legend if anything has a name, its markers so many times as large."""
    width, height = figure.get_size_inches()
    figure.text(_MARGIN / width, 1 - _MARGIN / height, title, fontsize=_TITLE, va="top")
    ax.set_xlabel(x, fontsize=_SIZE)
    ax.set_ylabel(y, fontsize=_SIZE)
    # a place of their own: else all ticks are laid out a second time, also for a name that is empty
    ax.xaxis.set_label_coords(0.5, _NAME_BELOW, blended_transform_factory(ax.transAxes, figure.dpi_scale_trans))
    ax.yaxis.set_label_coords(_NAME_BESIDE, 0.5, blended_transform_factory(figure.dpi_scale_trans, ax.transAxes))
    handles, names = ax.get_legend_handles_labels()
    if handles:
        order = sorted(range(len(names)), key=lambda k: isinstance(handles[k], Line2D))  # what is filled first
        handles, names = [handles[k] for k in order], [names[k] for k in order]
        figure.legend(
            handles,
            names,
            loc="upper left",
            bbox_to_anchor=(0.0, 1 - (_MARGIN + _ROW) / height),
            ncols=_columns(names, width),
            frameon=False,
            fontsize=_SIZE,
            markerscale=scale,
            handlelength=1.2,
            columnspacing=1.0,
            labelspacing=0.2,
            borderaxespad=0.0,
        )


def draw_bars(
    ax: Axes,
    places: NDArray[np.floating[Any]],
    heights: NDArray[np.floating[Any]],
    width: float,
    **style: Any,  # noqa: ANN401 (what matplotlib takes)
) -> None:
    """Draw bars (n,) from zero as one path: each by itself, as `Axes.bar` has them, takes half a millisecond."""
    edges = places[:, None] + 0.5 * width * np.array([-1, -1, 1, 1, -1])
    levels = heights[:, None] * np.array([0, 1, 1, 0, 0])
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(places)
    corners = np.column_stack([edges.ravel(), levels.ravel()])
    # `add_patch` would look for the ends of each side as if it were a curve
    ax.add_artist(PathPatch(Path(corners, codes), **style, transform=ax.transData))
    ax.update_datalim(corners)
    ax.autoscale_view()


def scale_by_powers(ax: Axes) -> None:
    """Have the ordinate logarithmic, with ticks at powers of ten alone.

    Their names are plain text, as in the tables of a page: mathematical typesetting takes longer than the picture.
    """
    ax.set_yscale("log")
    ax.minorticks_off()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(round(math.log10(value)))))


def _columns(names: Sequence[str], width: float) -> int:
    """Names of a legend side by side."""
    widths = [_SIGN + _LETTER * len(name) for name in names]
    if sum(widths) < width:
        return max(1, len(names))
    return max(1, int(width / max(widths)))


def tiled(rows: Sequence[Sequence[Drawn]]) -> bytes:
    """One PNG of all: rows one below the other, each from the left; one white dot where there is none."""
    images = [[Image.open(io.BytesIO(each.png)).convert("RGB") for each in row] for row in rows if row]
    width = max((sum(each.width for each in row) for row in images), default=1)
    sheet = Image.new("RGB", (width, sum(max(each.height for each in row) for row in images) or 1), "white")
    top = 0
    for row in images:
        left = 0
        for each in row:
            sheet.paste(each, (left, top))
            left += each.width
        top += max(each.height for each in row)
    return _png(np.asarray(sheet.convert("RGBA")))


def in_rows(pictures: Sequence[Picture], columns: int) -> list[Sequence[Picture]]:
    """Pictures in rows of so many."""
    return [pictures[k : k + columns] for k in range(0, len(pictures), columns)]


def _png(dots: NDArray[np.uint8]) -> bytes:
    """PNG of dots (height, width, 4).

    White ones, most of a picture, are told from the others at once, and for these alone colours are chosen.
    """
    height, width = dots.shape[:2]
    coloured = np.flatnonzero(np.ascontiguousarray(dots).view(np.uint32).ravel() != _ALL_WHITE)
    chosen = dots.reshape(-1, 4)[coloured, :3]
    places, palette = np.zeros(height * width, np.uint8), [255, 255, 255]
    if len(chosen):
        few = Image.fromarray(chosen[None]).quantize(_COLOURS - 1, method=Image.Quantize.FASTOCTREE)
        palette += [255 if part >= _WHITE else part for part in few.getpalette() or []]
        places[coloured] = 1 + np.asarray(few)[0]
    image = Image.frombytes("P", (width, height), places.tobytes())
    image.putpalette(palette)
    buffer = io.BytesIO()
    image.save(buffer, "png", dpi=(INCH * DENSITY,) * 2, compress_level=_COMPRESSION)
    return buffer.getvalue()
