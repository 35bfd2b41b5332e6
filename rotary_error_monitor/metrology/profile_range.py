"""How far the straightness error of a profile may be from the true one, given the profile's covariance."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from rotary_error_monitor.arrays import Array

DRAWS = 2000
"""Simulated profiles: 95 % are 94 to 96 % by them (two standard deviations)."""

MOST_POINTS = 201
"""Points of a curve that are simulated, evenly spaced: of a wave of 20 points the range is whole to 1 %."""

NORMAL_95 = 1.96
"""Standard deviations within which a normal value lies in 95 of 100 cases."""

LONG_ORDER = 12
"""Order of polynomials up to which a curve has long waves, taken as found: as the form of a mirror may have them."""

ROUGHNESS = np.geomspace(1e-4, 10.0, 26)
"""Short waves that are tried for the true curve, in those of the curve found (root mean square)."""

ROUNDING = 1e-9
"""Part of the largest variance below which a variance is rounding."""


def range_bounds(deviations: Array, covariance: Array, further: float = 0.0) -> tuple[float, float]:
    """95 % interval for the range of a true curve, m.

    `deviations` (n,) m, evenly spaced, about their line of least squares, were found with `covariance` (n, n) m²;
    `further` is a standard uncertainty of the range that the covariance has not in it, m. Errors make the range of a
    curve larger rather than smaller. By how much, and how it scatters, is simulated (a fixed seed) on the curve without
    what of its short waves is noise; the interval is the normal one about what was found less that bias (Davison and
    Hinkley, Bootstrap Methods and their Application, 1997, Section 5.2.1).
    """
    middle, std = range_estimate(deviations, covariance)
    margin = NORMAL_95 * math.hypot(std, further)
    return max(0.0, middle - margin), max(0.0, middle + margin)


def range_estimate(deviations: Array, covariance: Array) -> tuple[float, float]:
    """Range of a true curve without the bias of the range found, and its standard uncertainty, m; as `range_bounds`."""
    count = min(MOST_POINTS, deviations.size)
    chosen = np.unique(np.round(np.linspace(0, deviations.size - 1, count)).astype(int))
    spread = covariance[np.ix_(chosen, chosen)]
    probable = _smoothed(deviations[chosen], spread)
    drawn = np.ptp(probable + np.random.default_rng(0).normal(size=(DRAWS, count)) @ symmetric_root(spread), axis=1)
    middle = float(np.ptp(deviations)) - float(drawn.mean() - np.ptp(probable))
    return middle, float(drawn.std())


def _smoothed(values: Array, covariance: Array) -> Array:
    """(n,) values with the short waves that they most probably have; second differences of these are independent."""
    short, kernel = _waves(values.size)
    variances, vectors = np.linalg.eigh(short.T @ covariance @ short)
    possible = variances > ROUNDING * float(np.trace(covariance))  # the others cannot come of errors
    if not possible.any():
        return values
    seen, noise = vectors[:, possible], variances[possible]
    told = seen.T @ short.T @ values
    prior = _most_likely(seen.T @ kernel @ seen, noise, told)
    left = told - prior @ np.linalg.solve(prior + np.diag(noise), told)
    return np.asarray(values - short @ seen @ left, dtype=np.float64)


def _most_likely(kernel: Array, noise: Array, told: Array) -> Array:
    """Covariance of short waves with which `told` (k,) is most likely, beside its `noise` variances (k,)."""
    usual = float(told @ told) / float(np.trace(kernel))
    best, found = -np.inf, kernel
    for square in usual * ROUGHNESS**2:
        total = square * kernel + np.diag(noise)
        likelihood = -0.5 * float(told @ np.linalg.solve(total, told) + np.linalg.slogdet(total)[1])
        if likelihood > best:
            best, found = likelihood, square * kernel
    return found


def symmetric_root(covariance: Array) -> Array:
    """(n, n) whose square is the covariance, symmetric: there is one.

    Roots of eigenvectors as they come depend on their signs, and what is simulated with them on the processor.
    """
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T, dtype=np.float64)


@lru_cache(maxsize=4)
def _waves(count: int) -> tuple[Array, Array]:
    """Of n values: (n, k) orthonormal short waves, and (k, k) the covariance of their sizes.

    Second differences of all values are independent with a variance of 1.
    """
    polynomials = legendre.legvander(np.linspace(-1, 1, count), min(LONG_ORDER, count - 1))
    short = np.linalg.qr(polynomials, mode="complete")[0][:, polynomials.shape[1] :]
    root = short.T @ np.linalg.pinv(np.diff(np.eye(count), 2, axis=0))
    return short, np.asarray(root @ root.T, dtype=np.float64)
