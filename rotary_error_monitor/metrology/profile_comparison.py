"""A spliced profile against one that was measured directly (Zhou et al. 2023, Section 2.2 and Figure 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.profile_range import symmetric_root
from rotary_error_monitor.metrology.splicing import SplicedProfile

POINTS = 101
"""Positions at which two profiles are compared: the largest difference of curves of a few waves is found to 1 %."""

DRAWS = 4000
"""Simulated differences: a tail probability of 5 % is known to 0.35 % by them."""

LEAST_COMMON = 0.5
"""Part of the longer profile that the two have in common at least: what a line takes off depends on what is covered."""


@dataclass(frozen=True)
class ProfileComparison:
    """The difference of two profiles of one axis, the line of least squares through it taken off.

    Attributes:
        positions: (n,) that both cover, m.
        first, second: (n,) either profile about its own least squares line there, m.
        difference: (n,) first minus second, m.
        uncertainty: (n,) standard uncertainty of `difference`, m.
        largest: of the absolute differences, m, and where, m.
        bound: what `largest` stays below in 95 of 100 comparisons of one and the same curve, m.
        probability: of so large a difference of one and the same curve.
    """

    positions: Array
    first: Array
    second: Array
    difference: Array
    uncertainty: Array
    largest: float
    at: float
    bound: float
    probability: float


def compare_profiles(
    first: SplicedProfile, second: SplicedProfile, extra: tuple[float, float] = (0.0, 0.0)
) -> ProfileComparison:
    """Two profiles of one axis, each known with its covariance.

    `extra` is a standard uncertainty (m) of each that its covariance has not in it and that differs from point to
    point, such as what lies between readings. The distribution of the largest difference is simulated (a fixed seed).

    Raises:
        InputError: they have less than half of the longer one in common.
    """
    low = max(float(each.positions[0]) for each in (first, second))
    high = min(float(each.positions[-1]) for each in (first, second))
    longest = max(float(np.ptp(each.positions)) for each in (first, second))
    if high - low < LEAST_COMMON * longest:
        raise InputError(
            f"the two profiles have {max(0.0, high - low):g} m in common, of {longest:g} m; at least half is needed: "
            "do both count positions from the same zero of the same axis?"
        )
    x = np.linspace(low, high, POINTS)
    level = _levelling(x)
    curves, covariance = [], np.zeros((POINTS, POINTS))
    for profile, further in zip((first, second), extra, strict=True):
        at = _interpolation(x, profile.positions)
        curves.append(level @ at @ profile.profile)
        covariance += at @ profile.covariance @ at.T + further**2 * np.eye(POINTS)
    difference, spread = curves[0] - curves[1], level @ covariance @ level.T
    drawn = np.abs(np.random.default_rng(0).normal(size=(DRAWS, POINTS)) @ symmetric_root(spread)).max(axis=1)
    worst = int(np.argmax(np.abs(difference)))
    largest = float(abs(difference[worst]))
    return ProfileComparison(
        positions=x,
        first=curves[0],
        second=curves[1],
        difference=difference,
        uncertainty=np.sqrt(np.maximum(np.diag(spread), 0.0)),
        largest=largest,
        at=float(x[worst]),
        bound=float(np.quantile(drawn, 0.95)),
        probability=float((1 + (drawn >= largest).sum()) / (1 + DRAWS)),
    )


def _levelling(x: Array) -> Array:
    """(n, n) matrix that takes the line of least squares off values at x (n,)."""
    line = np.stack([np.ones_like(x), x - x.mean()], axis=1)
    return np.asarray(np.eye(x.size) - line @ np.linalg.pinv(line), dtype=np.float64)


def _interpolation(x: Array, nodes: Array) -> Array:
    """(n, m) matrix of linear interpolation from rising nodes (m,) to x (n,) within them."""
    left = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    share = (x - nodes[left]) / (nodes[left + 1] - nodes[left])
    matrix = np.zeros((x.size, nodes.size))
    rows = np.arange(x.size)
    matrix[rows, left], matrix[rows, left + 1] = 1 - share, share
    return matrix
