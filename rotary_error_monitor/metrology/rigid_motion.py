"""Error motion of a rigid rotor from any sensors that see linear combinations of it: weighted least squares."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion

LEVER = 0.1
"""Length, m, by which angles are made comparable with displacements: the size of a stage."""

SCALE = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
"""Of the components: what they are multiplied by to be displacements, m."""

_SEEN = 1e-6
"""Part of a component's direction that may lie outside of what the sensors see: an Abbe arm of 0.1 µm."""

LEAST_VARIANCE = 1e-24
"""Variance, m², below which nothing counts as known, so that what is known exactly has a weight: a picometre."""


@dataclass(frozen=True)
class Seen:
    """What p fields of sensors see of the rotor's error motion at m times.

    Each in a unit of its own, m or rad: readings are weighed by their variances, so that none has to be made like
    another.

    Attributes:
        sensitivity: (p, 6) displacement for each of exc eyc ezc (1 m) eac ebc ecc (1 rad).
        displacement: (m, p) that each sees, m or rad.
        variance: (m, p) of that, m² or rad², above 0.
    """

    sensitivity: Array
    displacement: Array
    variance: Array


def observable_components(known: Mask, sensitivity: Array) -> Mask:
    """(6,) which components are determined by what is known of them (6,) and by sensors.

    Args:
        known: components that are determined without the sensors.
        sensitivity: (p, 6) what each field sees of exc eyc ezc eac ebc ecc.
    """
    _, outside = _determined(known, sensitivity)
    return np.asarray(np.abs(outside).max(axis=1, initial=0.0) < _SEEN)


def seen_directions(sensitivity: Array) -> Array:
    """(6, r) orthonormal basis of what p sensors, of a sensitivity (p, 6), see of the components times `SCALE`."""
    basis, _ = _determined(np.zeros(len(COMPONENTS), np.bool_), sensitivity)
    return basis


def redundant_sensors(known: Mask, sensitivity: Array, owner: NDArray[np.intp] | None = None) -> Mask:
    """(s,) whether all that a sensor sees is determined without it: a fault of it alone would show (Baarda 1968).

    Args:
        known: components that are determined without the sensors.
        sensitivity: (p, 6) what each field sees of exc eyc ezc eac ebc ecc.
        owner: (p,) number of the sensor that each row is of, from 0 on; each of one of its own where left out.
    """
    owner = np.arange(len(sensitivity)) if owner is None else owner
    found = []
    for number in range(int(owner.max(initial=-1)) + 1):
        own = owner == number
        _, outside = _determined(known, sensitivity[~own])
        found.append(bool(np.abs((sensitivity[own] / SCALE) @ outside).max(initial=0.0) < _SEEN))
    return np.array(found, np.bool_)


def combine(motion: ErrorMotion, seen: Seen) -> ErrorMotion:
    """The error motion that agrees best with what is known of it and with what sensors see.

    Generalised least squares with what is known as one observation of its own covariance; without sensors it comes
    out as it went in.

    Args:
        motion: what is known without the sensors, at m times with the same `observable`.
        seen: what the sensors see at these times.
    """
    solution = _solved(motion, seen)
    hidden = ~solution.observable[0]
    solution.components[:, hidden] = 0.0
    solution.covariance[:, hidden, :] = solution.covariance[:, :, hidden] = 0.0
    return solution


def _solved(motion: ErrorMotion, seen: Seen) -> ErrorMotion:
    """As `combine`, with what is determined of the components that are not determined alone."""
    known = motion.observable[0]
    basis, outside = _determined(known, seen.sensitivity)
    count = len(motion.theta)
    information, vector = np.zeros((count, 6, 6)), np.zeros((count, 6))
    # one after another, and each time by itself: the bits of a time do not depend on how many there are
    for place, row in enumerate(seen.sensitivity / SCALE):
        information += np.outer(row, row) / seen.variance[:, place, None, None]
        vector += row * (seen.displacement[:, place] / seen.variance[:, place])[:, None]
    if known.any():
        at, scale = np.ix_(np.arange(count), known, known), SCALE[known]
        least = LEAST_VARIANCE * np.eye(len(scale))
        inverse = np.linalg.inv(motion.covariance[at] * np.outer(scale, scale) + least)
        information[at] += inverse
        vector[:, known] += (inverse @ (motion.components[:, known] * scale)[:, :, None])[:, :, 0]
    covariance = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
    components = (covariance @ vector[:, :, None])[:, :, 0] / SCALE
    covariance /= np.outer(SCALE, SCALE)
    observable = np.abs(outside).max(axis=1, initial=0.0) < _SEEN
    every = np.tile(observable, (count, 1))
    return replace(motion, components=components, observable=every, covariance=covariance)


def extend(motion: ErrorMotion, seen: Seen) -> ErrorMotion:
    """What is known, to the last bit, and what sensors add to it: arguments as `combine`.

    The components that were not known come from all together, with their covariances with what was (a consider filter,
    Schmidt 1966). A mistake in the description of a sensor then does not spoil what is known without it.
    """
    joined = combine(motion, seen)
    known = motion.observable[0]
    at = np.ix_(np.arange(len(motion.theta)), known, known)
    joined.components[:, known] = motion.components[:, known]
    joined.covariance[at] = motion.covariance[at]
    return joined


def disagreement(motion: ErrorMotion, seen: Seen) -> tuple[float, int]:
    """Chi-square by which sensors contradict one another and what is known, with its degrees of freedom.

    Arguments as `combine`, at the first of the times.
    """
    chi_square, freedom = disagreements(motion, seen)
    return float(chi_square[0]), freedom


def disagreements(motion: ErrorMotion, seen: Seen) -> tuple[Array, int]:
    """(m,) the same at each of the times."""
    joined, known = _solved(motion, seen), motion.observable[0]
    basis, _ = _determined(known, seen.sensitivity)
    found = np.zeros(len(motion.theta))
    for time in range(len(found)):
        apart = seen.displacement[time] - seen.sensitivity @ joined.components[time]
        found[time] = (apart**2 / seen.variance[time]).sum()
        if known.any():
            scale = SCALE[known]
            moved = (joined.components[time, known] - motion.components[time, known]) * scale
            covariance = motion.covariance[time][np.ix_(known, known)] * np.outer(scale, scale)
            covariance += LEAST_VARIANCE * np.eye(len(scale))
            found[time] += moved @ np.linalg.solve(covariance, moved)
    return found, int(known.sum()) + len(seen.sensitivity) - basis.shape[1]


def _determined(known: Mask, sensitivity: Array) -> tuple[Array, Array]:
    """(6, r) basis of the directions that are determined, (6, 6 - r) of the others, angles times `LEVER`."""
    rows = np.vstack([np.eye(len(COMPONENTS))[known], sensitivity / SCALE])
    _, sizes, vectors = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(sizes > _SEEN))
    return vectors[:rank].T, vectors[rank:].T
