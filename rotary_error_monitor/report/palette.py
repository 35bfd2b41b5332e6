"""Colours of all pages and pictures: Okabe and Ito's (2008), told apart by people who see few colours.

Of any two the difference is more than 15 (CIE 1976, L*a*b*), also as seen without red, green or blue cones (Machado,
Oliveira and Fernandes 2009). Yellow is left out: on white it is hardly seen.
"""

from __future__ import annotations

BLUE, VERMILION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
ORANGE, SKY, BLACK, GREY = "#e69f00", "#56b4e9", "#000000", "#595959"

PALETTE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
"""All of them."""

LINES = PALETTE[:-1]
"""Colours of lines beside one another, in their order; grey is for what is only a reference."""


def colour(number: int) -> str:
    """Colour of a line by its number; from the eighth on they come again."""
    return LINES[number % len(LINES)]
