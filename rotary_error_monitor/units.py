"""Angles and times that formulas need, and how many of the units that people read there are in those of SI."""

from __future__ import annotations

import math

TURN = 2 * math.pi
"""A whole turn, rad."""

ARCSEC = 648000 / math.pi
"""Arcseconds in a radian."""

MICRO = 1e6
"""µm in a metre, µrad in a radian."""

HOUR = 3600.0
"""Seconds in an hour."""

DIGITS = 14
"""Significant digits of a number in a table: float64 has 15 for any, of which changes of units may cost the last."""

ANGLE_UNITS = {
    "rad": 1.0,
    "deg": 180 / math.pi,
    "turn": 0.5 / math.pi,
    "gon": 200 / math.pi,
    "mrad": 1e3,
    "urad": 1e6,
    "arcmin": 10800 / math.pi,
    "arcsec": ARCSEC,
}
"""What one radian reads in each unit, by the names that parameters have for them."""


def without_rounding_error(value: float) -> float:
    """The number to `DIGITS` significant digits, for tables; zero has no sign.

    What was given in degrees or mm and came back from SI is written as it was given (30, not 29.999999999999996).
    """
    return float(f"{value:.{DIGITS}g}") + 0.0
