"""Units in which drivers tell angles, by the names that a parameter has for them."""

from __future__ import annotations

import math

from rotary_error_monitor.units import ARCSEC

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
"""What one radian reads in each unit."""
