"""Readings that repeat: for how long they may by chance, given noise and resolution of an instrument."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SURE = 1e-9
"""Probability of a run of equal readings by chance from which the signal counts as stuck."""


def run_by_chance(noise: float, resolution: float, components: int = 1) -> float:
    """Readings of all components in a row that chance makes equal less often than `SURE`, at most a million.

    A reading repeats where the noise stays within half a step, at best with `erf(resolution / (2 sqrt(2) noise))`.
    """
    if resolution == 0.0:
        return 2.0 if noise > 0.0 else 1e6
    if noise == 0.0:
        return 1e6
    equal = math.erf(resolution / (2.0 * math.sqrt(2.0) * noise)) ** components
    if equal == 0.0:  # a step that is next to none
        return 2.0
    return min(1e6, 1.0 + math.log(SURE) / math.log(equal)) if equal < 1.0 else 1e6


def runs_of(values: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places (k,) at which the runs of equal ones of `values` (n,) begin, and their lengths (k,)."""
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    return starts, np.diff(np.append(starts, len(values)))


def longest_run(values: NDArray[np.float64]) -> tuple[int, int]:
    """Place at which the longest run of equal ones of `values` (n,), n > 0, begins, and how many these are."""
    starts, lengths = runs_of(values)
    longest = int(np.argmax(lengths))
    return int(starts[longest]), int(lengths[longest])
