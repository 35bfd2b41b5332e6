"""Axes whose positions stand though they move: the controller says so, or they cannot have stopped as fast."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.pipeline.joint_positions import AxisSteps, JointPositions

FROZEN = "frozen"

STAMP_JITTER = 5e-3
"""By how much two stamps of a controller that is not synchronised may differ from the times of its positions, s."""

STALL = 20e-3
"""How long a computer without real-time kernel may let a servo thread wait, s. It makes up for that at once, so an axis
in motion may be off its course by what it goes in that time; one that stands may not."""

SHORTEST_LOOK = 2e-3
"""Time, s, below which the rounding of positions hides how fast an axis goes."""

PAUSE = 0.5
"""A pause, s, after which a position elsewhere is no jump: the machine may have been off and moved or homed."""

LEAST_STEP = {"linear": 2e-5, "rotary": 2e-5}
"""What rounding in a controller may add to a position, m and rad."""

STANDING = {"linear": 1e-3, "rotary": 1e-3}
"""Way, m and rad, that an axis says it moves while its position stands, from which its position counts as frozen."""

LAG = 20e-3
"""Time constant of what filters velocities, s: what is said of an axis that came to stand fades with it."""


class JointFreezes:
    """Looks at axes that stand.

    An axis that stands at once, from a speed that its brakes cannot take away as fast, is frozen until it moves or the
    controller has paused, also where nothing is said of speeds. One that they can stop as fast as that may stand, or be
    frozen: its positions do not tell.

    Attributes:
        still: way that each axis says it moved while it stands, m or rad.
        suspect: whether one came to stand faster than it can, though not yet for as long as a controller stalls.
    """

    def __init__(self, axes: Sequence[Axis]) -> None:
        self._axes = axes
        self._quickest = np.array([axis.quickest for axis in axes])
        self._least = np.array([LEAST_STEP[axis.kind] for axis in axes])
        self._steps = AxisSteps(axes)
        self._none = np.zeros(len(axes))
        self.reset()

    def reset(self) -> None:
        """No axis stands."""
        self.still = np.zeros(len(self._axes))
        self._stands = np.zeros(len(self._axes), np.bool_)
        self._stood_ns = np.zeros(len(self._axes), np.int64)
        self._pace_said = self._fades_from = np.zeros(len(self._axes))
        self.pause()

    def pause(self) -> None:
        """The controller has paused: the axes may have stopped meanwhile."""
        self._abrupt, self.suspect = np.zeros(len(self._axes)), False

    def judge(self, state: JointPositions, said: Array, recent: Sequence[JointPositions]) -> str:
        """Which axis is frozen; empty where none is.

        Args:
            state: what came.
            said: pace of each axis as the controller says it, m/s or rad/s; 0 where it says nothing.
            recent: states before it, the last one at the end; none where nothing is known of them.
        """
        if not recent:
            return ""
        (stamp_ns, row), last = state, recent[-1]
        stands = row == last.row
        if stands.tobytes() != self._stands.tobytes():
            begins = stands & ~self._stands
            unbraked = self._unbraked(recent) if begins.any() else self._none
            self._abrupt = np.where(begins, unbraked, np.where(stands, self._abrupt, 0.0))
            self._stood_ns = np.where(begins, last.stamp_ns, self._stood_ns)
            self._stands, self.suspect = stands, bool(self._abrupt.any())
            self._fades_from = np.where(begins, self._pace_said, self._fades_from)
        self._pace_said = said
        if not stands.any():  # as mostly: nothing below is about an axis that moves
            self.still = np.zeros(len(self._axes))
            return ""
        fades = said <= self._fades_from * np.exp((self._stood_ns - stamp_ns) * (0.5e-9 / LAG))
        counts = stands & ~(fades & (said < self._fades_from))
        self.still += np.where(counts, said * min((stamp_ns - last.stamp_ns) * 1e-9, PAUSE), 0.0)
        self.still = np.where(stands, self.still, 0.0)
        for axis, way in zip(self._axes, self.still.tolist(), strict=True):
            if way > STANDING[axis.kind]:
                return f"axis {axis.letter} is {FROZEN}: it says that it moved {way:.3g} {unit_of(axis)}, and stands"
        return self._stood_at_once(stamp_ns, last.stamp_ns) if self.suspect else ""

    def _stood_at_once(self, stamp_ns: int, last_ns: int) -> str:
        """Which axis stands though it cannot brake as fast, and for longer than may be.

        That is told twice over, for one that turns back may be told once at the same place on either way; and for
        longer than a controller stalls, which goes on after that.
        """
        for axis, since_ns, speed in zip(self._axes, self._stood_ns.tolist(), self._abrupt.tolist(), strict=True):
            if speed > 0.0 and since_ns < last_ns and (stamp_ns - since_ns) * 1e-9 > STALL + STAMP_JITTER:
                unit = unit_of(axis)
                return (
                    f"axis {axis.letter} is {FROZEN}: it stood at once from {speed:.3g} {unit}/s, "
                    f"more than {axis.quickest:g} {unit}/s² can stop"
                )
        return ""

    def _unbraked(self, recent: Sequence[JointPositions]) -> Array:
        """Speed, m/s or rad/s, with which each axis came to the last state, where it cannot stand there; 0 elsewhere.

        One that stands at the end of a time has gone no further in it than it needs for braking. The shorter the time,
        the slower a speed that tells; but stamps jitter.
        """
        speed = self._none
        if len(recent) < 4:
            return speed
        last = recent[-1]
        for shortest in (SHORTEST_LOOK, STAMP_JITTER):
            states = reversed(recent)
            count, start = next(
                (each for each in enumerate(states) if last.stamp_ns - each[1].stamp_ns >= shortest * 1e9), (0, last)
            )
            passed = (last.stamp_ns - start.stamp_ns) * 1e-9
            moved = np.abs(self._steps(last.row - start.row))
            if (moved > 0.5 * self._quickest * passed**2 + self._least).any():
                longest = self._braked(recent, moved, passed, count)
                speed = np.maximum(speed, np.where(moved > longest, moved / max(passed, 1e-9), 0.0))
        return speed

    def _braked(self, recent: Sequence[JointPositions], moved: Array, passed: float, count: int) -> Array:
        """Longest way, m or rad, of each axis in the last `count` steps, s in all, if it stands at their end."""
        times = np.diff([state.stamp_ns for state in recent])[:, None] * 1e-9
        speeds = self._steps(np.diff([state.row for state in recent], axis=0)) / times
        change = np.abs(np.diff(speeds, axis=0)) * times[1:]
        half = 0.5 * self._quickest * times[1:] ** 2
        # what it was off its course of late, a controller that stalled has to make up for; not what half its
        # acceleration explains, for the way for braking holds as much
        rough = np.fmax((change - half).max(axis=0), 0.0)
        # stamps are off by no more than shows, or than an acceleration may hide
        shown = count * (change.max(axis=0) + self._quickest * (passed / count) ** 2 + self._least)
        late = np.minimum(STAMP_JITTER, shown * passed / np.maximum(moved, self._least))
        return np.asarray(0.5 * self._quickest * (passed + late) ** 2 + self._least + rough)


def unit_of(axis: Axis) -> str:
    """Unit of its positions."""
    return "m" if axis.kind == "linear" else "rad"
