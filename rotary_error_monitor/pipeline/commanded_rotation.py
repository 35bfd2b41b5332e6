"""The rotation of a stage without read heads: its command, which nothing else tells, and how sure that is."""

from __future__ import annotations

import math

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.evidence import Window
from rotary_error_monitor.pipeline.ring_belief import CommandBelief


class CommandedRotation(CommandBelief):
    """The command where it is the rotation: nothing contradicts it, so it is as far off as the stage's limits allow.

    Attributes:
        lag: standard uncertainty of the rotation at the present speed, rad: following error and latency within their
            limits, distributed as a rectangle (JCGM 100:2008, 4.3.7), and the stamps of the command.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Rotation of a stage."""
        limits, timing = stage.limits, stage.timing("command")
        self._at_rest = limits.following_error / math.sqrt(3.0)
        self._by_speed = math.hypot(limits.latency / math.sqrt(3.0), timing)
        super().__init__(stage)

    def reset(self) -> None:
        """Forget how fast the stage turned."""
        super().reset()
        self._speed_before: float | None = None
        self._least, self._most = math.inf, -math.inf
        self.lag = self._uncertainty(self._limits.speed)

    @property
    def turned(self) -> float:
        """Largest part of a turn between two rotations that were commanded; 1 or more where it was a whole one."""
        return max(0.0, self._most - self._least) / (2.0 * math.pi)

    def judge(self, window: Window) -> None:
        """Take in a window in which the command tells the rotation, or is missing."""
        last, self._last = self._last, window
        if window.tells_rotation:
            self._least, self._most = min(self._least, window["theta"]), max(self._most, window["theta"])
        speed = abs(self._speed_of(window, last))
        before = speed if self._speed_before is None else self._speed_before
        self._speed_before = speed
        # the ticks that it holds for are in the next window: what the speed changes by it may change by again
        self.lag = self._uncertainty(max(speed, 2.0 * speed - before))

    def _uncertainty(self, speed: float) -> float:
        return math.hypot(self._at_rest, speed * self._by_speed)
