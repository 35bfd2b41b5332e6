"""How much louder noise is over some degrees of the circle than from sample to sample, as filtered noise is.

What an effect does comes again at every turn; what turns do not share is noise, also where successive samples err
alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.gap.p_values import log_chi_square_tail

MOST_TURNS = 100
"""Parts of a recording that are held against one another, a turn or more each; they tell a variance to 14 %."""

OCTAVES = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16))
"""Orders of the radius, from and to, that are as loud as one another: coloured noise hardly changes in an octave."""

BY_CHANCE = 0.01
"""Rate at which white noise is taken for louder at one octave or another."""


def loudest_octave(signals: Complex, cells: NDArray[np.intp]) -> float:
    """Variance of noise in the octave where it is loudest, in variances of white noise; 1 if it is louder in none.

    Args:
        signals: (n,) samples in the order in which they were taken.
        cells: (n,) number of the cell of the circle in which each is: what is left of its mean is noise.
    """
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.angle(signals[1:] * np.conj(signals[:-1]))))])
    turns = min(int(travel[-1] / (2 * np.pi)), MOST_TURNS)
    if turns < 2:
        return 1.0  # of one turn nothing tells noise from what would come again
    part = np.minimum((travel * turns / travel[-1]).astype(np.intp), turns - 1)
    count = np.bincount(cells)[cells]
    left = np.abs(signals) - (np.bincount(cells, np.abs(signals)) / np.bincount(cells))[cells]
    left = np.where(count > 1, left / np.sqrt(np.maximum(1 - 1 / count, 0.5)), 0.0)
    left -= (np.bincount(part, left, turns) / np.maximum(np.bincount(part, minlength=turns), 1))[part]
    return _loudest(left, np.angle(signals), part, turns)


def _loudest(left: Array, phase: Array, part: NDArray[np.intp], turns: int) -> float:
    """The same of what is left (n,), at phases (n,), rad, in each of the turns."""
    total, loudest = float(left @ left), 1.0
    if total <= 0:
        return 1.0
    for low, high in OCTAVES:
        orders = np.arange(low, high + 1)
        sums = [[np.bincount(part, left * f(k * phase), turns) for f in (np.cos, np.sin)] for k in orders]
        dof = 2.0 * turns * len(orders)
        level = 2 * float(np.sum(np.square(sums))) / (total * 2 * len(orders))
        if log_chi_square_tail(level * dof, dof) < np.log(BY_CHANCE / len(OCTAVES)):
            loudest = max(loudest, level)
    return loudest
