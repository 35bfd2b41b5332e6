"""How the axis of rotation wanders over time, and with temperature (in the manner of ISO 230-3)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rotary_error_monitor.analysis.motion import SegmentFigures
from rotary_error_monitor.analysis.signals import ROTATING
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.metrology.spindle_figures import COVERAGE, DRAWS, FROM_TWICE, ErrorMotionValue

LEAST_WARMING = 0.1
"""Change of temperature from which a slope over it is told, K: thermometers of machines resolve some hundredths."""


_GENERATOR = 230_3
"""Seed: the same recording gives the same figures."""


@dataclass(frozen=True)
class Samples:
    """Something that acts on the stage: `times_ns` (n,) ns, ascending, and `values` (n,)."""

    times_ns: Times
    values: Array

    def at(self, times_ns: Times) -> Array:
        """(m,) values at timestamps (ns); beyond both ends the last one there."""
        begin = int(self.times_ns[0])
        after, known = (times_ns - begin).astype(float), (self.times_ns - begin).astype(float)
        return np.asarray(np.interp(after, known, self.values))


@dataclass(frozen=True)
class Drift:
    """Wandering of one signal.

    Attributes:
        signal: its key.
        unit: `m` or `rad`.
        times_ns: (t,) middle of each whole turn of the recording.
        means: (t,) of the signal over the turn, less that of all turns.
        range: largest less smallest of them at one speed in one direction, less what the noise of the readings adds.
        slopes: by thermometer, per K, at one and the same speed and direction; none where it hardly warmed.
    """

    signal: str
    unit: str
    times_ns: Times
    means: Array
    range: ErrorMotionValue
    slopes: Mapping[str, ErrorMotionValue]


def estimate_drifts(segments: Sequence[SegmentFigures], temperatures: Mapping[str, Samples]) -> tuple[Drift, ...]:
    """Drift of each signal in a direction that stands still, where two whole turns are at one speed in one direction.

    Means over whole turns are free of all that comes back in each turn.
    """
    keys = dict.fromkeys(f.signal for segment in segments for f in segment.signals if f.direction != ROTATING)
    return tuple(drift for key in keys for drift in _drift(key, segments, temperatures))


def _drift(key: str, segments: Sequence[SegmentFigures], temperatures: Mapping[str, Samples]) -> Iterator[Drift]:
    found = [(i, f) for i, segment in enumerate(segments) for f in segment.signals if f.signal == key]
    times = np.concatenate([f.middle_ns for _, f in found])
    means = np.concatenate([f.means for _, f in found])
    owner = np.concatenate([np.full(f.turns, i) for i, f in found])
    if all(f.turns < 2 for _, f in found):
        return
    order = np.argsort(times, kind="stable")
    times, means, owner = times[order], means[order], owner[order]
    noise = np.array([f.mean_noise for _, f in found for _ in range(f.turns)])[order]
    slopes = {
        name: slope
        for name, samples in temperatures.items()
        if (slope := _slope(means, samples.at(times), owner)) is not None
    }
    wander = _range(means, owner, noise)
    yield Drift(key, found[0][1].unit, times, means - means.mean(), wander, slopes)


def _range(means: Array, owner: NDArray[np.int64], noise: Array) -> ErrorMotionValue:
    """Largest range of means (t,), in the order of time, among those at one speed in one direction.

    Between directions and speeds lies what stands still at one speed, as a displacement by stamps that are apart does.

    Noise makes a range larger: it is extrapolated to none, as error motion values are. How far it would scatter in
    other recordings is told by the distances of means from the line through both neighbours, in which a slow drift has
    hardly a part (Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 1986); of two turns, by their difference.

    Args:
        means: of the turns.
        owner: (t,) which direction and speed each belongs to.
        noise: (t,) standard deviation of each by the readings.
    """
    order = np.argsort(owner, kind="stable")
    begins = np.flatnonzero(np.diff(owner[order], prepend=-1))

    def wander(values: Array) -> float:
        sorted_values = values[order]
        return float((np.maximum.reduceat(sorted_values, begins) - np.minimum.reduceat(sorted_values, begins)).max())

    measured = wander(means)
    variance, degrees = _scatter(means[order], owner[order])
    scatter = np.maximum(noise, math.sqrt(variance))
    generator = np.random.default_rng(_GENERATOR)
    draws = [generator.standard_normal(len(means)) for _ in range(DRAWS)]
    louder = np.array([wander(means + noise * each) for each in draws])
    others = np.array([wander(means + scatter * each) for each in draws])
    correction = min(max(FROM_TWICE * float(louder.mean() - measured), 0.0), measured)
    drawn = FROM_TWICE * float(louder.std()) / math.sqrt(DRAWS)
    factor = float(stdtrit(degrees, 0.975)) / COVERAGE
    # the correction may be wrong by as much as itself: rectangular (JCGM 100:2008, 4.3.7)
    parts = (factor * float(others.std()), correction / math.sqrt(3), drawn)
    return ErrorMotionValue(measured - correction, measured, math.hypot(*parts))


def _scatter(means: Array, owner: NDArray[np.int64]) -> tuple[float, float]:
    """Variance of a mean from turn to turn, and its degrees of freedom, from means sorted by their owner."""
    bends = np.diff(means, 2)[owner[2:] == owner[:-2]]
    if len(bends):
        # neighbours share two means of three: the variance of their squares' mean is 35/9 σ⁴ over their number
        return float((bends**2).mean()) / 6, max(18 / 35 * len(bends), 1.0)
    steps = np.diff(means)[owner[1:] == owner[:-1]]
    return float((steps**2).mean()) / 2, float(len(steps))


def _slope(means: Array, temperature: Array, owner: NDArray[np.int64]) -> ErrorMotionValue | None:
    """Slope over temperature with a level for each direction and speed; None where it is not told."""
    levels = (owner[:, None] == np.unique(owner)).astype(float)
    left = temperature - levels @ (levels.T @ temperature / levels.sum(axis=0))
    degrees = len(means) - levels.shape[1] - 1
    if degrees < 1 or float(np.ptp(left)) < LEAST_WARMING:
        return None
    square = float((left**2).sum())
    slope = float(left @ means) / square
    rest = means - levels @ (levels.T @ means / levels.sum(axis=0)) - slope * left
    deviation = math.sqrt(float((rest**2).sum()) / degrees / square)
    return ErrorMotionValue(slope, slope, deviation * float(stdtrit(degrees, 0.975)) / COVERAGE)
