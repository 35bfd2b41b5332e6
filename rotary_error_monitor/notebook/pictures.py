"""Figures that stand together in a page, as a notebook has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:  # what draws takes long to load
    from rotary_error_monitor.report.drawing import Sketch
    from rotary_error_monitor.report.plot import Plot


class Figures(Sequence["Plot"]):
    """Figures of matplotlib, to be changed and saved one by one; a cell whose result they are shows them all.

    Printed, they say what they show.
    """

    __slots__ = ("_rows",)

    def __init__(self, rows: Iterable[Sequence[Sketch]]) -> None:
        self._rows = tuple(tuple(row) for row in rows)

    @property
    def _all(self) -> list[Sketch]:
        return [each for row in self._rows for each in row]

    def __len__(self) -> int:
        return len(self._all)

    @overload
    def __getitem__(self, number: int) -> Plot: ...

    @overload
    def __getitem__(self, number: slice) -> list[Plot]: ...

    def __getitem__(self, number: int | slice) -> Plot | list[Plot]:
        return [each.figure for each in self._all][number]

    def __repr__(self) -> str:
        return "\n".join(each.alt for each in self._all)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """The same PNG as a command writes of them, and the size at which it is shown."""
        from rotary_error_monitor.report.drawing import drawn, tiled
        from rotary_error_monitor.report.drawn import Drawn

        png = tiled([[drawn(*each) for each in row] for row in self._rows])
        width, height = Drawn(png, repr(self)).size
        return png, {"width": width, "height": height}
