"""The noise that readings show by themselves, whatever they are of."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array

MEDIAN_OF_DIFFERENCES = 0.954
"""Median magnitude of the difference of two normal numbers, over their standard deviation."""


def noise_of(readings: Array) -> Array:
    """(k,) standard deviation of white noise in readings (n, k), by how neighbours differ; 0 of a single reading.

    A signal that changes little between two readings has no part in it, nor have a few large differences.
    """
    if len(readings) < 2:
        return np.zeros(readings.shape[1])
    return np.asarray(np.median(np.abs(np.diff(readings, axis=0)), axis=0) / MEDIAN_OF_DIFFERENCES, np.float64)
