"""What of the tilt is uncertain because it is not known exactly when the autocollimator read it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.error_motion import remove_mirror
from rotary_error_monitor.metrology.harmonics import planar_sum
from rotary_error_monitor.pipeline.evidence import INDEX
from rotary_error_monitor.signals.resampling import around
from rotary_error_monitor.signals.streams import SampleStream

AHEAD = 1e-6
"""Rotation, rad, over which the slope of a described tilt is taken: a wave of the highest order that a file states is
straight over it to a hundredth, and it is far above rounding."""


class LateTilt:
    """What the mirror's tilt goes on in one standard uncertainty of the autocollimator's latency.

    It goes as described, the mirror's own tilt foremost, which turns with the rotor; what is not described of it is
    taken to turn as well. Differences of what is read would tell the same, but for their noise: at most instruments
    that is larger from one sample to the next.
    """

    def __init__(self, stage: StageDescription, heads: Mapping[str, int]) -> None:
        """Of a stage with read heads, bits of masks by stream."""
        self._timing, self._stage, self._heads = stage.timing("autocollimator"), stage, dict(heads)

    def variance(
        self,
        ticks: Times,
        theta: Array,
        evidence: Array,
        streams: Mapping[str, SampleStream],
        used: NDArray[np.int64],
        count: int,
    ) -> Array | None:
        """(count, 2) variance of the tilt about x and y at the first ticks, rad²; None where the latency is exact.

        Args:
            ticks: (m,) timestamps (ns).
            theta: (m,) rotation, rad.
            evidence: (m, e) what the ticks say, columns as in `pipeline.evidence`.
            streams: the samples in memory.
            used: (m,) masks of the heads that tell the rotation.
            count: of ticks that count.
        """
        if self._timing == 0.0:
            return None
        ticks, theta, evidence, used = ticks[:count], theta[:count], evidence[:count], used[:count]
        speed = np.abs(evidence[:, INDEX["velocity"]])  # where the command alone tells it
        for name, bit in self._heads.items():
            told = used & bit != 0
            if told.any():
                speed = np.maximum(speed, np.where(told, _speed(ticks, streams[name]), 0.0))
        here, ahead = (self._described(at) for at in (theta, theta + AHEAD))
        rest = evidence[:, [INDEX["tilt_surplus_y"], INDEX["tilt_surplus_x"]]]
        return np.asarray((self._timing * speed[:, None]) ** 2 * (((ahead - here) / AHEAD) ** 2 + rest**2))

    def _described(self, theta: Array) -> Array:
        """(m, 2) what an autocollimator reads of the described stage, rad."""
        nothing = np.zeros((len(theta), 2))
        return planar_sum(self._stage.spindle.tilt, theta) - remove_mirror(nothing, theta, self._stage.mirror)


def _speed(ticks: Times, head: SampleStream) -> Array:
    """(m,) rotation per s over the four samples of a head around each tick."""
    times, values = head.times_ns, head.values[:, 0]
    first, last = around(times, ticks)
    return np.asarray(np.abs(values[last] - values[first]) * 1e9 / (times[last] - times[first]))
