"""What a mount does with time beyond steady rates, and how loud noise is beside it.

Neighbours on the sky are hours apart, and do not share what a mount does for some minutes, nor what jumped at one
moment: all that would pass for noise, and a jump for a steady slip.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.p_values import chi_square_median, log_chi_square_tail
from rotary_error_monitor.gap.problem import StructureTest
from rotary_error_monitor.gap.structure import HIGHEST_LEVEL
from rotary_error_monitor.kinds.mount.sky import OVER_TIME, estimate_repeatability
from rotary_error_monitor.noise.slow_noise import SlowNoise

POWERS = 3
"""Of time, from a steady drift to one that turns back twice; half waves hold what is faster."""

BY_CHANCE = 0.01
"""Rate at which noise is taken for something that the mount does with time, where the level of noise is told."""

GROUP = "time"


class TimeCourses:
    """Powers of time and half waves over the recording, each on the sky and about the declination axis.

    A turn about the declination axis moves the tube the other way on the other side of the pier. The shortest half wave
    is of as many pointings as tell how loud the noise is.

    Args:
        time: (n,) s.
        side: (n,) of the pier, ±1.
    """

    def __init__(self, time: Array, side: Array) -> None:
        self.spread = (time - time.min()) / max(float(np.ptp(time)), 1.0)
        self.side = side
        courses = [(f"power {k}", (self.spread - self.spread.mean()) ** k) for k in range(1, POWERS + 1)]
        courses += [(f"half waves {k}", np.cos(np.pi * k * self.spread)) for k in range(1, len(time) // OVER_TIME + 1)]
        told = [*courses, *((f"{words}, opposite on the sides of the pier", side * shape) for words, shape in courses)]
        self.names = [words for words, _ in told]
        self.shapes = np.stack([course for _, course in told], axis=1)

    def findings(
        self, white: Array, kept: NDArray[np.bool_], channel: str, slow: SlowNoise | None = None
    ) -> StructureTest:
        """The course that explains most of white rows (n,), beside coloured noise as loud as most courses are.

        Noise that is coloured raises all slow courses alike; what stands out of them is none (`HIGHEST_LEVEL`).
        """
        table = (self.shapes if slow is None else slow.whiten(self.shapes)) * kept[:, None]
        table = table - kept[:, None] * table.sum(axis=0) / kept.sum()
        power = np.sum(np.square(table), axis=0)
        gains = np.where(power > 1e-9, np.square(table.T @ white) / np.maximum(power, 1e-9), 0.0)
        levels = np.median(gains.reshape(2, -1), axis=1) / chi_square_median(1)  # on the sky, and opposite on the sides
        beside = gains / np.repeat(np.clip(levels, 1.0, HIGHEST_LEVEL), len(gains) // 2)
        best = int(np.argmax(beside))
        chance = log_chi_square_tail(float(beside[best]), 1) + float(np.log(len(gains)))
        return StructureTest(
            channel, GROUP, min(0.0, chance), max(0.0, float(gains[best]) - 1), f"{GROUP}: {self.names[best]}"
        )

    def noise(self, errors: Array, std: Array, kept: NDArray[np.bool_]) -> Array:
        """(k,) noise of errors (n, k), of which neighbours on the sky do not share `std` (k,).

        Where something stands out over time it is what pointings one after the other do not share, if that is less.
        """
        if not np.ptp(self.spread) > 0:
            return std
        ways = (np.ones(len(self.side)), self.side)
        turned: Sequence[Array] = [(way[:, None] * errors)[kept] for way in ways]
        within = np.min([estimate_repeatability(rows, self.spread[kept, None])[0] for rows in turned], axis=0)
        found = [self.findings(e / max(w, 1e-300) * kept, kept, "") for e, w in zip(errors.T, within, strict=True)]
        stands_out = np.array([finding.log_p_value < np.log(BY_CHANCE) for finding in found])
        return np.where(stands_out, np.minimum(std, within), std)
