"""How far the straightness error of a profile may be from the true one, given the profile's covariance."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]

DRAWS = 2000
"""Simulated profiles: 95 % are 94 to 96 % by them (two standard deviations)."""

MOST_POINTS = 201
"""Points of a curve that are simulated, evenly spaced: of a wave of 20 points the range is whole to 1 %."""

ROUGHNESS = np.geomspace(1e-3, 1e2, 21)
"""Second differences that are tried for the true curve, in those of the curve found (root mean square): smaller where
noise has made these larger, and larger where they go together, as those of a bow do."""

ROUNDING = 1e-12
"""Part of the sum of variances that keeps a covariance regular in spite of rounding."""


def range_bounds(deviations: Array, covariance: Array, further: float = 0.0) -> tuple[float, float]:
    """95 % interval for the range of a true curve, m.

    `deviations` (n,) m, evenly spaced, about their line of least squares, were found with `covariance` (n, n) m²;
    `further` is a standard uncertainty of the range that the covariance has not in it, m. Errors of a curve make its
    range larger rather than smaller. How much is simulated (a fixed seed) on the curve as it most probably is, which is
    smoother than the one found: a bootstrap on a smoothed curve, its interval reversed about what was found (Davison,
    Hinkley, Bootstrap Methods and their Application, 1997, Sections 3.4 and 5.2.1).
    """
    count = min(MOST_POINTS, deviations.size)
    chosen = np.unique(np.round(np.linspace(0, deviations.size - 1, count)).astype(int))
    spread = covariance[np.ix_(chosen, chosen)]
    values, vectors = np.linalg.eigh(spread)
    kept = values > values.max(initial=0.0) * ROUNDING
    probable = _smoothed(deviations[chosen], spread, int(kept.sum()))
    roots = vectors[:, kept] * np.sqrt(values[kept])
    rng = np.random.default_rng(0)
    drawn = np.ptp(probable + rng.normal(size=(DRAWS, roots.shape[1])) @ roots.T, axis=1) - np.ptp(probable)
    low, high = np.quantile(drawn + further * rng.normal(size=DRAWS), [0.025, 0.975])
    found = float(np.ptp(deviations))
    return max(0.0, found - float(high)), max(0.0, found - float(low))


def _smoothed(values: Array, covariance: Array, rank: int) -> Array:
    """(n,) the smoothest curve that the errors of `covariance`, of so many independent ones, explain the rest of.

    Second differences of the true curve are taken to be independent; their size is the smallest with which what is
    left has no larger chi-square than its degrees of freedom (discrepancy principle: Morozov 1966). What is a line
    stays out, which neither values nor second differences tell.
    """
    bent, kernel = _rough(values.size)
    told, spread = bent.T @ values, bent.T @ covariance @ bent
    usual = float(np.mean(np.diff(values, 2) ** 2))
    for square in usual * ROUGHNESS**2:
        total = square * kernel + spread
        total += ROUNDING * np.trace(total) * np.eye(told.size)
        solved = cho_solve(cho_factor(total), told)
        if solved @ spread @ solved <= rank:
            return np.asarray(square * bent @ (kernel @ solved), dtype=np.float64)
    return values


@lru_cache(maxsize=4)
def _rough(count: int) -> tuple[Array, Array]:
    """Of n values: (n, n - 2) orthonormal curves that hold no line, and (n - 2, n - 2) the covariance of their sizes.

    Second differences are independent with a variance of 1.
    """
    second = np.diff(np.eye(count), 2, axis=0)
    bent = np.linalg.qr(second.T)[0]
    root = bent.T @ np.linalg.pinv(second)
    return bent, np.asarray(root @ root.T, dtype=np.float64)
