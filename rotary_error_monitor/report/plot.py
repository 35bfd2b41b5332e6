"""Figures that belong to nobody but their holder: no window, nothing shown, nothing kept by the drawing library."""

from __future__ import annotations

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rotary_error_monitor.files import write_whole
from rotary_error_monitor.report.drawn import INCH


class Plot(Figure):
    """A figure that a notebook shows where it is the result of a cell, whether it was told to draw inline or not."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        buffer = io.BytesIO()
        # `savefig` would lay everything out and draw it twice
        FigureCanvasAgg(self).print_png(buffer)  # type: ignore[no-untyped-call]  # matplotlib has no types here
        width, height = self.get_size_inches()
        return buffer.getvalue(), {"width": round(width * INCH), "height": round(height * INCH)}


def save(figure: Figure, path: Path, *, dpi: int = 110) -> None:
    """Write a figure with so many dots an inch, in the format that the file's name ends in: whole, or not at all.

    Raises:
        InputError: it cannot be written.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix.lower().removeprefix("."), dpi=dpi)
    write_whole(path, buffer.getvalue())
