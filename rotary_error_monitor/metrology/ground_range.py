"""How flat a ground workpiece may become whose compensation is as uncertain as the curves that it follows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.profile_range import DRAWS, NORMAL_95, range_estimate

EVERY = 2
"""Of the points of a surface each way, one in so many is looked at: 10 mm of 1400 mm, less than curves are known to."""


ENDS = 2.0
"""Of what lies between the readings of a curve as much may be missed at both ends of its range."""


def level_factor(positions: Array, factor: Array, at: Array) -> Array:
    """(k, m) factor of the covariance of a curve at evenly spaced `at` (k,) about its line of least squares there, m.

    `factor` (n, m) is that at ascending `positions` (n,): the covariance is the factor times its transpose.
    """
    cut = np.stack([np.interp(at, positions, column) for column in factor.T], axis=1)
    u = at - at.mean()
    line = np.column_stack([np.full(at.size, at.size**-0.5), u / np.linalg.norm(u)])
    return np.asarray(cut - line @ (line.T @ cut), dtype=np.float64)


def uncompensated_bounds(
    curves: Sequence[Array], factors: Sequence[Array], further: Sequence[float] = (0.0, 0.0)
) -> tuple[float, float]:
    """95 % interval for the range of a surface that is the sum of two curves (n,) of its directions, m.

    About its plane it is the sum of both curves about their lines, and its range that of their ranges. Errors make the
    range of a curve larger rather than smaller: that bias is taken off (`range_estimate`). Both are independent.
    `further` is what a value of each curve may be off beside its covariance, m, at both ends of its range.
    """
    found = [range_estimate(curve, factor @ factor.T) for curve, factor in zip(curves, factors, strict=True)]
    middle = sum(each for each, _ in found)
    margin = NORMAL_95 * math.hypot(*(std for _, std in found), *(ENDS * each for each in further))
    return max(0.0, middle - margin), middle + margin


def compensated_bounds(
    surfaces: Sequence[Array], factors: Sequence[Array], further: Sequence[float] = (0.0, 0.0)
) -> tuple[float, float]:
    """95 % interval for the range of a surface (n, m) that compensation by two measured curves leaves, m.

    What was measured is taken off whatever the truth is, so that the error of each curve stays in the surface as it is,
    with its covariance: the range is that of a surface as predicted with such errors added, which are simulated (a
    fixed seed). It has no bias that were to be taken off, and mostly is larger than the range predicted.

    Args:
        surfaces: as predicted, each as probable as the others, about their planes.
        factors: (n, j) and (m, k) of the covariances of the curves about their lines, as of `level_factor`.
        further: what a value of each curve may be off beside that, m. It is not known to be there: the upper end counts
            it, from point to point, and the lower one does not.
    """
    rng = np.random.default_rng(0)
    first, second = (rng.normal(size=(DRAWS, each.shape[1])) @ each[::EVERY].T for each in factors)
    seen = [surface[::EVERY, ::EVERY] for surface in surfaces]
    low, high = np.quantile(_ranges(seen, first, second), [0.025, 0.975])
    if any(further):
        more = [each + std * rng.normal(size=each.shape) for each, std in zip((first, second), further, strict=True)]
        high = np.quantile(_ranges(seen, *more), 0.975)
    return float(low), float(high)


def _ranges(surfaces: Sequence[Array], first: Array, second: Array) -> list[float]:
    """Of surfaces in turn, with errors (d, n) and (d, m) of both curves."""
    return [
        float(np.ptp(surfaces[k % len(surfaces)] + one[:, None] + other[None, :]))
        for k, (one, other) in enumerate(zip(first, second, strict=True))
    ]
