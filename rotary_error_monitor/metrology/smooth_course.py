"""A quantity that changes steadily, from noisy readings in steps: its course, and how that may have been read wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded, eig_banded

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.reading_steps import step_of

FEWEST = 3
"""Readings of which a course can be told."""

MOST_WAYS = 100
"""Ways in which a course may be wrong that are told, the largest of them: what noise leaves open is smooth."""

ALL_AT_ONCE = 500
"""Readings up to which all ways are found at once."""

TRIALS = 40
"""Stiffnesses that are weighed: neighbouring ones differ by less than readings can tell."""


STIFFEST = 1e10
"""Stiffness beyond which double precision holds no course of many readings: one that bends within some 300 of them."""


@dataclass(frozen=True)
class SmoothCourse:
    """What is known of a course at n readings.

    Attributes:
        values: (n,) its expectation.
        precision: (3, n) diagonals of its inverse covariance, times the variance of a reading.
        variance: of a reading; 0 where each is right but for its step.
        step: of a reading; 0 for none.
    """

    values: Array
    precision: Array
    variance: float
    step: float

    def ways(self, zero: float = 0.0) -> Array:
        """(n, k) in which it may differ from its expectation, independent, each by one standard deviation.

        First, if either can be, how an instrument cuts its readings off with a zero of a standard uncertainty, then
        what noise leaves open, the largest first.
        """
        off = float(np.hypot(zero, self.step / 2))
        return np.hstack([np.full((len(self.values), 1 if off else 0), off), self._left_open])

    @cached_property
    def _left_open(self) -> Array:
        if not self.variance:
            return np.zeros((len(self.values), 0))
        sizes, ways = _least(self.precision, min(MOST_WAYS, len(self.values)))
        return np.asarray(ways * np.sqrt(self.variance / sizes), np.float64)


def smooth_course(readings: Array, loudest: float, step: float | None = None) -> SmoothCourse:
    """Course behind readings: the smoothing spline whose stiffness is the likeliest, with its covariance (Wahba 1983).

    Readings that repeat share their rounding error: a run of equal ones counts as one.

    Args:
        readings: (n,) evenly spaced, n > 2, not a number where none was read; three were.
        loudest: standard deviation up to which scatter of single readings may be noise.
        step: of the readings, where these are means of several; by default the one that they show.
    """
    read, count = np.flatnonzero(np.isfinite(readings)), len(readings)
    step, begin = step_of(readings[read]) if step is None else step, readings[read[0]]
    _, run, lengths = np.unique(
        np.cumsum(np.diff(readings[read], prepend=begin) != 0), return_inverse=True, return_counts=True
    )
    weights, values = np.zeros(count), np.zeros(count)
    weights[read], values[read] = 1 / lengths[run], readings[read] - begin
    freedom, least = max(len(lengths) - 2, 1), max(step**2 / 12, np.finfo(np.float64).tiny)
    best = (np.inf, values, np.zeros((3, count)), least)
    for stiffness in np.geomspace(1e-4, min(float(count) ** 4, STIFFEST), TRIALS):
        precision = _precision(weights, stiffness)
        factor = cholesky_banded(precision, lower=True)
        course = cho_solve_banded((factor, True), weights * values)
        left = float(np.sum(weights * values * (values - course)))
        variance = float(np.clip(left / freedom, least, max(loudest**2, least)))
        surprise = freedom * np.log(variance) + left / variance
        surprise += 2 * float(np.sum(np.log(factor[0]))) - (count - 2) * np.log(stiffness)
        if surprise < best[0]:
            best = surprise, course, precision, variance
    _, course, precision, variance = best
    return SmoothCourse(begin + course, precision, variance, step)


def _least(band: Array, most: int) -> tuple[Array, Array]:
    """The least eigenvalues (most,) of a matrix of diagonals (3, n), and their vectors (n, most).

    Of many rows by the Lanczos method about zero: all at once take time with the cube of their number.
    """
    count = band.shape[1]
    if count <= ALL_AT_ONCE:
        sizes, vectors = eig_banded(band, lower=True, select="i", select_range=(0, most - 1))
    else:
        from scipy.sparse import dia_array  # loads for a while
        from scipy.sparse.linalg import LinearOperator, eigsh

        factor = cholesky_banded(band, lower=True)
        inverse = LinearOperator((count, count), lambda right: cho_solve_banded((factor, True), right))
        matrix = dia_array((band, -np.arange(len(band))), shape=(count, count))
        sizes, vectors = eigsh(matrix, most, sigma=0.0, OPinv=inverse, v0=np.ones(count))
    return np.asarray(sizes, np.float64), np.asarray(vectors, np.float64)


def _precision(weights: Array, stiffness: float) -> Array:
    """(3, n) diagonals of the inverse covariance, times the variance of a reading, of a course read with weights (n,).

    Its second differences are independent, each `1 / sqrt(stiffness)` standard deviations of a reading.
    """
    count = len(weights)
    band = np.zeros((3, count))
    band[0] = weights
    for i, weight in enumerate((1.0, -2.0, 1.0)):
        for j, other in enumerate((1.0, -2.0, 1.0)[i:]):
            band[j, i : i + count - 2] += stiffness * weight * other
    return band
