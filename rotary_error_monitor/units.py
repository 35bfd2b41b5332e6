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
