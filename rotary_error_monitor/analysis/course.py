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
from rotary_error_monitor.metrology.spindle_figures import COVERAGE, Value

LEAST_WARMING = 0.1
"""Change of temperature from which a slope over it is told, K: thermometers of machines resolve some hundredths."""


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
        range: largest less smallest of them.
        slopes: by thermometer, per K, at one and the same speed and direction; none where it hardly warmed.
    """

    signal: str
    unit: str
    times_ns: Times
    means: Array
    range: Value
    slopes: Mapping[str, Value]


def estimate_drifts(segments: Sequence[SegmentFigures], temperatures: Mapping[str, Samples]) -> tuple[Drift, ...]:
    """Drift of each signal in a direction that stands still, where the recording has two whole turns.

    Means over whole turns are free of all that comes back in each turn.
    """
    keys = dict.fromkeys(f.signal for segment in segments for f in segment.signals if f.direction != ROTATING)
    return tuple(drift for key in keys for drift in _drift(key, segments, temperatures))


def _drift(key: str, segments: Sequence[SegmentFigures], temperatures: Mapping[str, Samples]) -> Iterator[Drift]:
    found = [(i, f) for i, segment in enumerate(segments) for f in segment.signals if f.signal == key]
    times = np.concatenate([f.middle_ns for _, f in found])
    means = np.concatenate([f.means for _, f in found])
    owner = np.concatenate([np.full(f.turns, i) for i, f in found])
    if len(times) < 2:
        return
    order = np.argsort(times, kind="stable")
    times, means, owner = times[order], means[order], owner[order]
    deviation = max(f.mean_uncertainty for _, f in found)
    spread = float(np.ptp(means))
    slopes = {
        name: slope
        for name, samples in temperatures.items()
        if (slope := _slope(means, samples.at(times), owner)) is not None
    }
    wander = Value(spread, spread, math.sqrt(2) * deviation)
    yield Drift(key, found[0][1].unit, times, means - means.mean(), wander, slopes)


def _slope(means: Array, temperature: Array, owner: NDArray[np.int64]) -> Value | None:
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
    return Value(slope, slope, deviation * float(stdtrit(degrees, 0.975)) / COVERAGE)
