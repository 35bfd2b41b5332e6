"""Temperatures that were not read, or cannot be so: which, and what they may be meanwhile."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array

UNKNOWN_WARMING = 3.0
"""Standard uncertainty of a warming, K, while nobody measures it."""

UNKNOWN_COURSES = 4
"""Powers of time from none to the third: a shop warms, levels off and cools again over a recording; what changes faster
than that does not get into a body of iron."""

COURSES_OF_AN_HOUR = 8
"""Polynomials of time over which a temperature may go while a machine is measured: an air conditioning warms and cools
it once or twice."""


def believed_readings(read: Array, limits: tuple[float, float]) -> tuple[Array, str]:
    """Readings (n,) of a thermometer, °C, without those beyond its limits, as 85 °C of one just switched on.

    Returns:
        (n,) with nan where nothing was read that is believed, and a sentence about what was not, else empty.
    """
    present, (low, high) = np.isfinite(read), limits
    beyond = present & ~((low <= read) & (read <= high))
    believed = np.where(present & ~beyond, read, np.nan)
    if not beyond.any():
        return believed, ""
    return believed, (
        f"temperature: {np.count_nonzero(beyond)} of {len(read)} readings are beyond {low:g} to {high:g} °C, the first "
        f"is {read[np.flatnonzero(beyond)[0]]:.4g}; not used"
    )


def unknown_warming(passed: Array, courses: int = UNKNOWN_COURSES) -> Array:
    """(n, courses) of one standard uncertainty each, K: Legendre polynomials of time.

    Args:
        passed: (n,) part of a recording that has passed, 0 to 1.
        courses: their number.
    """
    return np.asarray(UNKNOWN_WARMING * np.polynomial.legendre.legvander(2 * passed - 1, courses - 1), np.float64)
