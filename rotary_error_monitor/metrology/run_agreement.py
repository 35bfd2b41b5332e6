"""Whether repeated runs over a guideway agree with one another, and its two directions.

The stated noise of a reading is not all in which runs differ: the guideway's own repeatability, drift and reversal
come on top. They are allowed as much as machines show, `REPEATABLE` times the noise and `REVERSED` of the curve. What
differs in excess of that, such as a run with the sign of its readings turned round, is a contradiction: the mean of
such runs is no curve of anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM, ROUNDING, RepeatedRuns

REPEATABLE = 3.0
"""Standard deviation of what runs do not repeat beside the noise, in standard deviations of that."""

REVERSED = 0.25
"""Standard deviation of what the directions differ in, as a part of the curve's: a guideway's straightness comes from
its form, which both directions see."""

ANOTHER_UNIT = 1000**-0.5
"""Part of the stated noise below which the scatter is nearer to that of readings a thousand times larger: these were
in mm where the header says um, or the noise was stated in another unit."""

SHAPES = 2
"""Independent ways in which the directions differ, such as a bow and a wave: reversal is smooth, so that readings side
by side do not count one by one."""


@dataclass(frozen=True)
class Disagreement:
    """What differs by more than noise and a plausible repeatability or reversal explain.

    Attributes:
        size: root mean square, m.
        expected: the same as noise, repeatability and reversal explain it, m.
        probability: of so much by those.
        moved: how far the mean may be off by it, m.
    """

    size: float
    expected: float
    probability: float
    moved: float


def disagreeing_runs(combined: RepeatedRuns, runs: int, noise: float) -> Disagreement | None:
    """Runs of one direction against their mean; None where they agree. `runs` is how many were combined.

    The departures of a run go together, as drift does: each run counts once, not each of its readings.
    """
    freedom = runs - (1 if combined.reversal is None else 2)
    if combined.uncertainty is None or freedom < 1:
        return None
    expected = noise * math.hypot(1, REPEATABLE)
    probability = chi_square_tail(freedom * (combined.scatter / expected) ** 2, freedom)
    if probability >= FALSE_ALARM:
        return None
    return Disagreement(combined.scatter, expected, probability, combined.largest_deviation)


def scatters_too_little(combined: RepeatedRuns, noise: float) -> bool:
    """Whether repeated runs scatter by so little that readings or the stated noise must be in another unit.

    Readings that never change between runs tell no scatter: a sensor may be coarse.
    """
    least = ROUNDING * float(np.abs(combined.mean).max())
    return combined.uncertainty is not None and least < combined.scatter < ANOTHER_UNIT * noise


def disagreeing_directions(combined: RepeatedRuns, noise: float) -> Disagreement | None:
    """Forward against backward, without the line between them, which is no straightness; None where they agree."""
    if combined.reversal is None:
        return None
    difference = without_line(combined.positions, combined.reversal)
    size = float(np.sqrt(np.mean(difference**2)))
    # the difference of two means has four times the variance of half their sum
    variance = 4 * float(combined.weights.mean()) * max(noise * math.hypot(1, REPEATABLE), combined.scatter) ** 2
    curve = float(np.sqrt(np.mean(without_line(combined.positions, combined.mean) ** 2)))
    expected = math.hypot(math.sqrt(variance), REVERSED * curve)
    probability = chi_square_tail(SHAPES * (size / expected) ** 2, SHAPES)
    if probability >= FALSE_ALARM:
        return None
    return Disagreement(size, expected, probability, float(np.abs(difference).max()) / 2)


def unrepeated_doubt(combined: RepeatedRuns, noise: float) -> float:
    """What half the difference of the directions has beyond noise, m, where no run was repeated.

    Nothing then tells a reversal, which their mean takes out, from a drift in one of them, which it halves.
    """
    if combined.uncertainty is not None or combined.reversal is None:
        return 0.0
    half = without_line(combined.positions, combined.reversal) / 2
    variance = noise**2 * combined.weights
    if chi_square_tail(float(np.sum(half**2 / variance)), max(1, len(half) - 2)) >= FALSE_ALARM:
        return 0.0
    return math.sqrt(max(0.0, float(np.mean(half**2 - variance))))


def without_line(positions: Array, values: Array) -> Array:
    """Values less the line of least squares through them."""
    design = np.stack([np.ones_like(positions), positions - positions.mean()], axis=1)
    return np.asarray(values - design @ np.linalg.lstsq(design, values, rcond=None)[0])
