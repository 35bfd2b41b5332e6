"""Samples of a mock stage that turns as a controller commands it, made as the commands become known."""

from __future__ import annotations

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.environment import Forces
from rotary_error_monitor.plant.motion import CommandedCourse
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.plant.tracking import CommandedMotion
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.sources.source import Source

_PATIENCE_NS = 2 * NANOSECONDS
"""Time without a command, ns, after which the stage stands."""

_LONGEST_NS = NANOSECONDS // 2
"""Samples that are older, ns, are not made up for."""


class FollowedStage:
    """The true stage behind several sources: commands come in, samples go out, none of them twice.

    Where the stage is between two commands is known with the second, so samples go out as far as commands are known.

    Attributes:
        plant: the stage; its motion is what is commanded.
    """

    def __init__(self, stage: StageDescription, settings: MockSettings) -> None:
        """A true stage as described, with the settings' seed, epoch and rate; nothing pushes at it."""
        self._motion = CommandedMotion()
        self.plant = followed_plant(stage, settings, self._motion)
        self._newest_ns = self._commanded_ns = 0
        self._given: dict[str, int] = {}

    def command(self, stamp_ns: int, angle: float, velocity: float) -> None:
        """Be at `angle` (rad) at `stamp_ns`, moving at `velocity` (rad/s); what is not newer than the last is lost."""
        self._commanded_ns = max(self._commanded_ns, stamp_ns)
        self._be(stamp_ns, angle, velocity)

    def _be(self, stamp_ns: int, angle: float, velocity: float) -> None:
        if stamp_ns > self._newest_ns:
            self._newest_ns = stamp_ns
            self._motion.command((stamp_ns - self.plant.epoch_ns) / NANOSECONDS, angle, velocity)

    def take(self, stream: str, until_ns: int) -> SampleBlock | None:
        """Block of the samples of a stream that were not taken yet, before `until_ns`; None where there are none."""
        if not self._motion.has_begun:
            return None
        if until_ns - self._commanded_ns > _PATIENCE_NS:
            self._be(until_ns, self._motion.last_angle, 0.0)
        until_ns = min(until_ns, self._newest_ns)
        since_ns = max(self._given.get(stream, until_ns), until_ns - _LONGEST_NS)
        self._given[stream] = max(until_ns, since_ns)
        first, last = (self.plant.index_at(stream, time_ns) for time_ns in (since_ns, until_ns))
        return self.plant.samples(stream, first, last - first) if last > first else None


def followed_plant(stage: StageDescription, settings: MockSettings, motion: CommandedCourse) -> StagePlant:
    """The true stage that turns as `motion` says."""
    clocks = stage_clocks(tuple(stage.azimuths), settings.rate)
    return StagePlant(stage, settings.seed, settings.epoch_ns, motion, Forces(), clocks=clocks)


class FollowedSource(Source):
    """One stream of a followed stage."""

    def __init__(self, stage: FollowedStage, stream: str) -> None:
        """Samples of `stream`, such as `head_a`, `autocollimator`."""
        self._stage = stage
        self._stream = stream

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of all samples before `until_ns` that are known and were not taken yet."""
        return self._stage.take(self._stream, until_ns)
