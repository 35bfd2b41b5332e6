"""Steps of a reference before an instrument of two axes: readings a step, their means, and what these show alone.

A step is one visit of the reference to a setting, such as a small-angle generator at +20 arcsec. Visits of the same
setting share what the reference is off by there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.error_motion import reading_variance
from rotary_error_monitor.metrology.positioning import find_outlying

SAME_SETTING = 1e-10
"""Settings nearer than this are the same, rad: a hundredth of what any reference resolves."""

FEWEST_SLOPES = 5
"""Steps from which the scatter of their slopes over time says how sure their mean is."""


GROUP = 16
"""Readings of a step that are held against one another."""

LEAST_GROUP = 3
"""The same, at least: of two nobody knows which is wrong."""


@dataclass(frozen=True)
class StepReadings:
    """Readings over k steps, in the order in which they were taken.

    Attributes:
        names: k names of steps.
        reference: (k, 2) tilt about x and y that the reference tells, rad.
        step: (n,) index of the step that a reading is of, never falling.
        readings: (n, 2) of the instrument, rad as it has them.
        times: (n,) s, None where they are not known.
        lines: (n,) line of each reading in its file, None where there is none.
    """

    names: tuple[str, ...]
    reference: Array
    step: NDArray[np.int64]
    readings: Array
    times: Array | None = None
    lines: NDArray[np.int64] | None = None

    def without(self, rows: Sequence[int]) -> StepReadings:
        """The same without some readings, of steps that have others."""
        kept = np.ones(len(self.step), dtype=np.bool_)
        kept[list(rows)] = False
        return replace(
            self,
            step=self.step[kept],
            readings=self.readings[kept],
            times=None if self.times is None else self.times[kept],
            lines=None if self.lines is None else self.lines[kept],
        )

    @property
    def counts(self) -> Array:
        """(k,) readings of each step."""
        return np.asarray(np.bincount(self.step, minlength=len(self.names)), np.float64)

    @property
    def means(self) -> Array:
        """(k, 2) mean reading of each step."""
        return np.stack([self._mean(self.readings[:, axis]) for axis in range(2)], axis=1)

    @property
    def mean_times(self) -> Array | None:
        """(k,) s, of each step, from the middle of all."""
        if self.times is None:
            return None
        return self._mean(self.times - 0.5 * (self.times.min() + self.times.max()))

    @property
    def settings(self) -> NDArray[np.int64]:
        """(k,) number of the setting that a step is a visit of."""
        return np.asarray(
            np.unique(np.round(self.reference / SAME_SETTING), axis=0, return_inverse=True)[1], np.int64
        ).ravel()

    @property
    def directions(self) -> Array:
        """(k, 2) from which side the reference came last, along each of its axes: 1 from below, -1, 0 not known."""
        moves = np.diff(self.reference, axis=0, prepend=self.reference[:1])
        ways = np.where(np.abs(moves) > SAME_SETTING, np.sign(moves), 0.0)
        for row in range(1, len(ways)):
            ways[row] = np.where(ways[row] == 0.0, ways[row - 1], ways[row])
        return ways

    def spread(self) -> tuple[Array, int]:
        """(2,) standard deviation of a reading within a step, and its degrees of freedom; 0 of these tell nothing."""
        freedom = len(self.step) - len(self.names)
        own = self.readings - self.means[self.step]
        return np.sqrt((own**2).sum(axis=0) / max(1, freedom)), freedom

    def variances(self, noise: Array, resolution: float) -> Array:
        """(k, 2) of the mean of each step, from the noise (2,) of a reading and its resolution."""
        weights, still = 1.0 / self.counts, np.zeros(len(self.names))
        return np.stack([reading_variance(float(std), resolution, weights, still) for std in noise], axis=1)

    def slopes(self) -> tuple[Array, Array] | None:
        """(2,) drift of the readings while the reference stands, rad/s, and its standard uncertainty (2,).

        None without times, or where no step lasts. The uncertainty is the larger of what the readings scatter by and
        what the slopes of the steps scatter by: slow noise shows in these alone.
        """
        if self.times is None:
            return None
        time = self.times - self._mean(self.times)[self.step]
        weights = np.bincount(self.step, time**2, len(self.names))
        spread, freedom = self.spread()
        if weights.sum() == 0.0 or freedom < FEWEST_SLOPES:
            return None
        sums = np.stack([np.bincount(self.step, time * column, len(self.names)) for column in self.readings.T], axis=1)
        slope = sums.sum(axis=0) / weights.sum()
        variance = spread**2 / weights.sum()
        lasting = weights > 0
        if lasting.sum() >= FEWEST_SLOPES:
            off = sums[lasting] / weights[lasting, None] - slope
            scatter = (weights[lasting, None] * off**2).sum(axis=0) / ((lasting.sum() - 1) * weights.sum())
            variance = np.maximum(variance, scatter)
        return slope, np.sqrt(variance)

    def _mean(self, values: Array) -> Array:
        return np.asarray(np.bincount(self.step, values, len(self.names)) / self.counts, np.float64)


@dataclass(frozen=True)
class StrayReading:
    """A reading that stands off from the others of its step.

    Attributes:
        row: of the reading, from 0.
        axis: 0 of the tilt about x, 1 about y.
        excess: distance from the median of its step, rad.
        ratio: that over the robust standard deviation of all readings.
    """

    row: int
    axis: int
    excess: float
    ratio: float


def find_stray_readings(steps: StepReadings, *, false_alarm: float) -> tuple[StrayReading, ...]:
    """Readings too far from the median of their step, as `find_outlying`; farthest first, each once.

    A mean of three takes a third of what is wrong with one, and the scatter that it makes hides that.
    """
    begin = np.concatenate([[0], np.flatnonzero(np.diff(steps.step)) + 1, [len(steps.step)]])
    # of a step that stood long its parts are looked at, which turbulence and drift move by less
    groups = [range(k, min(k + GROUP, last)) for first, last in pairwise(begin) for k in range(first, last, GROUP)]
    rows = np.full((len(groups), max(map(len, groups))), -1)
    for row, group in zip(rows, groups, strict=True):
        row[: len(group)] = group
    found: dict[int, StrayReading] = {}
    for axis in range(2):
        values = np.where(rows >= 0, steps.readings[rows, axis], np.nan)
        values[(rows >= 0).sum(axis=1) < LEAST_GROUP] = np.nan
        for each in find_outlying([(1, values)], false_alarm=false_alarm / 2):
            stray = StrayReading(int(rows[each.target, each.cycle]), axis, each.excess, each.ratio)
            found[stray.row] = max(found.get(stray.row, stray), stray, key=lambda one: one.ratio)
    return tuple(sorted(found.values(), key=lambda stray: -stray.ratio))
