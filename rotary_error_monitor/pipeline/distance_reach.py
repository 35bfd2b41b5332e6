"""How far the distance of rotation and command can go until it is judged again."""

from __future__ import annotations

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.pipeline.evidence import LONG, SIGMAS
from rotary_error_monitor.pipeline.speed_slope import SpeedSlope

STEADY = 0.25
"""Part of the largest following error by which rotation and command may come apart within a window."""

RIPPLE = 0.25
"""Part of a step within a window by which its ticks scatter about a straight line: the root of p q (1 - 3 p q), where
the part p of them is before it and q behind it, for p from 0.08 to 0.92."""

ACCELERATION = 100.0
"""Angular acceleration, rad/s², that direct drives of rotary tables reach."""


class DistanceReach:
    """Tells it by what a drive makes, and a delay that the distance has not shown.

    Attributes:
        rippled: scatter of the ticks of a window from which on a step may be in it, rad.
    """

    def __init__(self, limits: StageLimits) -> None:
        """Of a stage with these limits, of whose delay nothing was seen."""
        self._steady, self._latency = STEADY * limits.following_error, limits.latency
        self.rippled = RIPPLE * self._steady
        self._unseen = limits.latency  # by how much the delay may be another while none is seen, s

    def late(self, delay: float) -> float:
        """Delay (s) that the distance leaves possible where it shows one."""
        return min(abs(delay) + self._unseen, self._latency)

    def within(self, duration: float, delay: float, lag: float) -> float:
        """Largest change (rad) within a window of a duration (s), at a delay (s) and an uncertainty (rad)."""
        return self._steady + self._faster(duration, delay) + SIGMAS * lag

    def learn(self, slope: SpeedSlope, number: int, duration: float, delay: float, lag: float) -> None:
        """Renew what of the delay is not seen, behind the window of a number, while it counts beside all else."""
        if len(slope) >= 2 * LONG and number % LONG:
            return
        if self._faster(duration, delay) > max(SIGMAS * lag, self.rippled):
            self._unseen = min(self._unseen, slope.unseen(duration))

    def _faster(self, duration: float, delay: float) -> float:
        return ACCELERATION * duration * self.late(delay)
