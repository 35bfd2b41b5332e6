"""The one place where a joint state is believed: within the travel, no faster than the axes, and alive."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.pipeline.joint_freezes import (
    FROZEN,
    LEAST_STEP,
    PAUSE,
    STALL,
    STAMP_JITTER,
    JointFreezes,
    unit_of,
)
from rotary_error_monitor.pipeline.joint_positions import AxisSteps, JointPositions
from rotary_error_monitor.pipeline.joint_stands import JointStands
from rotary_error_monitor.pipeline.joint_velocities import CONTRADICTED, UNCONFIRMED, JointVelocities
from rotary_error_monitor.signals.admission import LARGEST_ANGLE
from rotary_error_monitor.units import TURN

BEYOND_TRAVEL = "beyond its travel"
JUMP = "a jump"

OVERRUN = 0.01
"""Part of the travel by which an axis may be beyond it: soft limits stand a little outside the machining range."""

PACE_FADES = 0.1
"""Time, s, in which the pace of an axis is forgotten: longer than a stall."""

SETTLED = 1.0
"""Time, s, without a jump after which a course that came back counts as the axes' own: a wrong one may pass by where
they can be."""

PROVEN = 0.5
"""Time, s, without a jump after which a course speaks against one that does not go on from it; a shorter one does not:
a driver that is not connected yet may say anything."""

MOST_JUMPS = 4
"""Jumps within `PROVEN` after which a course that is back has to last for that time as well: there and back, and once
more by chance. What jumps on and on may be on either side."""


class _Gap(NamedTuple):
    """A jump: the last two states of the course before it without its very last one, what came, and how far off."""

    before: tuple[JointPositions, JointPositions]
    after: JointPositions
    axis: int
    off: float


class JointChecks:
    """Holds each joint state against what the machine's axes can do, in the order of the stamps.

    A jump says that what came before and what comes after it do not belong together, and what has less behind it is
    doubted. Mostly that is what comes after: nothing is believed until the position is back on a way that the axes can
    have gone, or the controller has paused. So an offset that came by a jump stays wrong however long it lasts; but
    axes that stood before it, and are where they would have come to meanwhile, were frozen (`joint_stands`). A
    beginning that lasted for less than `PROVEN` gives way to a course that does; and a single state that fits neither
    side, while the two sides fit each other, was itself wrong, or its stamp. Axes that jump on and on are not believed
    by turns. What stands though it moves is frozen (`joint_freezes`).

    Attributes:
        refused: joint states that were not believed, by reason.
        velocities: whether those say what the positions do.
        heard_ns: stamp of the last one, believed or not, timestamp (ns); none before the first.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._axes = machine.axes
        self._can = [(axis.fastest, axis.quickest, LEAST_STEP[axis.kind]) for axis in machine.axes]
        self._fastest = np.array([axis.fastest for axis in machine.axes])
        self._steps = AxisSteps(machine.axes)
        self._low, self._high = np.transpose([_reach(axis) for axis in machine.axes])
        self._none = np.zeros(len(machine.axes))
        self.refused: Counter[str] = Counter()
        self.velocities = JointVelocities(machine.axes, machine.monitored)
        self._freezes = JointFreezes(machine.axes)
        self._standing = JointStands(machine.axes)
        self.reset()

    def reset(self) -> None:
        """Believe the next joint state wherever it is."""
        self.heard_ns: int | None = None
        self._recent: deque[JointPositions] = deque()
        self._good: JointPositions | None = None
        self._since_ns = 0
        self._proven = False
        self._gap: _Gap | None = None
        self._speed = np.full(len(self._axes), np.nan)
        self._pace = np.zeros(len(self._axes))
        self._away = ""
        self._back_ns: int | None = None
        self._doubtful = False
        self._until_ns: int | None = None
        self._jump_ns = -1
        self._jumps_ns: deque[int] = deque()
        self._is_back = False
        self._freezes.reset()
        self.velocities.reset()

    def judge(
        self, stamp_ns: int, row: NDArray[np.float64], speeds: Mapping[str, float], unnamed: str | None = None
    ) -> str:
        """Why a joint state is not believed; empty where it is.

        Args:
            stamp_ns: its stamp, after that of the one before, timestamp (ns).
            row: position of each axis, m or rad; NaN for an axis that it does not name.
            speeds: of the axes by their letters, as far as it says them, m/s or rad/s.
            unnamed: letter of the axis that it does not name.
        """
        paused = self.heard_ns is not None and stamp_ns - self.heard_ns > PAUSE * 1e9
        self.heard_ns = stamp_ns
        if paused:
            self.velocities.pause()
        wrong = self._beyond(row, unnamed)
        velocities = None if wrong else self._velocities(speeds)
        if not wrong:
            said = self._none if velocities is None else np.abs(velocities)
            self._pace = np.maximum(self._pace, np.minimum(said, self._fastest))
            jumped = self._jumped(stamp_ns, row, paused=paused)
            frozen = self._freezes.judge(JointPositions(stamp_ns, row), said, self._recent)
            wrong = jumped or frozen
            self._remember(stamp_ns, row)
        if wrong:
            self.velocities.interrupt()
        else:
            wrong = self._contradicted(stamp_ns, row, velocities)
        if wrong:
            reason = next(name for name in (BEYOND_TRAVEL, JUMP, FROZEN, CONTRADICTED, UNCONFIRMED) if name in wrong)
            self.refused[reason] += 1
            self._doubtful = True
            return wrong
        if self._doubtful:
            self._doubtful, self._back_ns = False, stamp_ns
        if self._freezes.suspect:  # not yet for as long as a stall, but no place to come back to
            return ""
        if self._back_ns is None or stamp_ns - self._back_ns > SETTLED * 1e9:
            self._good, self._back_ns = self._recent[-1], None
        return ""

    def _contradicted(self, stamp_ns: int, row: NDArray[np.float64], velocities: NDArray[np.float64] | None) -> str:
        """What is said against positions by the velocities (axes,) that came with them."""
        wrong = self.velocities.judge(stamp_ns, row, velocities)
        if wrong:  # no course that speaks against another, and no place to come back to
            self._since_ns, self._good = stamp_ns, None
        return wrong

    def _remember(self, stamp_ns: int, row: NDArray[np.float64]) -> None:
        """Keep the states of the time in which a stall shows, and at least the last four."""
        self._recent.append(JointPositions(stamp_ns, row))
        while len(self._recent) > 4 and stamp_ns - self._recent[0].stamp_ns > PACE_FADES * 1e9:
            self._recent.popleft()

    def _beyond(self, row: NDArray[np.float64], unnamed: str | None) -> str:
        within = (row >= self._low) & (row <= self._high)  # false for what is no number
        if within.all():
            return ""
        which = next((i for i in np.flatnonzero(~within).tolist() if self._axes[i].letter != unnamed), None)
        if which is None:
            return ""
        axis, unit = self._axes[which], unit_of(self._axes[which])
        low, high = axis.travel
        if _is_endless(axis):
            low, high = -LARGEST_ANGLE, LARGEST_ANGLE
        return f"axis {axis.letter} at {row[which]:.6g} {unit} is {BEYOND_TRAVEL} of {low:g} to {high:g} {unit}"

    def _jumped(self, stamp_ns: int, row: NDArray[np.float64], *, paused: bool) -> str:
        """A step that no axis makes since the last joint state, or since the last one that was believed."""
        if not self._recent or paused:
            self._away, self._speed = "", np.full(len(self._axes), np.nan)
            self._standing.reset()
            self._pace = np.zeros(len(self._axes))
            self._freezes.pause()
            self._back_ns, self._doubtful, self._gap = None, False, None
            self._recent.clear()
            self._since_ns = stamp_ns
            return ""
        last = self._recent[-1]
        passed = (stamp_ns - last.stamp_ns) * 1e-9
        step = self._steps(row - last.row)
        far = self._too_far(step, passed)
        if far:
            self._standing.jumped(last.stamp_ns, stamp_ns, row, far)
        self._standing.note(stamp_ns, row, step, passed)
        speed = self._speed
        self._speed = np.where(self._freezes.still > 0.0, np.nan, step / passed)  # what it made up for is no speed
        if far:
            first, moved = far[0], float(step[far[0]])
            self._doubt(JointPositions(stamp_ns, row), first, moved, passed, abs(moved - float(speed[first]) * passed))
            return self._away
        self._pace = self._pace * math.exp(-passed / PACE_FADES)
        if last.stamp_ns != self._jump_ns:  # what goes back from a jump is no pace
            self._pace = np.fmax(self._pace, np.abs(self._speed))
        if self._away:
            self._settle(stamp_ns, row)
        return self._away

    def _doubt(self, state: JointPositions, axis: int, moved: float, passed: float, off: float) -> None:
        """Begin a course with an axis that moved, m or rad in s, and is so far off the course before."""
        described = self._axes[axis]
        unit = unit_of(described)
        new = not self._away
        if new:
            self._proven = self._recent[-1].stamp_ns - self._since_ns >= PROVEN * 1e9
        # with an unknown speed before it no course can go on; nor is it a single state that is wrong where jumps repeat
        sole = new and len(self._recent) >= 3 and not math.isnan(off)
        self._gap = _Gap((self._recent[-3], self._recent[-2]), state, axis, off) if sole else None
        self._speed = np.full(len(self._axes), np.nan)
        self._away = f"axis {described.letter} made {JUMP} of {moved:.3g} {unit} within {passed * 1e3:.3g} ms"
        within_speed = abs(moved) <= described.fastest * (passed + STAMP_JITTER)
        wait = PROVEN if not self._proven else SETTLED if within_speed else None
        self._until_ns = None if wait is None else state.stamp_ns + round(wait * 1e9)
        self._jump_ns = state.stamp_ns
        while self._jumps_ns and state.stamp_ns - self._jumps_ns[0] > PROVEN * 1e9:
            self._jumps_ns.popleft()
        self._jumps_ns.append(state.stamp_ns)
        self._is_back = self._is_reachable(state)
        if self._is_back and len(self._jumps_ns) <= MOST_JUMPS:
            self._away, self._doubtful = "", True

    def _settle(self, stamp_ns: int, row: NDArray[np.float64]) -> None:
        """Believe what came by a jump, where what was before the jump does not speak against it any longer."""
        gap, self._gap = self._gap, None
        if gap is not None and self._goes_on(gap, JointPositions(stamp_ns, row)):
            self._away, self._good = "", gap.before[1]
        elif self._is_back and stamp_ns - self._jump_ns >= PROVEN * 1e9:
            self._away, self._doubtful = "", True
        elif self._standing.were_frozen(stamp_ns, row):
            self._away, self._since_ns, self._good = "", self._jump_ns, None
        elif self._until_ns is not None and stamp_ns >= self._until_ns:
            # the beginning was wrong; or it is no further than the axis can go: its acceleration or the stamps are not
            # as stated
            self._away, self._since_ns = "", self._jump_ns
            self._doubtful, self._back_ns = False, None

    def _goes_on(self, gap: _Gap, fourth: JointPositions) -> bool:
        """Whether the course before a jump, without its last state, goes on in the two states after the jump.

        Between the middles of two steps an axis goes with the mean of their speeds, unless its acceleration changes.
        """
        (first, second), third = gap.before, gap.after
        ahead = self._steps(second.row - first.row)
        between = self._steps(third.row - second.row)
        behind = self._steps(fourth.row - third.row)
        times = [(b.stamp_ns - a.stamp_ns) * 1e-9 for a, b in ((first, second), (second, third), (third, fourth))]
        speed = 0.5 * (ahead / times[0] + behind / times[2])
        off = np.abs(0.5 * ahead + between + 0.5 * behind - speed * (0.5 * times[0] + times[1] + 0.5 * times[2]))
        can = np.isnan(between) | (np.abs(between) <= self._fastest * (times[1] + STAMP_JITTER))
        return bool(can.all() and off[gap.axis] < 0.5 * gap.off)

    def _too_far(self, step: NDArray[np.float64], passed: float) -> list[int]:
        """Which axes went further than they can, from the speed that they had."""
        found = []
        known = (self._speed.tolist(), self._pace.tolist(), self._freezes.still.tolist())
        about = passed + STAMP_JITTER
        for i, (can, moved, speed, pace, still) in enumerate(zip(self._can, step.tolist(), *known, strict=True)):
            if math.isnan(moved) or moved == 0.0:  # one that stands is no jump; `_frozen` looks at it
                continue
            fastest, quickest, least = can
            # a controller that stalled repeats a position, says that it moves, and makes up for it afterwards
            furthest = fastest * about + least + 2.0 * still
            # a speed is not known before the second position; then it lacks what jitter of stamps makes of it
            allowed = quickest * passed * about + pace * STALL + 2.0 * still
            off = abs(moved - speed * passed) > allowed + least  # false for an unknown speed
            if abs(moved) > furthest or off:
                found.append(i)
        return found

    def _is_reachable(self, state: JointPositions) -> bool:
        """Whether the axes can have come here from where they were believed last."""
        good = self._good
        # the jump was from the last state; and a single one is no course to come back to
        if good is None or good.stamp_ns == self._recent[-1].stamp_ns or good.stamp_ns <= self._since_ns:
            return False
        passed = (state.stamp_ns - good.stamp_ns) * 1e-9
        steps = self._steps(state.row - good.row)
        return bool((np.isnan(steps) | (np.abs(steps) <= self._fastest * (passed + STAMP_JITTER))).all())

    def _velocities(self, speeds: Mapping[str, float]) -> NDArray[np.float64] | None:
        """(axes,) velocities as the controller says them, m/s or rad/s, 0 where it says nothing of an axis."""
        if not speeds or _are_signs(speeds):
            return None
        return np.array([speeds.get(axis.letter, 0.0) for axis in self._axes])


def _are_signs(speeds: Mapping[str, float]) -> bool:
    """Whether these are signs of the travel, as recordings of static poses have them."""
    return len(speeds) > 1 and all(abs(speed) == 1.0 for speed in speeds.values())


def _is_endless(axis: Axis) -> bool:
    """Whether it may turn on and on."""
    return axis.kind == "rotary" and axis.travel[1] - axis.travel[0] >= TURN - 1e-9


def _reach(axis: Axis) -> tuple[float, float]:
    """Lowest and highest position, m or rad, at which an axis is believed."""
    if _is_endless(axis):
        return -LARGEST_ANGLE, LARGEST_ANGLE
    low, high = axis.travel
    margin = OVERRUN * (high - low)
    return low - margin, high + margin
