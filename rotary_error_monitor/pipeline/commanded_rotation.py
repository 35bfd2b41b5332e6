"""The rotation of a stage without read heads: its command, which nothing else tells, and how sure that is."""

from __future__ import annotations

import math

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.command_belief import CommandBelief
from rotary_error_monitor.pipeline.evidence import AGREEMENT, EvidenceWindow
from rotary_error_monitor.pipeline.standing_command import STANDS
from rotary_error_monitor.pipeline.standing_rotor import StandingRotor
from rotary_error_monitor.pipeline.turned_part import TurnedPart


class CommandedRotation(CommandBelief):
    """The command where it is the rotation: as far off as the stage's limits allow, as long as it moves as it says.

    No sensor tells another rotation. But a command that is stuck contradicts its own velocity, or, where that stands
    still as well, what turns with the rotor. It is believed again once it has moved for `AGREEMENT`: while it stands,
    nothing tells that the rotor is where it says.

    Attributes:
        lag: standard uncertainty of the rotation at the present speed, rad: following error and latency within their
            limits, distributed as a rectangle (JCGM 100:2008, 4.3.7), and the stamps of the command.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Rotation of a stage."""
        limits, timing = stage.limits, stage.timing("command")
        self._at_rest = limits.following_error / math.sqrt(3.0)
        self._by_speed = math.hypot(limits.latency / math.sqrt(3.0), timing)
        self._rotor = StandingRotor(stage)
        super().__init__(stage)

    def reset(self) -> None:
        """Believe the command again, and forget how fast the stage turned."""
        super().reset()
        self._rotor.reset()
        self._speed_before: float | None = None
        self._seen = TurnedPart()
        self._short = self._stood = 0.0
        self.lag = self._uncertainty(self._limits.speed)

    def retract(self, *, doubt: bool) -> None:
        """The clock was set back: how long the command stood is not known."""
        super().retract(doubt=doubt)
        self._rotor.reset()
        self._short = self._stood = 0.0

    @property
    def turned(self) -> float:
        """Largest part of a turn between two rotations that were commanded; 1 or more where it was a whole one."""
        return self._seen.part

    def judge(self, window: EvidenceWindow, vague: float = 0.0) -> None:
        """Take in a window in which the command tells the rotation, or is missing."""
        last, self._last = self._last, window
        self._hold_against_itself(window, last)
        if window.tells_rotation and not self.doubt:
            self._seen.add(window.mean.theta)
        speed = abs(self._told.of(window, last))
        before = speed if self._speed_before is None else self._speed_before
        self._speed_before = speed
        # the ticks that it holds for are in the next window: what the speed changes by it may change by again
        self.lag = self._uncertainty(max(speed, 2.0 * speed - before))

    def _hold_against_itself(self, window: EvidenceWindow, last: EvidenceWindow | None) -> None:
        """Doubt a command that is stuck, and believe it again once it has moved for long enough."""
        if last is None or window.number != last.number + 1 or not (window.tells_rotation and last.tells_rotation):
            self._short = self._stood = self._agreeing = 0.0
            return
        turned = window.mean.theta - last.mean.theta
        way = 0.5 * (window.mean.velocity + last.mean.velocity) * window.duration
        if turned != 0.0 and abs(turned) > STANDS * abs(way):
            self._short = self._stood = 0.0
            self._rotor.move(turned / window.duration)
            self._agreeing += window.duration
            if self._agreeing >= AGREEMENT:
                self.doubt = ""
            return
        self._agreeing = 0.0
        self._short += way
        self._stood += window.duration
        self.doubt = self._stuck_by_velocity(window) or self._stuck_by_rotor(window) or self.doubt

    def _stuck_by_velocity(self, window: EvidenceWindow) -> str:
        """It stands for longer than following error and latency explain at the velocity that it says."""
        speed = abs(window.mean.velocity)
        if abs(self._short) <= self._limits.following_error + self._limits.latency * speed:
            return ""
        return (
            f"stuck: its angle stands while its velocity of {window.mean.velocity:.3g} rad/s would have moved it by "
            f"{abs(self._short) * 1e6:.3g} µrad"
        )

    def _stuck_by_rotor(self, window: EvidenceWindow) -> str:
        """It stands, and what is seen of the rotor goes on turning as fast as the command did before."""
        if not self._rotor.goes_on(self._stood, window.mean.theta, window.readings):
            return ""
        return f"stuck: it has stood for {self._stood * 1e3:.0f} ms, and what turns with the rotor goes on"

    def _uncertainty(self, speed: float) -> float:
        return math.hypot(self._at_rest, speed * self._by_speed)
