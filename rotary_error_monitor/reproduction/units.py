"""The papers' units in SI: a value divided by one is in it."""

from __future__ import annotations

import math

UM, MM = 1e-6, 1e-3
"""m."""

DEGREE, ARCSEC = math.pi / 180, math.pi / 648_000
"""rad."""
