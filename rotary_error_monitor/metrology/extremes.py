"""Bounds of extremes of means that are known by noisy estimates: tests of each value, inverted (hybrid resampling).

The range of estimates is larger than that of the means, by how much depends on how many means lie near its ends, which
noise hides. A range is within the bounds if means that have it would not have given as small, or as large, a range of
estimates as was found but in 2.5 % of cases. Of all means with that range the most likely ones are simulated: those
found, but what lies beyond either end is moved onto it; of a larger range than was found, the outermost two are moved
apart. So many means are held possible near the ends of a small range, and few near those of a large one (Chuang and Lai
2000, "Hybrid resampling methods for confidence intervals", Statistica Sinica 10:1, with the constrained estimate of
maximum likelihood for what is not of interest).

Bounds of two means are exact. Where half of many means are at either end, 5 % of lower bounds at 2.5 % are too high,
for means that were found between the ends are simulated there (test/metrology/test_extremes.py).

For errors that are drawn, the simulated estimate grows with the range. There is one range for each draw that just gives
what was found, and the quantiles of these are the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array

HALVINGS = 15
"""Halvings of the interval in which a push lies: 1/30000 of it is left, a hundredth of what the draws leave open."""

ROUNDING = 1e-9
"""Part of a range by which rounding may change it."""

LEAST_NOISE = 1e-4
"""Part of the mean noise variance of a draw below which a mean counts as this noisy, so that weights stay finite."""


def draw_ranges(found: Array, noise: Array, errors: Array, margin: Array) -> Array:
    """(d,) probable max(mean + margin) - min(mean - margin) of means found with errors like those drawn.

    All (d, m): means that are found, which may be the same (m,) in all draws, variances of the errors, errors drawn,
    and what each draw adds at either side.
    """
    if not noise.any():
        return np.asarray((found + margin).max(axis=1) - (found - margin).min(axis=1))
    means, weight, errors, margin = (
        _by_mean(np.broadcast_to(found, noise.shape)),
        _weights(noise),
        _by_mean(errors),
        _by_mean(margin),
    )
    upper, lower = means + margin, means - margin
    above, below, draw = _Levels.of(upper, weight), _Levels.of(-lower, weight), np.arange(len(noise))
    top, rest = above.outermost, lower.copy()
    rest[top, draw] = np.inf
    bottom = rest.argmin(axis=0)

    def moved(push: Array) -> Array:
        high, low = above.at(push), -below.at(push)
        floor, ceiling = low + margin, high - margin
        # floor and ceiling cross where a margin is wider than half the range
        result = np.where(floor > ceiling, (low + high) / 2, np.minimum(np.maximum(means, floor), ceiling))
        apart = push < 0
        result[top, draw] = np.where(apart, means[top, draw] - push / weight[top, draw], result[top, draw])
        result[bottom, draw] = np.where(apart, means[bottom, draw] + push / weight[bottom, draw], result[bottom, draw])
        return result

    def extent(each: Array) -> Array:
        return np.asarray((each + margin).max(axis=0) - (each - margin).min(axis=0))

    observed, most = extent(means), (weight * (upper - upper.min(axis=0))).sum(axis=0)
    between = errors[top, draw] - errors[bottom, draw]
    alone = between / (1 / weight[top, draw] + 1 / weight[bottom, draw])
    push = _push(lambda each: extent(moved(each) + errors), observed, alone, most)
    return extent(moved(push))


def draw_largest(found: Array, noise: Array, errors: Array, margin: Array) -> Array:
    """(d,) probable max(|mean| + margin), all else as of `draw_ranges`."""
    if not noise.any():
        return np.asarray((np.abs(found) + margin).max(axis=1))
    weight, errors, margin = _weights(noise), _by_mean(errors), _by_mean(margin)
    means = _by_mean(np.broadcast_to(found, noise.shape))
    size, sign = np.abs(means), np.where(means < 0, -1.0, 1.0)
    levels, draw = _Levels.of(size + margin, weight), np.arange(len(noise))
    top = levels.outermost

    def moved(push: Array) -> Array:
        result = np.minimum(size, np.maximum(levels.at(push) - margin, 0.0))
        result[top, draw] = np.where(push < 0, size[top, draw] - push / weight[top, draw], result[top, draw])
        return np.asarray(result * sign)

    def extent(each: Array) -> Array:
        return np.asarray((np.abs(each) + margin).max(axis=0))

    observed, most = extent(size), (weight * (size + margin)).sum(axis=0)
    alone = weight[top, draw] * sign[top, draw] * errors[top, draw]
    push = _push(lambda each: extent(moved(each) + errors), observed, alone, most)
    return extent(moved(push))


@dataclass(frozen=True)
class _Levels:
    """Values (m, d) from the largest on: sums of their weights, and of what they weigh; `outermost` is the largest."""

    total: Array
    weight: Array
    outermost: NDArray[np.int64]

    @classmethod
    def of(cls, values: Array, weight: Array) -> _Levels:
        order = np.argsort(-values, axis=0)
        sorted_weight = np.take_along_axis(weight, order, axis=0)
        total = np.cumsum(sorted_weight * np.take_along_axis(values, order, axis=0), axis=0)
        return cls(total, np.cumsum(sorted_weight, axis=0), order[0])

    def at(self, push: Array) -> Array:
        """(d,) level to which pushes down (d,) move all that lie above it, or the outermost one up if negative.

        A push is the sum of weight times way: the Lagrange multiplier of the constraint, the same at both ends.
        """
        all_above = ((self.total - push) / self.weight).max(axis=0)
        return np.asarray(np.where(push < 0, (self.total[0] - push) / self.weight[0], all_above))


def _by_mean(values: Array) -> Array:
    """(m, d) of (d, m): extremes over the first axis take a third of the time."""
    return np.ascontiguousarray(values.T)


def _weights(noise: Array) -> Array:
    """(m, d) inverse variances, of each draw 1 in the mean."""
    variance = _by_mean(noise)
    weight = 1 / np.maximum(variance, LEAST_NOISE * variance.mean(axis=0))
    return np.asarray(weight / weight.mean(axis=0))


def _push(extent: Callable[[Array], Array], observed: Array, alone: Array, most: Array) -> Array:
    """(d,) pushes, `most` at most, that give what was observed; `alone` those that do so of the outermost alone.

    No push farther out than that gives so little, so it is taken if the others allow it, and else one that is further
    in; where none is enough, the most.
    """
    outwards = np.minimum(alone, 0.0)
    allowed = extent(outwards) <= observed * (1 + ROUNDING)
    low, high = outwards, most
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        above = extent(middle) > observed
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.asarray(np.where(allowed, outwards, (low + high) / 2))
