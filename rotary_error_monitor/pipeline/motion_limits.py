"""Whether error motion is one that the stage can have: the last look at what corrections are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.evidence import SIGMAS

LIMIT = 3.0
"""Largest error motion in units of the stage's limits: an estimator believes what departs from the description by twice
these, where the description is the opposite of the truth, and the description itself may reach them."""


class MotionLimits:
    """Holds error motion against what the stage can do at most, whoever says it, and in whatever unit."""

    def __init__(self, limits: StageLimits) -> None:
        """Of a stage with these limits."""
        self._most = LIMIT * np.array(limits.components)
        self._most[5] += limits.latency * limits.speed

    def beyond(self, motion: ErrorMotion) -> NDArray[np.bool_] | None:
        """(m, 6) which components no such stage has, by more than they are uncertain; none where there is no such."""
        over: NDArray[np.bool_] = np.abs(motion.components) > self._most
        if not over.any():
            return None
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        over &= motion.observable & ~(np.abs(motion.components) <= self._most + SIGMAS * deviation)
        return over if over.any() else None

    def told(self, motion: ErrorMotion, beyond: NDArray[np.bool_]) -> str:
        """Why the last of some ticks is not used, which has components beyond the limits, in words."""
        place = int(np.argmax(beyond[-1]))
        unit = "µm" if place < 3 else "µrad"
        size, most = (1e6 * float(value) for value in (motion.components[-1, place], self._most[place]))
        return (
            f"error motion {COMPONENTS[place]} of {size:.4g} {unit} is more than a stage with these limits can have "
            f"({most:.4g} {unit}): it is not this stage's, or in another unit"
        )
