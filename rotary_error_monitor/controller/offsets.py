"""From axis corrections to external offset counts: what to write, when to hold, and why.

LinuxCNC keeps an external offset as a number of its own and adds to it what its counts pin changes by, as long as the
machine is on, homed, and not in joint mode. Whoever writes the pin must therefore know which counts stood there when
the number had which value: the anchor. It is lost whenever the controller zeroes the number or stops counting, so it is
taken anew then, from the pins, and never carried over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rotary_error_monitor.controller.kinematics import Kinematics, Position, solve_offsets
from rotary_error_monitor.errors import InputError

NANOSECONDS = 1_000_000_000
STALE = "the corrections are too old: the last one is held"
_COUNTS_END = 2**31
_STANDSTILL = 1e-12
"""A commanded joint that moved by less, m or rad, stood still: rounding of the kinematics is far below."""


@dataclass(frozen=True)
class Reading:
    """One consistent look at the controller, in m, rad and s.

    Attributes:
        stamp_ns: when it was taken, timestamp (ns).
        axes: commanded positions of the axes, external offsets left out.
        joints: commanded positions of the joints, external offsets included.
        joint_velocities: their velocities.
        requested: external offsets as the controller has been asked for.
        applied: external offsets in effect; they follow `requested` within the controller's limits.
        counts: numbers on the counts pins.
        enabled: machine on.
        homed: all joints homed.
        coordinated: coordinated or teleop mode, in which offsets act; False in joint mode.
        limited: a soft limit clips the offsets.
        pulse: a number that changes with every servo period.
    """

    stamp_ns: int
    axes: Position
    joints: Position
    joint_velocities: Position
    requested: Position
    applied: Position
    counts: tuple[int, ...]
    enabled: bool
    homed: bool
    coordinated: bool
    limited: bool
    pulse: int


@dataclass(frozen=True)
class Correction:
    """Corrections to add to the commanded joints, m and rad, and when they were computed, timestamp (ns)."""

    stamp_ns: int
    positions: Position


@dataclass(frozen=True)
class OffsetLimits:
    """What the bridge accepts.

    Attributes:
        count: what one count means for each axis, m or rad.
        largest: largest correction of each axis, m or rad.
        max_age: age at which a correction is no longer followed by new ones and is held, s.
        settling: looks, each with a new servo period behind it, after which the controller's numbers are trusted.
    """

    count: Position
    largest: Position
    max_age: float
    settling: int = 5


@dataclass(frozen=True)
class Step:
    """What to do in one period.

    Attributes:
        counts: numbers to write to the counts pins; None to leave them.
        held: why corrections are held; empty while they are followed.
    """

    counts: tuple[int, ...] | None
    held: str


@dataclass(frozen=True)
class _Anchor:
    """Counts that stood on the pins when the controller's offsets had these values."""

    counts: tuple[int, ...]
    requested: Position


class OffsetControl:
    """Follows corrections by counts, period after period; reads no clock and touches no pin.

    Attributes:
        takeovers: how often the controller's numbers changed by another hand than this one's.
    """

    def __init__(self, names: Sequence[str], limits: OffsetLimits) -> None:
        """Control the axes called `names`."""
        self.takeovers = 0
        self._names = tuple(names)
        self._limits = limits
        self._correction: Correction | None = None
        self._anchor: _Anchor | None = None
        self._written: tuple[int, ...] | None = None
        self._doubts = 0
        self._pulse: int | None = None

    @property
    def correction(self) -> Correction | None:
        """The correction that is followed or held; None before the first."""
        return self._correction

    def accept(self, correction: Correction, now_ns: int) -> None:
        """Follow `correction` from the next step on.

        Raises:
            InputError: it is not finite, larger than allowed, for other axes, older than allowed, or from the future.
        """
        if len(correction.positions) != len(self._names):
            raise InputError(f"{len(correction.positions)} corrections for the axes {' '.join(self._names)}")
        for name, value, largest in zip(self._names, correction.positions, self._limits.largest, strict=True):
            if not math.isfinite(value) or abs(value) > largest:
                raise InputError(f"correction of {name} is {value:g}; expected at most {largest:g} (m, rad)")
        age = (now_ns - correction.stamp_ns) / NANOSECONDS
        if abs(age) > self._limits.max_age:
            raise InputError(f"correction is {age:.3g} s old; expected at most {self._limits.max_age:g} s")
        if self._correction is None or correction.stamp_ns >= self._correction.stamp_ns:
            self._correction = correction

    def step(self, reading: Reading, kinematics: Kinematics) -> Step:
        """What to write now, given what the controller shows now."""
        blocked = _blocked(reading)
        if blocked:
            self._anchor, self._written, self._doubts = None, None, 0
            return Step(None, blocked)
        if self._find_anchor(reading) is None:
            return Step(None, "the controller's offsets settle")
        if self._correction is None:
            return Step(None, "no correction has come yet")
        return self._follow(self._correction, reading, kinematics)

    def _find_anchor(self, reading: Reading) -> _Anchor | None:
        """The anchor, where the controller's numbers agree with it; taken anew once they disagree for good.

        A disagreement of one look is nothing yet: the controller takes up counts a servo period after they are written,
        and without real time that can take long.
        """
        if self._anchor is not None and self._agrees(self._anchor, reading):
            self._doubts = 0
            return self._anchor
        self._doubts += reading.pulse != self._pulse
        self._pulse = reading.pulse
        if self._doubts > self._limits.settling:
            self.takeovers += self._anchor is not None
            self._anchor, self._written, self._doubts = _Anchor(reading.counts, reading.requested), None, 0
        return self._anchor

    def _agrees(self, anchor: _Anchor, reading: Reading) -> bool:
        if self._written is not None and self._written != reading.counts:
            return False
        moved = zip(reading.counts, anchor.counts, self._limits.count, strict=True)
        expected = [
            start + (now - then) * count for start, (now, then, count) in zip(anchor.requested, moved, strict=True)
        ]
        return all(
            abs(value - number) < count / 2
            for value, number, count in zip(reading.requested, expected, self._limits.count, strict=True)
        )

    def _follow(self, correction: Correction, reading: Reading, kinematics: Kinematics) -> Step:
        assert self._anchor is not None
        wanted = solve_offsets(kinematics, reading.axes, correction.positions)
        start = zip(self._anchor.counts, self._anchor.requested, strict=True)
        counts = tuple(
            then + round((value - number) / count)
            for value, count, (then, number) in zip(wanted, self._limits.count, start, strict=True)
        )
        if any(not -_COUNTS_END <= number < _COUNTS_END for number in counts):
            return Step(None, "the counts pins are at the end of their 32 bits: clear the external offsets")
        self._written = counts
        # Held means that the joints keep their corrections: the offsets still turn with the table.
        is_old = reading.stamp_ns - correction.stamp_ns > self._limits.max_age * NANOSECONDS
        return Step(counts, STALE if is_old else "")


def _blocked(reading: Reading) -> str:
    """Why the controller would not take up counts now; empty where it would."""
    if not reading.enabled:
        return "the machine is off"
    if not reading.homed:
        return "the machine is not homed"
    if not reading.coordinated:
        return "the machine is in joint mode"
    return ""


def commanded_velocities(before: Sequence[float], now: Sequence[float], velocities: Sequence[float]) -> Position:
    """Velocities of joints that the program moves, 0 for the others, which only corrections move.

    A joint that stands would else seem to reverse with each small correction, and the correction with it.
    """
    return tuple(
        velocity if abs(position - last) > _STANDSTILL else 0.0
        for last, position, velocity in zip(before, now, velocities, strict=True)
    )
