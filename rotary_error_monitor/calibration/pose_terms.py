"""The few terms that say how uncertain an identified machine leaves the tool from pose to pose."""

from __future__ import annotations

from itertools import combinations_with_replacement, product

import numpy as np
from scipy.optimize import nnls

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.volume import Limits, sample_volume
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.pose_uncertainty import MIDDLE, pose_term

HIGHEST = 3
"""Squares of positions in a term: errors are polynomials of degree 3, and three axes share in a corner."""

MOST_CORNERS = 64
"""Corners that are looked at: all of six axes."""

INSIDE = 300
"""Poses over the volume: three for each of the 84 terms of six axes, so that none is fitted to single poses."""


def poses_of_terms(machine: MachineDescription, limits: Limits | None = None) -> Array:
    """(n, axes) poses over the working volume and in its corners, where terms are fitted."""
    bounds = [(limits or {}).get(axis.letter, axis.travel) for axis in machine.axes]
    corners = np.array(list(product(*bounds)), dtype=np.float64)
    if len(corners) > MOST_CORNERS:
        corners = np.random.default_rng(0).permutation(corners)[:MOST_CORNERS]
    return np.concatenate([sample_volume(machine, INSIDE, limits), corners])


def fit_terms(machine: MachineDescription, poses: Array, variance: Array) -> dict[str, float]:
    """Sizes of terms, m, by their letters: least squares of what each pose's variance (n,) m² is missed by, in parts.

    Corners, which are few, count as much together as all else.
    """
    letters = [MIDDLE]
    for count in range(1, HIGHEST + 1):
        letters += ["".join(each) for each in combinations_with_replacement(machine.letters, count)]
    corners = len(poses) - INSIDE
    weights = np.where(np.arange(len(poses)) < INSIDE, 1.0, np.sqrt(INSIDE / max(1, corners))) / variance
    columns = np.stack([pose_term(machine, each, poses) for each in letters], axis=1)
    sizes, _ = nnls(columns * weights[:, None], variance * weights)
    return {each: float(np.sqrt(size)) for each, size in zip(letters, sizes, strict=True) if size > 0}
