"""Samples of a mock stage whose rotor follows a machine's axis, made as the axis moves."""

from __future__ import annotations

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.environment import Forces
from rotary_error_monitor.plant.motion import Course
from rotary_error_monitor.plant.stage import StagePlant, stage_clocks
from rotary_error_monitor.plant.tracking import TrackedMotion
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.sources.source import Source


class FollowedStage:
    """The true stage behind several sources: commands come in, samples go out, none of them twice.

    Attributes:
        plant: the stage; its motion is what follows the commands.
    """

    def __init__(self, stage: StageDescription, settings: MockSettings) -> None:
        """A true stage as described, with the settings' seed, epoch and rate; nothing pushes at it."""
        self._motion = TrackedMotion()
        self.plant = followed_plant(stage, settings, self._motion)
        self._given_ns = 0

    def command(self, stamp_ns: int, angle: float, velocity: float) -> None:
        """The axis stood at `angle` (rad) at `stamp_ns`, moving at `velocity` (rad/s).

        It acts after the last sample that has been given away: what an instrument has said stays true.
        """
        from_ns = max(stamp_ns, self._given_ns)
        predicted = angle + velocity * (from_ns - stamp_ns) / NANOSECONDS
        time = (from_ns - self.plant.epoch_ns) / NANOSECONDS
        if not self._motion.has_begun or time > self._motion.newest:
            self._motion.steer(time, predicted, velocity)

    def take(self, stream: str, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples of a stream from `since_ns` to before `until_ns`; None where there are none."""
        if not self._motion.has_begun:
            return None
        first, last = (self.plant.index_at(stream, time_ns) for time_ns in (since_ns, until_ns))
        self._given_ns = max(self._given_ns, until_ns)
        return self.plant.samples(stream, first, last - first) if last > first else None


def followed_plant(stage: StageDescription, settings: MockSettings, motion: Course) -> StagePlant:
    """The true stage that turns as `motion` says."""
    clocks = stage_clocks(tuple(stage.azimuths), settings.rate)
    return StagePlant(stage, settings.seed, settings.epoch_ns, motion, Forces(), clocks=clocks)


class FollowedSource(Source):
    """One stream of a followed stage."""

    def __init__(self, stage: FollowedStage, stream: str) -> None:
        """Samples of `stream`, such as `head_a`, `autocollimator`, `command`."""
        self._stage = stage
        self._stream = stream

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples from `since_ns` to before `until_ns`."""
        return self._stage.take(self._stream, since_ns, until_ns)
