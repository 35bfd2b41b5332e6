"""What a temperature may be while nobody reads it."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array

UNKNOWN_WARMING = 3.0
"""Standard uncertainty of a warming, K, while nobody measures it."""

UNKNOWN_COURSES = 4
"""Powers of time from none to the third: a shop warms, levels off and cools again over a recording; what changes faster
than that does not get into a body of iron."""


def unknown_warming(passed: Array) -> Array:
    """(n, 4) courses of one standard uncertainty each, K: powers of the part of a recording that has passed (n,)."""
    powers = np.arange(UNKNOWN_COURSES)
    return np.asarray(UNKNOWN_WARMING * (2 * passed[:, None] - 1) ** powers, np.float64)
