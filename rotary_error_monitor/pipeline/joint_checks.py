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
from rotary_error_monitor.pipeline.joint_velocities import CONTRADICTED, UNCONFIRMED, JointVelocities
from rotary_error_monitor.signals.admission import LARGEST_ANGLE
from rotary_error_monitor.units import TURN

BEYOND_TRAVEL = "beyond its travel"
JUMP = "a jump"
FROZEN = "frozen"

OVERRUN = 0.01
"""Part of the travel by which an axis may be beyond it: soft limits stand a little outside the machining range."""

STAMP_JITTER = 5e-3
"""By how much two stamps of a controller that is not synchronised may differ from the times of its positions, s."""

STALL = 20e-3
"""How long a computer without real-time kernel may let a servo thread wait, s. It makes up for that at once, so an axis
in motion may be off its course by what it goes in that time; one that stands may not."""

SHORTEST_LOOK = 2e-3
"""Time, s, below which the rounding of positions hides how fast an axis goes."""

PACE_FADES = 0.1
"""Time, s, in which the pace of an axis is forgotten: longer than a stall."""

PAUSE = 0.5
"""A pause, s, after which a position elsewhere is no jump: the machine may have been off and moved or homed."""

SETTLED = 1.0
"""Time, s, without a jump after which a course that came back counts as the axes' own: a wrong one may pass by where
they can be."""

PROVEN = 0.5
"""Time, s, without a jump after which a course speaks against one that does not go on from it; a shorter one does not:
a driver that is not connected yet may say anything."""

LEAST_STEP = {"linear": 2e-5, "rotary": 2e-5}
"""What rounding in a controller may add to a position, m and rad."""

STANDING = {"linear": 1e-3, "rotary": 1e-3}
"""Way, m and rad, that an axis says it moves while its position stands, from which its position counts as frozen."""


LAG = 20e-3
"""Time constant of what filters velocities, s: what is said of an axis that came to stand fades with it."""


class _State(NamedTuple):
    """A joint state: stamp, timestamp (ns), and position of each axis, m or rad."""

    stamp_ns: int
    row: NDArray[np.float64]


class _Gap(NamedTuple):
    """A jump: the last two states of the course before it without its very last one, what came, and how far off."""

    before: tuple[_State, _State]
    after: _State
    axis: int
    off: float


