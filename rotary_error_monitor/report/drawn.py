"""A picture as it passes from who draws it to who places it in a page; what draws need not be loaded for that."""

from __future__ import annotations

import struct
from dataclasses import dataclass

DENSITY = 2
"""Dots of a picture for each that a page gives it: text stays sharp on dense screens and on paper."""

INCH = 96
"""Dots of a page in an inch (CSS)."""

_SIZE = slice(16, 24)
"""Where a PNG has its width and height."""


@dataclass(frozen=True)
class Drawn:
    """A picture.

    Attributes:
        png: its content.
        alt: what it shows, in words.
    """

    png: bytes
    alt: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height that a page gives it, pixels."""
        width, height = struct.unpack(">II", self.png[_SIZE])
        return width // DENSITY, height // DENSITY


@dataclass(frozen=True)
class Sheet:
    """Pictures in rows, and one PNG of them all.

    Attributes:
        rows: pictures that belong side by side.
        whole: PNG of all, one row below the other.
    """

    rows: tuple[tuple[Drawn, ...], ...]
    whole: bytes
