"""The figure of a diagnosis: gap, where it lies, ranking, and residuals of the channels that matter."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rotary_error_monitor.gap.views import View
from rotary_error_monitor.report.picture import Picture

_WIDTH, _VIEW = 13.0, 3.6
"""Width of the figure, and of one view of residuals, at least, inches."""

_OVERVIEW, _ROW = 2.4, 1.9
"""Height of the axes of the overview, and of one row of residuals, inches."""

_ABOVE, _BELOW, _LEFT, _RIGHT = 0.4, 0.65, 0.9, 0.25
"""Room for titles and labels around axes, inches."""

_VISIBLE = 0.005
"""Probability that a bar shows."""

_NAMES, _GAP = 2.3, 0.3
"""Room between axes side by side: for names beside bars, and for nothing, inches."""


def draw(picture: Picture) -> bytes:
    """PNG: the gap, where it lies, the ranking, and the residuals of the channels that matter before and after."""
    shown, views = picture.channels, picture.views
    quantities = list(dict.fromkeys(view.quantity for view in views))
    # Margins are known beforehand: to have them found would take as long as a diagnosis.
    width = max(_WIDTH, _VIEW * len(quantities))
    height = _ABOVE + _OVERVIEW + _BELOW + (len(shown) * (_ROW + _GAP) + _BELOW - _GAP if shown else 0.0)
    figure = Figure(figsize=(width, height), dpi=100)
    overview = _grid(figure, (1, 3), height - _ABOVE, (_OVERVIEW, _NAMES))
    for ax, draw_part in zip(overview[0], (_draw_gap, _draw_where, _draw_ranking), strict=True):
        draw_part(ax, picture)
    if views:
        size = len(shown), len(quantities)
        axes = _grid(figure, size, height - _ABOVE - _OVERVIEW - _BELOW, (_ROW, _GAP), share=True)
        # residuals are those of the textbook forms: what departs stays in them
        after = picture.gap[1][0].replace("\n", " ") if len(picture.gap) > 2 else ""
        for view in views:
            ax = axes[shown.index(view.channel)][quantities.index(view.quantity)]
            _draw_view(ax, view, after)
        _label(axes, views, shown, quantities)
    buffer = io.BytesIO()
    # `savefig` would lay everything out and draw it twice
    FigureCanvasAgg(figure).print_png(buffer)  # type: ignore[no-untyped-call]  # matplotlib has no types here
    return buffer.getvalue()


def _grid(
    figure: Figure, size: tuple[int, int], top: float, cell: tuple[float, float], share: bool = False
) -> list[list[Axes]]:
    """Rows of axes below `top`; `cell`: height of one, and room between those side by side, all in inches."""
    wide, tall = figure.get_size_inches()
    (rows, columns), (height, between) = size, cell
    width = (wide - _LEFT - _RIGHT - (columns - 1) * between) / columns
    grid = figure.add_gridspec(
        rows,
        columns,
        left=_LEFT / wide,
        right=1 - _RIGHT / wide,
        top=top / tall,
        bottom=(top - rows * height - (rows - 1) * _GAP) / tall,
        wspace=between / width,
        hspace=_GAP / height,
    )
    return [
        list(row)
        for row in grid.subplots(squeeze=False, sharex="col" if share else False, sharey="row" if share else False)
    ]


def _label(axes: list[list[Axes]], views: Sequence[View], shown: Sequence[str], quantities: Sequence[str]) -> None:
    """Names of channels at the left, of what they are shown over below, and one legend."""
    for row, channel in zip(axes, shown, strict=True):
        unit = next(view.unit for view in views if view.channel == channel)
        row[0].set_ylabel(f"{_short(channel)}, {unit}", fontsize="small")
    for ax, quantity in zip(axes[-1], quantities, strict=True):
        ax.set_xlabel(quantity)
        ax.locator_params(axis="x", nbins=5)
        ax.tick_params(axis="x", labelsize="small")
    axes[0][-1].legend(markerscale=6, fontsize="x-small", loc="upper right")


def _draw_gap(ax: Axes, picture: Picture) -> None:
    names, sizes = zip(*picture.gap, strict=True)
    ax.bar(names, sizes, color=["#a3312a", *["#1f5fa8"] * (len(names) - 2), "#999"])
    ax.set_ylabel("gap, standard deviations of noise")
    ax.set_title("Gap" if picture.shrink is None else f"Gap, held out: shrink {picture.shrink:.1%}")


def _draw_where(ax: Axes, picture: Picture) -> None:
    shares = picture.where[::-1]
    ax.barh([_short(channel) for channel, _ in shares], [share for _, share in shares], color="#1f5fa8")
    ax.set_xlim(0, 1)
    ax.set_title("Where: share of the excess")


def _draw_ranking(ax: Axes, picture: Picture) -> None:
    rows = picture.ranking[::-1]
    ax.barh([name for name, _ in rows], [probability for _, probability in rows], color="#2a7f3f")
    ax.set_xlim(0, 1)
    ax.set_title("Which: probability")
    if all(probability < _VISIBLE for _, probability in rows):
        ax.text(0.5, 0.5, "none of the known effects", ha="center", va="center", transform=ax.transAxes)


def _draw_view(ax: Axes, view: View, after: str) -> None:
    ax.plot(view.x, view.before, ".", ms=1.5, color="#a3312a", label="before")
    if after:
        ax.plot(view.x, view.after, ".", ms=1.5, color="#1f5fa8", label=after)


def _short(channel: str) -> str:
    return channel.split("/", 2)[-1].replace("/samples", "")
