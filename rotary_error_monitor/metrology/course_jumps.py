"""Jumps in readings of a quantity that changes steadily: something happened to the instrument, not to what it reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.metrology.smooth_course import FEWEST, STIFFEST, TRIALS, course_precision
from rotary_error_monitor.signals.reading_noise import noise_of

BY_CHANCE = 1e-3
"""Probability that a smooth course is taken for one with a jump."""

_STANDS_OUT = 6.0
"""Standard deviations of the difference of two readings from which a jump is looked for: noise differs by as much once
in 10^9 pairs."""

_STEPS = 2.0
"""Steps of a reading that one of a slow course does not pass at once: it passes them one by one."""

MOST = 20
"""Jumps from which on readings that jump are what the instrument does."""


@dataclass(frozen=True)
class Jump:
    """One jump.

    Attributes:
        before: index of the last reading before it.
        size: by how much readings behind it are larger, in their unit.
        std: standard uncertainty of that.
    """

    before: int
    size: float
    std: float


def jumps_of(place: Array, readings: Array, loudest: float) -> list[Jump]:
    """Jumps between readings (n,) at ascending whole places (n,), in the order of time; none where they are many.

    A smoothing spline with a jump has to be likelier than one without, whatever their stiffness (Wahba 1983), by the
    number of places where a jump could be and that of the readings by which its size is known (Schwarz 1978); readings
    that repeat count as one.

    Args:
        place: of each reading on an even grid.
        readings: in their unit.
        loudest: standard deviation up to which scatter of single readings may be noise.
    """
    found: list[Jump] = []
    left = readings
    while len(found) < MOST:
        jump = _likeliest(place, left, readings, loudest)
        if jump is None:
            return sorted(found, key=lambda each: each.before)
        found.append(jump)
        left = left - jump.size * (np.arange(len(left)) > jump.before)
    return []


def _likeliest(place: Array, readings: Array, read: Array, loudest: float) -> Jump | None:
    """The jump that stands out most, if a smooth course does not do it."""
    if len(readings) < 2 * FEWEST:
        return None
    apart, step = np.diff(readings), step_of(read)
    apart = np.where(np.diff(place) == 1, apart - np.median(apart), 0.0)  # what was not read may have changed
    before = int(np.argmax(np.abs(apart)))
    noise = float(noise_of(readings[:, None])[0])
    if abs(apart[before]) <= max(_STANDS_OUT * np.sqrt(2.0) * noise, _STEPS * step):
        return None
    runs = 1 + int(np.count_nonzero(np.diff(read)))
    without, surprises, sizes, variances = _fits(place, readings, before, step, loudest)
    if 0.5 * (without.min() - surprises.min()) <= 1.5 * np.log(runs) - np.log(BY_CHANCE):
        return None
    weights = np.exp(0.5 * (surprises.min() - surprises))
    size = float(np.average(sizes, weights=weights))
    variance = float(np.average(variances + np.square(sizes - size), weights=weights))
    return Jump(before, size, float(np.sqrt(variance)))


def _fits(place: Array, readings: Array, before: int, step: float, loudest: float) -> Array:
    """(4, k) of splines of k stiffnesses: surprise without a jump and with one behind the reading `before`, its size
    and the variance of that. A surprise is minus twice the logarithm of a likelihood.
    """
    grid = np.asarray(np.rint(place - place[0]), np.intp)
    count = int(grid[-1]) + 1
    _, run, lengths = np.unique(
        np.cumsum(np.diff(readings, prepend=readings[0]) != 0), return_inverse=True, return_counts=True
    )
    weights, columns = np.zeros(count), np.zeros((count, 2))
    weights[grid] = 1 / lengths[run]  # readings that repeat share their rounding error
    columns[grid, 0] = readings - readings[0]
    columns[grid, 1] = np.arange(len(readings)) > before
    least = max(step**2 / 12, float(np.finfo(np.float64).tiny))
    freedom = max(len(lengths) - 2, 1)
    weighed = weights[:, None] * columns
    found = []
    for stiffness in np.geomspace(1e-4, min(float(count) ** 4, STIFFEST), TRIALS):
        factor = cholesky_banded(course_precision(weights, stiffness), lower=True)
        products = columns.T @ weighed - weighed.T @ cho_solve_banded((factor, True), weighed)
        size = products[0, 1] / products[1, 1]
        volume = 2 * float(np.sum(np.log(factor[0]))) - (count - 2) * np.log(stiffness)
        lefts = products[0, 0], products[0, 0] - size * products[0, 1]
        noises = [float(np.clip(left / freedom, least, max(loudest**2, least))) for left in lefts]
        surprises = [
            freedom * np.log(variance) + max(left, 0.0) / variance + volume
            for left, variance in zip(lefts, noises, strict=True)
        ]
        found.append((*surprises, size, noises[1] / products[1, 1]))
    return np.array(found).T
