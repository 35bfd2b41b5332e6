"""From a target that jumps to a course that axes can follow: with limits of speed and acceleration, never beyond it.

Each axis takes the quickest way to rest at its target that its limits allow: accelerate, cruise, brake. The way is
planned anew at each step from where the axis is and how fast, so a new target bends the course and never breaks it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.kinematics import Position

LONGEST_STEP = 0.02
"""A longer time between two steps counts as this, s, and the course goes on from rest: meanwhile nothing was moved.
Five looks of the bridge; what one step may then add is an acceleration's start, 10 µm by default."""

_AT_LIMIT = 1.0 - 1e-6
"""Share of the speed limit from which an axis counts as slowed by it: rounding is far smaller."""


@dataclass(frozen=True)
class CourseLimits:
    """Limits of the courses of m axes, in m or rad and s.

    Attributes:
        largest: distance from zero of each target.
        speed: of each axis.
        acceleration: of each axis.
    """

    largest: Position
    speed: Position
    acceleration: Position

    def __post_init__(self) -> None:
        if not len(self.largest) == len(self.speed) == len(self.acceleration):
            raise InputError(f"limits {self}; expected as many of each")
        if not all(0.0 <= value < math.inf for value in self.largest) or not all(
            0.0 < value < math.inf for value in (*self.speed, *self.acceleration)
        ):
            raise InputError(f"limits {self}; expected finite numbers, speeds and accelerations above zero")

    def check(self, target: Sequence[float]) -> None:
        """Hold a target (m, rad) against the limits.

        Raises:
            InputError: it is not finite, beyond the limits, or for other axes.
        """
        if len(target) != len(self.largest) or not all(
            abs(value) <= largest for value, largest in zip(target, self.largest, strict=True)
        ):
            raise InputError(f"target {tuple(target)}; expected at most {self.largest} (m, rad)")


class ShapedCourse:
    """Where the axes are on their way; reads no clock.

    Attributes:
        positions: of the axes, m or rad.
        velocities: of the axes, m/s or rad/s.
    """

    def __init__(self, limits: CourseLimits, positions: Sequence[float]) -> None:
        """Stand at `positions`, which may lie beyond the limits: somebody else may have left the axes there."""
        self._limits = limits
        self.positions: Position = tuple(positions)
        self.velocities: Position = (0.0,) * len(self.positions)
        self._target = self.positions
        self._time_ns: int | None = None

    @property
    def to_go(self) -> Position:
        """Way from each axis to its target, m or rad."""
        return tuple(target - position for target, position in zip(self._target, self.positions, strict=True))

    @property
    def slowed(self) -> bool:
        """Whether an axis goes as fast as it may."""
        return any(
            abs(velocity) > _AT_LIMIT * speed
            for velocity, speed in zip(self.velocities, self._limits.speed, strict=True)
        )

    def aim(self, target: Sequence[float]) -> None:
        """Go to `target` from the next step on.

        Raises:
            InputError: as for `CourseLimits.check`.
        """
        self._limits.check(target)
        self._target = tuple(target)

    def halt(self) -> None:
        """Come to rest as soon as may be, and stay there."""
        braking = zip(self.positions, self.velocities, self._limits.acceleration, strict=True)
        self._target = tuple(
            position + velocity * abs(velocity) / (2.0 * acceleration) for position, velocity, acceleration in braking
        )

    def rebase(self, positions: Sequence[float]) -> None:
        """The axes are at `positions` by a new reckoning: go on from there with the same velocities and target."""
        self.positions = tuple(positions)

    def advance(self, now_ns: int) -> Position:
        """Positions at `now_ns`, of a clock that never steps (ns); the first call only begins to count."""
        elapsed = 0.0 if self._time_ns is None else (now_ns - self._time_ns) / NANOSECONDS
        self._time_ns = now_ns
        if elapsed > LONGEST_STEP:
            elapsed = LONGEST_STEP
            self.velocities = (0.0,) * len(self.positions)
        if elapsed > 0.0:
            axes = zip(
                self.positions,
                self.velocities,
                self._target,
                self._limits.speed,
                self._limits.acceleration,
                strict=True,
            )
            moved = [_travel(*axis, elapsed) for axis in axes]
            self.positions = tuple(position for position, _ in moved)
            self.velocities = tuple(velocity for _, velocity in moved)
        return self.positions


def _travel(
    position: float, velocity: float, target: float, speed: float, acceleration: float, elapsed: float
) -> tuple[float, float]:
    """Position and velocity after `elapsed` s on the quickest way to rest at `target`.

    With the braking distance v²/2a behind it, an axis that must still go a distance D towards the target accelerates to
    the peak w, w² = a D + v²/2, or to its speed limit, cruises, and brakes.
    """
    distance = target - position
    beyond_braking = distance - velocity * abs(velocity) / (2.0 * acceleration)
    sign = math.copysign(1.0, beyond_braking)
    start, way = sign * velocity, sign * distance
    peak = min(speed, math.sqrt(max(0.0, acceleration * way + start * start / 2.0)))
    cruise = way - (2.0 * peak * peak - start * start) / (2.0 * acceleration)
    phases = (
        (acceleration, max(0.0, peak - start) / acceleration),
        (0.0, max(0.0, cruise) / peak if peak > 0.0 else 0.0),
        (-acceleration, peak / acceleration),
    )
    moved, now, left = 0.0, start, elapsed
    for change, duration in phases:
        time = min(left, duration)
        moved += time * (now + change * time / 2.0)
        now += change * time
        left -= time
        if left <= 0.0:
            reached = position + sign * moved
            # what goes towards its target can brake before it: what lies beyond is rounding
            beyond = start >= 0.0 and sign * (target - reached) < 0.0
            return (target if beyond else reached), sign * now
    return target, 0.0
