"""What the controller commands: a cycle of speeds joined by brisk, jerk-limited ramps, integrated in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.noise import Noise

PEAK_SLOPE = 1.875  # of the ramp 10u³ - 15u⁴ + 6u⁵ at u = 1/2


class CommandedCourse(Protocol):
    """How a stage is commanded to turn."""

    def at(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angle (n,) rad and velocity (n,) rad/s at `time` (n,) s."""


@dataclass(frozen=True)
class MotionSegment:
    """A stretch of motion: how long (s) and how fast (rad/s, negative is backward, 0 stands still)."""

    duration: float
    speed: float


@dataclass(frozen=True)
class Motion:
    """Commanded rotation: `segments` one after another, repeated for ever.

    Each segment begins with a ramp from the speed before (the first from that of the last) to its own; the ramp is the
    minimum-jerk polynomial, as long as its peak acceleration needs.

    Attributes:
        segments: at least one; each at least as long as its ramp.
        acceleration: peak acceleration of the ramps, rad/s².

    Raises:
        InputError: there is no segment, or a number is out of range, or a segment is shorter than its ramp.
    """

    segments: tuple[MotionSegment, ...]
    acceleration: float = 60.0

    def __post_init__(self) -> None:
        if not self.segments:
            raise InputError("a motion needs at least one segment {duration, speed}")
        if not (np.isfinite(self.acceleration) and self.acceleration > 0):
            raise InputError(f"acceleration {self.acceleration} rad/s² must be a positive number")
        for segment, ramp in zip(self.segments, self._ramps, strict=True):
            if not (np.isfinite(segment.speed) and np.isfinite(segment.duration) and segment.duration >= ramp):
                raise InputError(
                    f"{segment}: duration must be at least the {ramp:.3g} s that its ramp takes "
                    f"at {self.acceleration} rad/s², and all numbers finite"
                )
        if not self.cycle > 0:
            raise InputError("the segments of a motion must last longer than 0 s")

    @property
    def cycle(self) -> float:
        """Duration of all segments, s."""
        return float(self._starts[-1])

    def at(self, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Commanded angle (n,) rad and velocity (n,) rad/s at `time` (n,) s; the angle is 0 at time 0."""
        turns = np.floor(time / self.cycle)
        within = np.maximum(time - turns * self.cycle, 0.0)  # the quotient of a tiny time before 0 is 0
        index = np.minimum(np.searchsorted(self._starts, within, side="right") - 1, len(self.segments) - 1)
        before, change, ramp = self._before[index], self._change[index], self._ramps[index]
        passed = within - self._starts[index]
        u = np.minimum(np.divide(passed, ramp, out=np.ones_like(passed), where=ramp > 1e-9), 1)
        cube = u * u * u
        velocity = before + change * cube * (10 + u * (6 * u - 15))
        risen = ramp * cube * u * (2.5 + u * (u - 3)) + np.maximum(passed - ramp, 0)
        angle = turns * self._angles[-1] + self._angles[index] + before * passed + change * risen
        return angle, velocity

    @cached_property
    def _speeds(self) -> NDArray[np.float64]:
        return np.array([segment.speed for segment in self.segments], dtype=np.float64)

    @cached_property
    def _before(self) -> NDArray[np.float64]:
        return np.roll(self._speeds, 1)

    @cached_property
    def _change(self) -> NDArray[np.float64]:
        return self._speeds - self._before

    @cached_property
    def _ramps(self) -> NDArray[np.float64]:
        return np.asarray(PEAK_SLOPE * np.abs(self._change) / self.acceleration, dtype=np.float64)

    @cached_property
    def _starts(self) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum([segment.duration for segment in self.segments])])

    @cached_property
    def _angles(self) -> NDArray[np.float64]:
        """Angle at the start of each segment and at the end of the cycle; a ramp covers half of its change."""
        lengths = np.diff(self._starts)
        return np.concatenate([[0.0], np.cumsum(self._before * lengths + self._change * (lengths - self._ramps / 2))])


def reversing_motion(speeds: Sequence[float] = (np.pi / 2, 2 * np.pi)) -> Motion:
    """Stand still, run forward at each speed (rad/s), backward at each, stand still: 40 s for two speeds."""
    rest = MotionSegment(1.5, 0.0)
    forward = [MotionSegment(9.25, float(speed)) for speed in speeds]
    backward = [MotionSegment(segment.duration, -segment.speed) for segment in forward]
    return Motion((rest, *forward, *backward, rest))


def motion_in_use(seed: int) -> Motion:
    """Motion with what axes in use do: arcs of a thousandth of a turn and many turns, stops, small changes of speed.

    One in two repeats itself to the last digit after two to four segments.
    """
    draw = Noise(seed, "motion in use").generator()
    count = int(draw.integers(2, 5)) if draw.random() < 0.5 else 12
    lengths = draw.uniform(2.0, 8.0, count)
    speeds = draw.choice([-1.0, 1.0], count) * draw.uniform(0.3, 1.0, count) * (draw.random(count) < 0.8)
    top = 10 ** draw.uniform(-4.0, 0.8)  # rad/s: in 40 s less than a thousandth of a turn, or forty turns
    return Motion(tuple(MotionSegment(float(t), float(top * v)) for t, v in zip(lengths, speeds, strict=True)))


def random_motion(seed: int, duration: float = 40.0, segments: int = 6, top_speed: float = 7.6) -> Motion:
    """Motion with seeded speeds and segment lengths, forward and backward in turn, standing still at both ends."""
    draw = Noise(seed, "motion").generator()
    rest = 1.5
    shares = draw.uniform(0.6, 1.4, segments)
    lengths = shares / shares.sum() * (duration - 2 * rest)
    speeds = draw.choice([0.1, 0.25, 0.5, 0.75, 1.0], segments) * top_speed * draw.choice([-1, 1])
    signs = np.where(np.arange(segments) % 2 == 0, 1, -1)
    rows = (MotionSegment(float(length), float(speed)) for length, speed in zip(lengths, speeds * signs, strict=True))
    return Motion((MotionSegment(rest, 0.0), *rows, MotionSegment(rest, 0.0)))
