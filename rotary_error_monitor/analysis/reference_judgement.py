"""Whether differences of an estimate from a reference are as large as their stated uncertainties say, and no larger."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtrit

from rotary_error_monitor.metrology.lvdt_comparison import BOUND

Array = NDArray[np.float64]

CHANCE = 0.01
"""Largest probability that a monitor and a reference are said to disagree that are as their descriptions say, over all
directions of one comparison."""

TRUSTED = 1.3
"""By which the noise of a reference may exceed what its description states: a standard deviation by five readings, and
a data sheet seldom rests on more, is known to a third (JCGM 100:2008, Table E.1)."""


@dataclass(frozen=True)
class Variances:
    """Variance (n,) of the differences along one direction, m², in parts that behave differently over time.

    Attributes:
        estimate: of the estimate, from tick to tick.
        reference: noise of the reference.
        lasting: of what is alike at all times or in all turns: form, gain, height, slow air before an autocollimator.
    """

    estimate: Array
    reference: Array
    lasting: Array

    @property
    def std(self) -> Array:
        """(n,) standard deviation of the differences, m."""
        return np.asarray(np.sqrt(self.estimate + self.reference + self.lasting))

    def at(self, rows: NDArray[np.intp]) -> Variances:
        """The same at some of the times."""
        return Variances(self.estimate[rows], self.reference[rows], self.lasting[rows])


@dataclass(frozen=True)
class Judgement:
    """What is said of the differences along one direction.

    Attributes:
        inside: part of them that is inside their 95 % bounds.
        needed: part from which chance explains it that it is not more.
        agrees: whether the estimate agrees with the reference within the stated uncertainty.
    """

    inside: float
    needed: float
    agrees: bool


def judge_differences(
    difference: Array, variances: Variances, cluster: NDArray[np.intp], chance: float = CHANCE
) -> Judgement:
    """Hold the part inside the bounds against what it must be.

    What lasts is the same number at all times in the worst case: then the part outside is as large as at the quantile
    of that number that `chance` allows. The rest scatters; by how much, the stretches tell (Student's t).

    Args:
        difference: (n,) estimate minus reference, m.
        variances: of them.
        cluster: (n,) number of the stretch that each is in, such as its turn.
        chance: probability of a wrong word.
    """
    outside = np.abs(difference) > BOUND * variances.std
    _, number = np.unique(cluster, return_inverse=True)
    count = np.bincount(number)
    parts = np.bincount(number, weights=outside) / count
    found = float(outside.mean())
    # of a stretch with few samples the part scatters more: weights as its share of them
    weight = count / count.sum()
    degrees = max(len(count) - 1, 1)
    scatter = math.sqrt(float((weight**2 * (parts - found) ** 2).sum()) * len(count) / degrees)
    margin = float(stdtrit(degrees, 1 - 0.5 * chance)) * scatter
    needed = 1 - min(1.0, _outside(variances, 0.5 * chance) + margin)
    return Judgement(1 - found, needed, 1 - found >= needed)


def _outside(variances: Variances, chance: float) -> float:
    """Part outside the bounds where what lasts is as large as it is with that probability on either side."""
    bound = BOUND * math.sqrt(float(np.mean(variances.std**2)))
    lasting = float(ndtri(1 - 0.5 * chance)) * math.sqrt(float(np.mean(variances.lasting)))
    free = math.sqrt(float(np.mean(variances.estimate + TRUSTED**2 * variances.reference)))
    if free == 0.0:
        return float(lasting >= bound)
    return float(ndtr((-bound - lasting) / free) + ndtr((lasting - bound) / free))
