"""The noise that readings show by themselves, whatever they are of.

Nothing of scipy: the nodes of a cell read this.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from rotary_error_monitor.arrays import Array

MEDIAN_OF_ABSOLUTE_NORMAL = NormalDist().inv_cdf(0.75)
"""Median magnitude of a normal number over its standard deviation."""

BESIDE_LINE = float(np.sqrt(1.5))
"""Standard deviation of how white noise departs from the line between its neighbours, over its own."""


def spread_of(values: Array) -> Array:
    """(k,) standard deviation of values (n, k) about zero, were they normal: half lie within the median."""
    return np.asarray(np.median(np.abs(values), axis=0) / MEDIAN_OF_ABSOLUTE_NORMAL, np.float64)


def noise_of(readings: Array) -> Array:
    """(k,) standard deviation of white noise in readings (n, k), by how neighbours differ; 0 of a single reading.

    A signal that changes little between two readings has no part in it, nor have a few large differences.
    """
    if len(readings) < 2:
        return np.zeros(readings.shape[1])
    return np.asarray(spread_of(np.diff(readings, axis=0)) / np.sqrt(2.0), np.float64)


def noise_beside_line(values: Array) -> Array:
    """(k,) standard deviation of white noise in readings (n, k), by how they depart from the line between neighbours.

    Not less than the smallest difference of two readings: an instrument that shows whole steps moves by one.
    """
    if len(values) < 3:
        return np.zeros(values.shape[1])
    off = spread_of(values[1:-1] - (values[:-2] + values[2:]) / 2) / BESIDE_LINE
    steps = np.abs(np.diff(values, axis=0))
    least = np.min(np.where(steps > 0, steps, np.inf), axis=0)
    return np.asarray(np.maximum(off, np.where(np.isfinite(least), least, 0.0)), np.float64)
