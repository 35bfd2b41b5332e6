"""What a profile does between the stops at which it was measured, as far as the stops show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

FALSE_ALARM = 0.01
"""Probability with which noise alone shows a corner that stands out, over all intervals of a profile (Bonferroni)."""

LEAST_ALONE = 3.5
"""Standard deviations from which a corner stands out of few intervals, whose median hardly tells the deviation."""

MEDIAN_OF_SQUARE = 0.455
"""Median of a squared standard normal value."""

CORNER = 1 / 8
"""Part of a corner's change of slope times its interval that a cubic through the stops misses: between 1/16, for a
corner at a stop, and 3/16, for one midway."""

CORNER_STOPS = 6
"""Stops that tell a corner in the middle interval from a cubic: five unknowns, and one to spare."""


@dataclass(frozen=True)
class Unresolved:
    """What a profile does between its stops.

    Attributes:
        square: sum of its squares at the stops that show it, m², by chance below zero where there is nothing.
        count: of those stops.
        largest: what is missed of a single corner, m; zero if none stands out from the rest.
    """

    square: float = 0.0
    count: int = 0
    largest: float = 0.0


def find_unresolved(
    positions: NDArray[np.float64], values: NDArray[np.float64], variances: NDArray[np.float64]
) -> Unresolved:
    """What a profile (n,) m at stops (n,) m, with variances (n,) m² of noise, does between them.

    Each stop is predicted from two neighbours to either side by a cubic, over twice the distance that lies between
    stops. What the prediction misses beyond the noise is detail that stops at this distance do not resolve. A single
    corner is looked for in each interval but the two at either end. A wave that comes back at every stop stays unseen.
    At least three stops show detail, six a corner.
    """
    order = np.argsort(positions)
    x, y, noise = positions[order], values[order], variances[order]
    reach = 2 if len(x) >= CORNER_STOPS else 1
    if len(x) < 2 * reach + 1:
        return Unresolved()
    offsets = [k for k in range(-reach, reach + 1) if k]
    middle = np.arange(reach, len(x) - reach)
    missed, variance = y[middle], noise[middle]
    for k in offsets:
        weight = np.ones(len(middle))
        for other in offsets:
            if other != k:
                weight = weight * (x[middle] - x[middle + other]) / (x[middle + k] - x[middle + other])
        missed = missed - weight * y[middle + k]
        variance = variance + weight**2 * noise[middle + k]
    return Unresolved(float((missed**2 - variance).sum()), len(middle), _largest_corner(x, y))


def _largest_corner(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """What a cubic misses of the largest corner between ascending stops (n,), m; zero if none stands out."""
    if len(x) < CORNER_STOPS:
        return 0.0
    at = np.arange(len(x) - CORNER_STOPS + 1)[:, None] + np.arange(CORNER_STOPS)
    width = x[at[:, 3]] - x[at[:, 2]]
    u = (x[at] - (x[at[:, 2]] + x[at[:, 3]])[:, None] / 2) / width[:, None]
    design = np.stack([np.ones_like(u), u, u**2, u**3, np.abs(u) / 2], axis=2)
    weights = np.linalg.pinv(design)[:, 4]
    change = (weights * y[at]).sum(axis=1)  # of slope, times the interval
    rest = float(np.median(change**2)) / MEDIAN_OF_SQUARE
    alone = change**2 > max(LEAST_ALONE, float(ndtri(1 - FALSE_ALARM / (2 * change.size)))) ** 2 * rest
    return CORNER * float(np.abs(change[alone]).max(initial=0.0))
