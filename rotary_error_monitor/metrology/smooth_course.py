"""A quantity that changes steadily, from noisy readings in steps: its course, and how that may have been read wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

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


UNLIKELY = 0.01
"""Part of the likelihood of the best stiffness below which one is left out."""

EXACT = 1e-8
"""Part of the largest reading that a course may miss: double precision leaves its square of a sum of squares."""

STIFFEST = 1e10
"""Stiffness beyond which double precision holds no course of many readings: one that bends within some 300 of them."""


@dataclass(frozen=True)
class _Spline:
    """A smoothing spline of one stiffness.

    Attributes:
        weight: how likely its stiffness is, beside those of others.
        values: (n,) its expectation.
        precision: (3, n) diagonals of its inverse covariance, times the variance of a reading.
        variance: of a reading.
    """

    weight: float
    values: Array
    precision: Array
    variance: float

    @property
    def covariance(self) -> Array:
        """(n, n)."""
        factor = cholesky_banded(self.precision, lower=True)
        return np.asarray(self.variance * cho_solve_banded((factor, True), np.eye(len(self.values))), np.float64)


@dataclass(frozen=True)
class SmoothCourse:
    """What is known of a course at n readings.

    Attributes:
        values: (n,) the likeliest spline.
        step: of a reading; 0 for none.
        splines: of the stiffnesses that it may have; none where each reading is right but for its step.
    """

    values: Array
    step: float
    splines: tuple[_Spline, ...] = ()

    def ways(self, zero: float = 0.0) -> Array:
        """(n, k) in which it may differ from `values`, independent, each by one standard deviation.

        First, if either can be, how an instrument cuts its readings off with a zero of a standard uncertainty, then
        what noise leaves open, the largest first.
        """
        off = float(np.hypot(zero, self.step / 2))
        return np.hstack([np.full((len(self.values), 1 if off else 0), off), self._left_open])

    @cached_property
    def _left_open(self) -> Array:
        """How far each spline is from the likeliest, and what it leaves open itself."""
        count = len(self.values)
        if not self.splines:
            return np.zeros((count, 0))
        apart = np.column_stack([np.sqrt(each.weight) * (each.values - self.values) for each in self.splines])
        if count <= ALL_AT_ONCE:
            covariance = apart @ apart.T
            for each in self.splines:
                covariance += each.weight * each.covariance
            squares, ways = np.linalg.eigh(covariance)
            sizes = np.sqrt(np.maximum(squares, 0.0))
            return np.asarray((ways * sizes)[:, : -MOST_WAYS - 1 : -1], np.float64)
        own = [np.sqrt(each.weight * each.variance) * _ways_by_lanczos(each.precision) for each in self.splines]
        ways, sizes, _ = np.linalg.svd(np.hstack([apart, *own]), full_matrices=False)
        return np.asarray((ways * sizes)[:, :MOST_WAYS], np.float64)


def smooth_course(readings: Array, loudest: float, step: float | None = None) -> SmoothCourse:
    """Course behind readings: smoothing splines, each as likely as the readings make its stiffness (Wahba 1983).

    Readings that repeat share their rounding error: a run of equal ones counts as one. A few runs fit a straight line
    as well as a curve, and the likeliest stiffness alone would call the curve impossible.

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
    exact = (EXACT * float(np.abs(values).max())) ** 2
    freedom, least = max(len(lengths) - 2, 1), max(step**2 / 12, exact, float(np.finfo(np.float64).tiny))
    found: list[_Spline] = []
    for stiffness in np.geomspace(1e-4, min(float(count) ** 4, STIFFEST), TRIALS):
        precision = course_precision(weights, stiffness)
        factor = cholesky_banded(precision, lower=True)
        course = cho_solve_banded((factor, True), weights * values)
        left = max(float(np.sum(weights * values * (values - course))), 0.0)
        variance = float(np.clip(left / freedom, least, max(loudest**2, least)))
        surprise = freedom * np.log(variance) + left / variance
        surprise += 2 * float(np.sum(np.log(factor[0]))) - (count - 2) * np.log(stiffness)
        found.append(_Spline(-surprise / 2, begin + course, precision, variance))
    best = max(found, key=lambda each: each.weight)
    likely = [replace(each, weight=np.exp(each.weight - best.weight)) for each in found]
    likely = [each for each in likely if each.weight > UNLIKELY]
    total = sum(each.weight for each in likely)
    return SmoothCourse(best.values, step, tuple(replace(each, weight=each.weight / total) for each in likely))


def _ways_by_lanczos(band: Array) -> Array:
    """(n, k) ways of the largest variance, by a precision of diagonals (3, n); of many rows all at once take too long.

    The time for all grows with the cube of their number, by the Lanczos method about zero in proportion to it.
    """
    from scipy.sparse import dia_array  # loads for a while
    from scipy.sparse.linalg import LinearOperator, eigsh

    count = band.shape[1]
    factor = cholesky_banded(band, lower=True)
    inverse = LinearOperator((count, count), lambda right: cho_solve_banded((factor, True), right))
    matrix = dia_array((band, -np.arange(len(band))), shape=(count, count))
    precisions, ways = eigsh(matrix, MOST_WAYS, sigma=0.0, OPinv=inverse, v0=np.ones(count))
    return np.asarray(ways / np.sqrt(precisions), np.float64)


def course_precision(weights: Array, stiffness: float) -> Array:
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
