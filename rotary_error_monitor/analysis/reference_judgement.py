"""Whether differences of an estimate from a reference are as large as their stated uncertainties say, and no larger.

Two things are asked in each direction. Are single differences inside their 95 % bounds? And is their mean over the
turns, which scatter has left, within what one reading is uncertain? The first alone would pass a systematic difference
that is small beside bounds made wide by stamps of heads that may be apart, which wander and are not in a mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, ndtr, ndtri, stdtrit

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.radial_comparison import BOUND

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
        estimate: of the estimate, by its readings.
        stamps: of the estimate, by stamps of the heads that may be apart.
        reference: noise of the reference.
        lasting: of what is alike at all times or in all turns: form, gain, height, slow air before an autocollimator.
    """

    estimate: Array
    stamps: Array
    reference: Array
    lasting: Array

    @property
    def std(self) -> Array:
        """(n,) standard deviation of the differences, m."""
        return np.asarray(np.sqrt(self.estimate + self.stamps + self.reference + self.lasting))

    @property
    def reading(self) -> float:
        """Variance of one reading of both, m²."""
        return float(np.mean(self.estimate + TRUSTED**2 * self.reference))

    def at(self, rows: NDArray[np.intp]) -> Variances:
        """The same at some of the times."""
        return Variances(self.estimate[rows], self.stamps[rows], self.reference[rows], self.lasting[rows])


@dataclass(frozen=True)
class ReferenceJudgement:
    """What is said of the differences along one direction.

    Attributes:
        inside: part of them that is inside their 95 % bounds.
        needed: part from which chance explains it that it is not more.
        mean: root mean square over the angle of their mean over the turns, m.
        most: the largest such mean that is within the uncertainty of one reading and what the scatter leaves, m.
    """

    inside: float
    needed: float
    mean: float
    most: float

    @property
    def agrees(self) -> bool:
        """Whether the estimate agrees with the reference within the stated uncertainty."""
        return self.inside >= self.needed and self.mean <= self.most


def judge(
    difference: Array, variances: Variances, cluster: NDArray[np.intp], profiles: Array, chance: float = CHANCE
) -> ReferenceJudgement:
    """Hold the differences along one direction against their stated uncertainty.

    Args:
        difference: (n,) estimate minus reference, m.
        variances: of them.
        cluster: (n,) number of the stretch that each is in, such as its turn.
        profiles: (t, k) of the difference over the angle, in each whole turn, m.
        chance: probability of a wrong word.
    """
    outside = np.abs(difference) > BOUND * variances.std
    allowed = _outside(variances, 0.25 * chance) + _margin(outside, cluster, 0.25 * chance)
    mean = float(np.sqrt(np.mean(profiles.mean(axis=0) ** 2)))
    most = math.sqrt(variances.reading + _left_in_mean(profiles, variances, 0.5 * chance))
    return ReferenceJudgement(1 - float(outside.mean()), 1 - min(1.0, allowed), mean, most)


def _margin(outside: NDArray[np.bool_], cluster: NDArray[np.intp], chance: float) -> float:
    """By how much the part outside may be larger by chance, as it scatters from stretch to stretch (Student's t)."""
    _, number = np.unique(cluster, return_inverse=True)
    count = np.bincount(number)
    parts = np.bincount(number, weights=outside) / count
    weight = count / count.sum()
    degrees = max(len(count) - 1, 1)
    scatter = math.sqrt(float((weight**2 * (parts - outside.mean()) ** 2).sum()) * len(count) / degrees)
    return float(stdtrit(degrees, 1 - chance)) * scatter


def _outside(variances: Variances, chance: float) -> float:
    """Part outside the bounds where what lasts is one number, as large as it is with that probability."""
    bound = BOUND * math.sqrt(float(np.mean(variances.std**2)))
    lasting = float(ndtri(1 - 0.5 * chance)) * math.sqrt(float(np.mean(variances.lasting)))
    free = math.sqrt(variances.reading + float(np.mean(variances.stamps)))
    if free == 0.0:
        return float(lasting >= bound)
    return float(ndtr((-bound - lasting) / free) + ndtr((lasting - bound) / free))


def _left_in_mean(profiles: Array, variances: Variances, chance: float) -> float:
    """Largest mean square, m², that what scatters from turn to turn leaves in the mean, with what lasts.

    Each order scatters by itself, at worst in one phase alone. The sum of their squares is as one of chi-square with
    the degrees of freedom by Satterthwaite (1946), and the scatter is known from as many turns less one: Fisher's F.
    """
    once = float(ndtri(1 - 0.5 * chance)) ** 2  # of one number, which is the same at all angles in the worst case
    lasting = once * float(np.mean(variances.lasting))
    turns = len(profiles)
    if turns < 2:
        return lasting + once * float(np.mean(variances.stamps))
    orders = np.fft.rfft(profiles, axis=1) / profiles.shape[1]
    scatter = (np.abs(orders - orders.mean(axis=0)) ** 2).sum(axis=0) / (turns * (turns - 1))
    scatter[1:] *= 2.0
    total = float(scatter.sum())
    if total == 0.0:
        return lasting
    degrees = total**2 / float((scatter**2).sum())
    return lasting + total * float(fdtri(degrees, degrees * (turns - 1), 1 - chance))
