"""How uncertain an identified machine leaves the tool's position from pose to pose: in corners more than in the middle.

The variance of the position is a sum of non-negative terms, products of squares of the axes' positions scaled to
u = -1 … 1 over the travel: polynomials in u make errors, their squares the variance. Each term is told by the letters
of its axes, one for each square: XXY is of u_X⁴ u_Y², and its size is a standard uncertainty at the end of the travel.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription

MIDDLE = "0"
"""Name of the term that is the same at all poses."""


def pose_term(machine: MachineDescription, letters: str, positions: ArrayLike) -> Array:
    """(n,) a term of the variance at positions (n, axes), m or rad, for a size of 1.

    Raises:
        InputError: the machine has no such axis.
    """
    at = np.asarray(positions, dtype=np.float64)
    product = np.ones(len(at))
    for letter in "" if letters == MIDDLE else letters:
        low, high = machine.axis(letter).travel
        product *= ((2 * at[:, machine.letters.index(letter)] - low - high) / (high - low)) ** 2
    return product


def position_uncertainty(machine: MachineDescription, terms: Mapping[str, float], positions: ArrayLike) -> Array:
    """(n,) standard uncertainty of the tool's position, root of the sum over three directions, m.

    `terms` by their letters with their sizes, m.
    """
    found = [size**2 * pose_term(machine, letters, positions) for letters, size in terms.items()]
    return np.asarray(np.sqrt(sum(found, np.zeros(len(np.asarray(positions))))), dtype=np.float64)
