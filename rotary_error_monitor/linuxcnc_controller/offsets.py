"""From axis corrections to external offset counts: what to write, when to wait, and why.

LinuxCNC keeps an external offset as a number of its own and adds to it what its counts pin changes by, as long as the
machine is on, homed, and not in joint mode. Whoever writes the pin must therefore know which counts stood there when
the number had which value: the anchor. It is lost whenever the controller zeroes the number or stops counting, so it is
taken anew then, from the pins, and never carried over.

What is written follows a course (see `shaping`) that begins at the corrections in effect: LinuxCNC's own limits of
offsets, `OFFSET_AV_RATIO`, are set for a machine's drives and not for a work piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotary_error_monitor.linuxcnc_controller.kinematics import Kinematics, Position, solve_offsets
from rotary_error_monitor.linuxcnc_controller.protocol import COUNTS_END
from rotary_error_monitor.linuxcnc_controller.shaping import CourseLimits, ShapedCourse

WAITING = "no correction has come yet"
SETTLING = "the controller's offsets settle"
_STANDSTILL = 1e-12
"""A commanded joint that moved by less, m or rad, stood still: rounding of the kinematics is far below."""


@dataclass(frozen=True)
class ControllerReading:
    """One consistent look at the controller, in m, rad and s.

    Attributes:
        stamp_ns: when it was taken, timestamp (ns).
        axes: commanded positions of the axes, external offsets left out.
        joints: positions of the joints that the program's and the offsets' path asks for.
        commands: what the drives of the joints are told of that, which comes some servo periods later.
        joint_velocities: velocities of the commands.
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
    commands: Position
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
class OffsetLimits:
    """How corrections are followed.

    Attributes:
        count: what one count means for each axis, m or rad.
        course: limits of the corrections' course.
        settling: looks, each with a new servo period behind it, after which the controller's numbers are trusted.
    """

    count: Position
    course: CourseLimits
    settling: int = 5


@dataclass(frozen=True)
class OffsetAction:
    """What to do in one period.

    Attributes:
        counts: numbers to write to the counts pins; None to leave them.
        held: why corrections are not followed; empty while they are.
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

    Corrections are forgotten when the controller stops to take up counts: what was right then need not be right when it
    takes them up again.

    Attributes:
        takeovers: how often the controller's numbers changed by another hand than this one's.
    """

    def __init__(self, names: Sequence[str], limits: OffsetLimits) -> None:
        """Control the axes called `names`."""
        self.takeovers = 0
        self._names = tuple(names)
        self._limits = limits
        self._target: Position | None = None
        self._course: ShapedCourse | None = None
        self._kinematics: Kinematics | None = None
        self._anchor: _Anchor | None = None
        self._written: tuple[int, ...] | None = None
        self._doubts = 0
        self._pulse: int | None = None

    @property
    def to_go(self) -> Position:
        """What is still to come of the corrections that are followed, m or rad."""
        return (0.0,) * len(self._names) if self._course is None else self._course.to_go

    @property
    def slowed(self) -> bool:
        """Whether a correction changes as fast as it may."""
        return self._course is not None and self._course.slowed

    def aim(self, positions: Sequence[float]) -> None:
        """Follow corrections of the joints, m or rad, from the next step on.

        Raises:
            InputError: they are not finite, larger than allowed, or for other axes.
        """
        self._limits.course.check(positions)
        self._target = tuple(positions)
        if self._course is not None:
            self._course.aim(positions)

    def halt(self) -> None:
        """Bring the corrections to rest and follow none until the next."""
        self._target = None
        if self._course is not None:
            self._course.halt()

    def blocked(self, reading: ControllerReading) -> str:
        """Why the controller takes up no counts now; empty where it does.

        What it makes of its numbers meanwhile is its own: they are taken anew after it, and no hand has changed them.
        """
        found = _blocked(reading)
        if found:
            self._anchor, self._written, self._doubts = None, None, 0
            self._target = self._course = None
        return found

    def step(self, reading: ControllerReading, kinematics: Kinematics, steady_ns: int) -> OffsetAction:
        """What to write now, given what the controller shows, at a time of a clock that never steps (ns)."""
        if blocked := self.blocked(reading):
            return OffsetAction(None, blocked)
        anchor = self._find_anchor(reading)
        if anchor is None:
            return OffsetAction(None, SETTLING)
        course = self._find_course(reading, kinematics)
        if course is None:
            return OffsetAction(None, WAITING)
        return self._follow(anchor, course.advance(steady_ns), reading, kinematics)

    def _find_course(self, reading: ControllerReading, kinematics: Kinematics) -> ShapedCourse | None:
        """The course from the corrections in effect to the target; none before the first."""
        if self._course is None and self._target is not None:
            self._course = ShapedCourse(
                self._limits.course, corrections_of(kinematics, reading.axes, reading.requested)
            )
            self._course.aim(self._target)
        elif self._course is not None and kinematics != self._kinematics:
            # Other kinematics reach the same place of the tool by other corrections.
            self._course.rebase(corrections_of(kinematics, reading.axes, reading.requested))
        self._kinematics = kinematics
        return self._course

    def _find_anchor(self, reading: ControllerReading) -> _Anchor | None:
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
            self._course = None  # it begins anew at what the other hand has left
        return self._anchor

    def _agrees(self, anchor: _Anchor, reading: ControllerReading) -> bool:
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

    def _follow(
        self, anchor: _Anchor, corrections: Position, reading: ControllerReading, kinematics: Kinematics
    ) -> OffsetAction:
        wanted = solve_offsets(kinematics, reading.axes, corrections)
        start = zip(anchor.counts, anchor.requested, strict=True)
        counts = tuple(
            then + round((value - number) / count)
            for value, count, (then, number) in zip(wanted, self._limits.count, start, strict=True)
        )
        if any(not -COUNTS_END <= number < COUNTS_END for number in counts):
            return OffsetAction(None, "the counts pins are at the end of their 32 bits: clear the external offsets")
        self._written = counts
        return OffsetAction(counts, "")


def _blocked(reading: ControllerReading) -> str:
    """Why the controller would not take up counts now; empty where it would."""
    if not reading.enabled:
        return "the machine is off"
    if not reading.homed:
        return "the machine is not homed"
    if not reading.coordinated:
        return "the machine is in joint mode"
    return ""


def corrections_of(kinematics: Kinematics, axes: Sequence[float], offsets: Sequence[float]) -> Position:
    """Corrections of the joints (m, rad) that `offsets` of the axes amount to while the program commands `axes`."""
    there = kinematics.to_joints([axis + offset for axis, offset in zip(axes, offsets, strict=True)])
    return tuple(moved - nominal for moved, nominal in zip(there, kinematics.to_joints(axes), strict=True))


def commanded_velocities(before: Sequence[float], now: Sequence[float], velocities: Sequence[float]) -> Position:
    """Velocities of joints that the program moves, 0 for the others, which only corrections move.

    A joint that stands would else seem to reverse with each small correction, and the correction with it.
    """
    return tuple(
        velocity if abs(position - last) > _STANDSTILL else 0.0
        for last, position, velocity in zip(before, now, velocities, strict=True)
    )
