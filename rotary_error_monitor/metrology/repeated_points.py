"""Points of a surface that were measured more than once: their means, and what the readings scatter about them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from rotary_error_monitor.arrays import Array

SAME = 1e-6
"""Positions that round to the same multiple of this are one point, m: what a file in mm and its rounding leave."""


@dataclass(frozen=True)
class RepeatedPoints:
    """Distinct points of a surface.

    Attributes:
        first, second: (k,) positions, m.
        heights: (k,) means of the readings at each, m.
        counts: (k,) readings at each.
        scatter: standard deviation of a reading about the mean of its point, m; 0 where none was repeated.
        freedom: degrees of freedom that tell it.
    """

    first: Array
    second: Array
    heights: Array
    counts: NDArray[np.int64]
    scatter: float
    freedom: int

    @property
    def repeated(self) -> int:
        """Points that were measured more than once."""
        return int(np.count_nonzero(self.counts > 1))

    def noise_of_means(self, noise: float) -> float:
        """Root mean square over the points of the standard deviation of a mean, m, of readings with such noise, m."""
        return noise * math.sqrt(float(np.mean(1.0 / self.counts)))

    def p_value(self, noise: float) -> float:
        """Probability that readings with such noise, m, scatter as much as these or more, by chi-square."""
        if self.freedom == 0:
            return 1.0
        return float(gammaincc(self.freedom / 2, self.freedom * (self.scatter / noise) ** 2 / 2))


def combine_repeated(first: Array, second: Array, heights: Array) -> RepeatedPoints:
    """Distinct points, in the order in which they come first, of readings (n,) at positions (n,), all in m."""
    places = np.round(np.stack([first, second], axis=1) / SAME).astype(np.int64)
    _, begin, place = np.unique(places, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(begin)
    place = np.argsort(order)[place.ravel()]
    counts = np.bincount(place)
    means = np.bincount(place, heights) / counts
    freedom = len(heights) - len(counts)
    squares = float(np.sum(np.square(heights - means[place])))
    begin = begin[order]
    return RepeatedPoints(first[begin], second[begin], means, counts, math.sqrt(squares / max(freedom, 1)), freedom)