class JointChecks:
    """Holds each joint state against what the machine's axes can do, in the order of the stamps.

    A jump says that what came before and what comes after it do not belong together, and what has less behind it is
    doubted. Mostly that is what comes after: nothing is believed until the position is back on a way that the axes can
    have gone, or the controller has paused. So an offset that came by a jump stays wrong however long it lasts. A
    beginning that lasted for less than `PROVEN` gives way to a course that does; and a single state that fits neither
    side, while the two sides fit each other, was itself wrong, or its stamp.

    An axis that stands at once, from a speed that its brakes cannot take away as fast, is frozen until it moves or the
    controller has paused, also where nothing is said of speeds. One that they can stop as fast as that may stand, or be
    frozen: its positions do not tell.

    Attributes:
        refused: joint states that were not believed, by reason.
        velocities: whether those say what the positions do.
        heard_ns: stamp of the last one, believed or not, timestamp (ns); none before the first.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._axes = machine.axes
        self._fastest = np.array([axis.fastest for axis in machine.axes])
        self._quickest = np.array([axis.quickest for axis in machine.axes])
        self._least = np.array([LEAST_STEP[axis.kind] for axis in machine.axes])
        self._per_turn = np.array([1.0 / TURN if axis.kind == "rotary" else 0.0 for axis in machine.axes])
        self._low, self._high = np.transpose([_reach(axis) for axis in machine.axes])
        self._none = np.zeros(len(machine.axes))
        self.refused: Counter[str] = Counter()
        self.velocities = JointVelocities(machine.axes, machine.monitored)
        self.reset()

    def reset(self) -> None:
        """Believe the next joint state wherever it is."""
        self.heard_ns: int | None = None
        self._recent: deque[_State] = deque()
        self._good: _State | None = None
        self._since_ns = 0
        self._proven = False
        self._gap: _Gap | None = None
        self._speed = np.full(len(self._axes), np.nan)
        self._pace = np.zeros(len(self._axes))
        self._away = ""
        self._back_ns: int | None = None
        self._doubtful = False
        self._until_ns: int | None = None
        self._jump_ns = 0
        self._still = np.zeros(len(self._axes))
        self._stands = np.zeros(len(self._axes), np.bool_)
        self._stood_ns = np.zeros(len(self._axes), np.int64)
        self._pace_said = self._fades_from = np.zeros(len(self._axes))
        self._abrupt = np.zeros(len(self._axes))
        self._suspect = False
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
        if not wrong:
            said = self._said(speeds)
            self._pace = np.maximum(self._pace, np.minimum(said, self._fastest))
            jumped, frozen = self._jumped(stamp_ns, row, paused=paused), self._frozen(stamp_ns, row, said)
            wrong = jumped or frozen
            self._remember(stamp_ns, row)
        if wrong:
            self.velocities.interrupt()
        else:
            wrong = self._contradicted(stamp_ns, row, speeds)
        if wrong:
            reason = next(name for name in (BEYOND_TRAVEL, JUMP, FROZEN, CONTRADICTED, UNCONFIRMED) if name in wrong)
            self.refused[reason] += 1
            self._doubtful = True
            return wrong
        if self._doubtful:
            self._doubtful, self._back_ns = False, stamp_ns
        if self._suspect:  # not yet for as long as a stall, but no place to come back to
            return ""
        if self._back_ns is None or stamp_ns - self._back_ns > SETTLED * 1e9:
            self._good, self._back_ns = self._recent[-1], None
        return ""

    def _contradicted(self, stamp_ns: int, row: NDArray[np.float64], speeds: Mapping[str, float]) -> str:
        """What is said against positions by the velocities that came with them."""
        said = None
        if speeds and not _are_signs(speeds):
            said = np.array([speeds.get(axis.letter, 0.0) for axis in self._axes])
        wrong = self.velocities.judge(stamp_ns, row, said)
        if wrong:  # no course that speaks against another, and no place to come back to
            self._since_ns, self._good = stamp_ns, None
        return wrong

    def _remember(self, stamp_ns: int, row: NDArray[np.float64]) -> None:
        """Keep the states of the time in which a stall shows, and at least the last four."""
        self._recent.append(_State(stamp_ns, row))
        while len(self._recent) > 4 and stamp_ns - self._recent[0].stamp_ns > PACE_FADES * 1e9:
            self._recent.popleft()

    def _beyond(self, row: NDArray[np.float64], unnamed: str | None) -> str:
        within = (row >= self._low) & (row <= self._high)  # false for what is no number
        if within.all():
            return ""
        which = next((i for i in np.flatnonzero(~within).tolist() if self._axes[i].letter != unnamed), None)
        if which is None:
            return ""
        axis, unit = self._axes[which], _unit(self._axes[which])
        low, high = axis.travel
        if _is_endless(axis):
            low, high = -LARGEST_ANGLE, LARGEST_ANGLE
        return f"axis {axis.letter} at {row[which]:.6g} {unit} is {BEYOND_TRAVEL} of {low:g} to {high:g} {unit}"

    def _jumped(self, stamp_ns: int, row: NDArray[np.float64], *, paused: bool) -> str:
        """A step that no axis makes since the last joint state, or since the last one that was believed."""
        if not self._recent or paused:
            self._away, self._speed = "", np.full(len(self._axes), np.nan)
            self._pace, self._abrupt, self._suspect = np.zeros(len(self._axes)), np.zeros(len(self._axes)), False
            self._back_ns, self._doubtful, self._gap = None, False, None
            self._recent.clear()
            self._since_ns = stamp_ns
            return ""
        last = self._recent[-1]
        passed = (stamp_ns - last.stamp_ns) * 1e-9
        step = self._steps(row - last.row)
        far = self._too_far(step, passed)
        speed = self._speed
        self._speed = np.where(self._still > 0.0, np.nan, step / passed)  # what it made up for is no speed
        if far is not None:
            moved = float(step[far])
            self._doubt(_State(stamp_ns, row), far, moved, passed, abs(moved - float(speed[far]) * passed))
            return self._away
        self._pace = np.fmax(self._pace * math.exp(-passed / PACE_FADES), np.abs(self._speed))
        if self._away:
            self._settle(stamp_ns, row)
        return self._away

    def _doubt(self, state: _State, axis: int, moved: float, passed: float, off: float) -> None:
        """Begin a course with an axis that moved, m or rad in s, and is so far off the course before."""
        described = self._axes[axis]
        unit = _unit(described)
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
        if self._is_reachable(state):
            self._away, self._doubtful = "", True

    def _settle(self, stamp_ns: int, row: NDArray[np.float64]) -> None:
        """Believe what came by a jump, where what was before the jump does not speak against it any longer."""
        gap, self._gap = self._gap, None
        if gap is not None and self._goes_on(gap, _State(stamp_ns, row)):
            self._away, self._good = "", gap.before[1]
        elif self._until_ns is not None and stamp_ns >= self._until_ns:
            # the beginning was wrong; or it is no further than the axis can go: its acceleration or the stamps are not
            # as stated
            self._away, self._since_ns = "", self._jump_ns
            self._doubtful, self._back_ns = False, None

    def _goes_on(self, gap: _Gap, fourth: _State) -> bool:
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

    def _too_far(self, step: NDArray[np.float64], passed: float) -> int | None:
        """Which axis went further than it can, from the speed that it had."""
        known = (self._speed.tolist(), self._pace.tolist(), self._still.tolist())
        for i, (axis, moved, speed, pace, still) in enumerate(zip(self._axes, step.tolist(), *known, strict=True)):
            if math.isnan(moved) or moved == 0.0:  # one that stands is no jump; `_frozen` looks at it
                continue
            # a controller that stalled repeats a position, says that it moves, and makes up for it afterwards
            furthest = axis.fastest * (passed + STAMP_JITTER) + LEAST_STEP[axis.kind] + 2.0 * still
            # a speed is not known before the second position; then it lacks what jitter of stamps makes of it
            allowed = axis.quickest * passed * (passed + STAMP_JITTER) + pace * STALL + 2.0 * still
            off = abs(moved - speed * passed) > allowed + LEAST_STEP[axis.kind]  # false for an unknown speed
            if abs(moved) > furthest or off:
                return i
        return None

    def _is_reachable(self, state: _State) -> bool:
        """Whether the axes can have come here from where they were believed last."""
        good = self._good
        # the jump was from the last state; and a single one is no course to come back to
        if good is None or good.stamp_ns == self._recent[-1].stamp_ns or good.stamp_ns <= self._since_ns:
            return False
        passed = (state.stamp_ns - good.stamp_ns) * 1e-9
        steps = self._steps(state.row - good.row)
        return bool((np.isnan(steps) | (np.abs(steps) <= self._fastest * (passed + STAMP_JITTER))).all())

    def _frozen(self, stamp_ns: int, row: NDArray[np.float64], said: NDArray[np.float64]) -> str:
        """Positions that stand while the controller says that the axes move, or though they cannot stop as fast."""
        if not self._recent:
            return ""
        last = self._recent[-1]
        stands = row == last.row
        if stands.tobytes() != self._stands.tobytes():
            begins = stands & ~self._stands
            unbraked = self._unbraked() if begins.any() else self._none
            self._abrupt = np.where(begins, unbraked, np.where(stands, self._abrupt, 0.0))
            self._stood_ns = np.where(begins, last.stamp_ns, self._stood_ns)
            self._stands, self._suspect = stands, bool(self._abrupt.any())
            self._fades_from = np.where(begins, self._pace_said, self._fades_from)
        self._pace_said = said
        fades = said <= self._fades_from * np.exp((self._stood_ns - stamp_ns) * (0.5e-9 / LAG))
        counts = stands & ~(fades & (said < self._fades_from))
        self._still += np.where(counts, said * min((stamp_ns - last.stamp_ns) * 1e-9, PAUSE), 0.0)
        self._still = np.where(stands, self._still, 0.0)
        for axis, way in zip(self._axes, self._still.tolist(), strict=True):
            if way > STANDING[axis.kind]:
                return f"axis {axis.letter} is {FROZEN}: it says that it moved {way:.3g} {_unit(axis)}, and stands"
        return self._stood_at_once(stamp_ns, last.stamp_ns) if self._suspect else ""

    def _stood_at_once(self, stamp_ns: int, last_ns: int) -> str:
        """Which axis stands though it cannot brake as fast, and for longer than may be.

        That is told twice over, for one that turns back may be told once at the same place on either way; and for
        longer than a controller stalls, which goes on after that.
        """
        for axis, since_ns, speed in zip(self._axes, self._stood_ns.tolist(), self._abrupt.tolist(), strict=True):
            if speed > 0.0 and since_ns < last_ns and (stamp_ns - since_ns) * 1e-9 > STALL + STAMP_JITTER:
                unit = _unit(axis)
                return (
                    f"axis {axis.letter} is {FROZEN}: it stood at once from {speed:.3g} {unit}/s, "
                    f"more than {axis.quickest:g} {unit}/s² can stop"
                )
        return ""

    def _unbraked(self) -> NDArray[np.float64]:
        """Speed, m/s or rad/s, with which each axis came to the last state, where it cannot stand there; 0 elsewhere.

        One that stands at the end of a time has gone no further in it than it needs for braking. The shorter the time,
        the slower a speed that tells; but stamps jitter.
        """
        speed = self._none
        if len(self._recent) < 4:
            return speed
        last = self._recent[-1]
        for shortest in (SHORTEST_LOOK, STAMP_JITTER):
            states = reversed(self._recent)
            count, start = next(
                (each for each in enumerate(states) if last.stamp_ns - each[1].stamp_ns >= shortest * 1e9), (0, last)
            )
            passed = (last.stamp_ns - start.stamp_ns) * 1e-9
            moved = np.abs(self._steps(last.row - start.row))
            if (moved > 0.5 * self._quickest * passed**2 + self._least).any():
                longest = self._braked(moved, passed, count)
                speed = np.maximum(speed, np.where(moved > longest, moved / max(passed, 1e-9), 0.0))
        return speed

    def _braked(self, moved: NDArray[np.float64], passed: float, count: int) -> NDArray[np.float64]:
        """Longest way, m or rad, of each axis in the last `count` steps, s in all, if it stands at their end."""
        times = np.diff([state.stamp_ns for state in self._recent])[:, None] * 1e-9
        speeds = self._steps(np.diff([state.row for state in self._recent], axis=0)) / times
        change = np.abs(np.diff(speeds, axis=0)) * times[1:]
        half = 0.5 * self._quickest * times[1:] ** 2
        # what it was off its course of late, a controller that stalled has to make up for; not what half its
        # acceleration explains, for the way for braking holds as much
        rough = np.fmax((change - half).max(axis=0), 0.0)
        # stamps are off by no more than shows, or than an acceleration may hide
        shown = count * (change.max(axis=0) + self._quickest * (passed / count) ** 2 + self._least)
        late = np.minimum(STAMP_JITTER, shown * passed / np.maximum(moved, self._least))
        return np.asarray(0.5 * self._quickest * (passed + late) ** 2 + self._least + rough)

    def _said(self, speeds: Mapping[str, float]) -> NDArray[np.float64]:
        """Pace of each axis as the controller says it, m/s or rad/s; 0 where it says nothing."""
        if _are_signs(speeds):
            return self._none
        return np.array([abs(speeds.get(axis.letter, 0.0)) for axis in self._axes]) if speeds else self._none

    def _steps(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps of the axes; a rotary one may be told modulo a turn."""
        return np.asarray(difference - TURN * np.rint(difference * self._per_turn))


def _are_signs(speeds: Mapping[str, float]) -> bool:
    """Whether these are signs of the travel, as recordings of static poses have them."""
    return len(speeds) > 1 and {abs(speed) for speed in speeds.values()} == {1.0}


def _unit(axis: Axis) -> str:
    return "m" if axis.kind == "linear" else "rad"


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
