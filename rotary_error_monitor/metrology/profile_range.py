"""How far the straightness error of a profile may be from the true one, given the profile's covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWS = 4000
"""Simulated profiles: the ends of a 95 % interval are known to a thirtieth of its width by them."""

MOST_POINTS = 201
"""Points of a curve that are simulated: the extremes found among them, others evenly, a wave of 20 points still whole
to 1 %."""


def range_bounds(deviations: Array, covariance: Array, further: float = 0.0) -> tuple[float, float]:
    """95 % interval for the range of a true curve, m, whose deviations (n,) m were found with covariance (n, n) m².

    `further` is a standard uncertainty of the range that the covariance has not in it, m. Errors of a curve make its
    range larger rather than smaller. So the errors are simulated on the curve as found (a fixed seed), and the interval
    is that of the range found less what they do to it (basic bootstrap interval: Davison and Hinkley, Bootstrap Methods
    and their Application, 1997, Section 5.2.1).
    """
    chosen = np.unique(np.round(np.linspace(0, deviations.size - 1, min(MOST_POINTS, deviations.size))).astype(int))
    chosen = np.union1d(chosen, [np.argmax(deviations), np.argmin(deviations)])
    deviations, covariance = deviations[chosen], covariance[np.ix_(chosen, chosen)]
    values, vectors = np.linalg.eigh(covariance)
    kept = values > values.max(initial=0.0) * 1e-9
    roots = vectors[:, kept] * np.sqrt(values[kept])
    rng = np.random.default_rng(0)
    drawn = np.ptp(deviations + rng.normal(size=(DRAWS, roots.shape[1])) @ roots.T, axis=1)
    drawn = drawn + further * rng.normal(size=DRAWS)
    low, high = np.quantile(drawn, [0.025, 0.975])
    found = float(np.ptp(deviations))
    return max(0.0, 2 * found - float(high)), max(0.0, 2 * found - float(low))
