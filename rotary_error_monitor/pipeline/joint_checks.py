"""The one place where a joint state is believed: within the travel, no faster than the axes, and alive."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import Axis, MachineDescription
from rotary_error_monitor.signals.admission import LARGEST_ANGLE, TURN

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

PACE_FADES = 0.1
"""Time, s, in which the pace of an axis is forgotten: longer than a stall."""

PAUSE = 0.5
"""A pause, s, after which a position elsewhere is no jump: the machine may have been off and moved or homed."""

SETTLED = 1.0
"""Time, s, without a jump after which a course that came back counts as the axes' own: a wrong one may pass by where
they can be."""

LEAST_STEP = {"linear": 2e-5, "rotary": 2e-5}
"""What rounding in a controller may add to a position, m and rad."""

STANDING = {"linear": 1e-3, "rotary": 1e-3}
"""Way, m and rad, that an axis says it moves while its position stands, from which its position counts as frozen."""


class JointChecks:
    """Holds each joint state against what the machine's axes can do, in the order of the stamps.

    After a jump nothing is believed until the position is back on a way that the axes can have gone, or the controller
    has paused: an offset that came by a jump stays wrong however long it lasts.

    Attributes:
        refused: joint states that were not believed, by reason.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._axes = machine.axes
        self._fastest = np.array([axis.fastest for axis in machine.axes])
        self.refused: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """Believe the next joint state wherever it is."""
        self._heard_ns: int | None = None
        self._last_ns: int | None = None
        self._good_ns: int | None = None
        self._last: NDArray[np.float64] | None = None
        self._good: NDArray[np.float64] | None = None
        self._speed = np.full(len(self._axes), np.nan)
        self._pace = np.zeros(len(self._axes))
        self._away = ""
        self._back_ns: int | None = None
        self._doubtful = False
        self._until_ns: int | None = None
        self._still = np.zeros(len(self._axes))

    def judge(self, stamp_ns: int, row: NDArray[np.float64], speeds: Mapping[str, float]) -> str:
        """Why a joint state is not believed; empty where it is.

        Args:
            stamp_ns: its stamp, after that of the one before, timestamp (ns).
            row: position of each axis, m or rad; NaN for an axis that it does not name.
            speeds: of the axes by their letters, as far as it says them, m/s or rad/s.
        """
        paused = self._heard_ns is not None and stamp_ns - self._heard_ns > PAUSE * 1e9
        self._heard_ns = stamp_ns
        wrong = self._beyond(row)
        if not wrong:
            said = self._said(speeds)
            self._pace = np.maximum(self._pace, np.minimum(said, self._fastest))
            wrong = self._jumped(stamp_ns, row, paused=paused) or self._frozen(stamp_ns, row, said)
            self._last_ns, self._last = stamp_ns, row
        if wrong:
            reason = next(name for name in (BEYOND_TRAVEL, JUMP, FROZEN) if name in wrong)
            self.refused[reason] += 1
            self._doubtful = True
            return wrong
        if self._doubtful:
            self._doubtful, self._back_ns = False, stamp_ns
        if self._back_ns is None or stamp_ns - self._back_ns > SETTLED * 1e9:
            self._good_ns, self._good, self._back_ns = stamp_ns, row, None
        return ""

    def _beyond(self, row: NDArray[np.float64]) -> str:
        for axis, position in zip(self._axes, row.tolist(), strict=True):
            low, high = axis.travel
            margin = OVERRUN * (high - low)
            if axis.kind == "rotary" and high - low >= TURN - 1e-9:
                low, high, margin = -LARGEST_ANGLE, LARGEST_ANGLE, 0.0  # it may turn on and on
            if not math.isnan(position) and not low - margin <= position <= high + margin:
                unit = "m" if axis.kind == "linear" else "rad"
                return f"axis {axis.letter} at {position:.6g} {unit} is {BEYOND_TRAVEL} of {low:g} to {high:g} {unit}"
        return ""

    def _jumped(self, stamp_ns: int, row: NDArray[np.float64], *, paused: bool) -> str:
        """A step that no axis makes since the last joint state, or since the last one that was believed."""
        last_ns, last = self._last_ns, self._last
        if last_ns is None or last is None or paused:
            self._away, self._speed = "", np.full(len(self._axes), np.nan)
            self._pace = np.zeros(len(self._axes))
            self._back_ns, self._doubtful = None, False
            return ""
        passed = (stamp_ns - last_ns) * 1e-9
        step = self._steps(row - last)
        far = self._too_far(step, passed)
        self._speed = np.where(self._still > 0.0, np.nan, step / passed)  # what it made up for is no speed
        if far is None:
            self._pace = np.fmax(self._pace * math.exp(-passed / PACE_FADES), np.abs(self._speed))
        else:
            axis, size = far
            self._speed = np.full(len(self._axes), np.nan)
            self._away = f"axis {axis.letter} made {JUMP} of {size:.3g} {_unit(axis)} within {passed * 1e3:.3g} ms"
            within_speed = abs(size) <= axis.fastest * (passed + STAMP_JITTER)
            self._until_ns = stamp_ns + round(SETTLED * 1e9) if within_speed else None
            if self._reachable(stamp_ns, row):
                self._away, self._doubtful = "", True
        if far is None and self._away and self._until_ns is not None and stamp_ns >= self._until_ns:
            self._away = ""  # no further than the axis can go: its acceleration or the stamps are not as stated
        return self._away

    def _too_far(self, step: NDArray[np.float64], passed: float) -> tuple[Axis, float] | None:
        """The axis that went further than it can, from the speed that it had."""
        known = (self._speed.tolist(), self._pace.tolist(), self._still.tolist())
        for axis, moved, speed, pace, still in zip(self._axes, step.tolist(), *known, strict=True):
            if math.isnan(moved) or moved == 0.0:  # one that stands is no jump, though it stopped at once
                continue
            # a controller that stalled repeats a position, says that it moves, and makes up for it afterwards
            furthest = axis.fastest * (passed + STAMP_JITTER) + LEAST_STEP[axis.kind] + 2.0 * still
            # a speed is not known before the second position; then it lacks what jitter of stamps makes of it
            allowed = axis.quickest * passed * (passed + STAMP_JITTER) + pace * STALL + 2.0 * still
            off = abs(moved - speed * passed) > allowed + LEAST_STEP[axis.kind]  # false for an unknown speed
            if abs(moved) > furthest or off:
                return axis, moved
        return None

    def _reachable(self, stamp_ns: int, row: NDArray[np.float64]) -> bool:
        """Whether the axes can have come here from where they were believed last."""
        if self._good_ns is None or self._good is None or self._good_ns == self._last_ns:
            return False
        passed = (stamp_ns - self._good_ns) * 1e-9
        steps = self._steps(row - self._good)
        return all(
            math.isnan(step) or abs(step) <= axis.fastest * (passed + STAMP_JITTER)
            for axis, step in zip(self._axes, steps.tolist(), strict=True)
        )

    def _frozen(self, stamp_ns: int, row: NDArray[np.float64], said: NDArray[np.float64]) -> str:
        """Positions that stand while the controller says that the axes move."""
        if self._last is None or self._last_ns is None:
            return ""
        passed = min((stamp_ns - self._last_ns) * 1e-9, PAUSE)
        self._still = np.where(row == self._last, self._still + said * passed, 0.0)
        for axis, way in zip(self._axes, self._still.tolist(), strict=True):
            if way > STANDING[axis.kind]:
                return f"axis {axis.letter} is {FROZEN}: it says that it moved {way:.3g} {_unit(axis)}, and stands"
        return ""

    def _said(self, speeds: Mapping[str, float]) -> NDArray[np.float64]:
        """Pace of each axis as the controller says it, m/s or rad/s; 0 where it says nothing."""
        if len(speeds) > 1 and {abs(speed) for speed in speeds.values()} == {1.0}:
            return np.zeros(len(self._axes))  # signs of the travel, as recordings of static poses have them
        return np.array([abs(speeds.get(axis.letter, 0.0)) for axis in self._axes])

    def _steps(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Steps of the axes; a rotary one may be told modulo a turn."""
        rotary = np.array([axis.kind == "rotary" for axis in self._axes])
        turned = difference - TURN * np.rint(difference / TURN)
        return np.asarray(np.where(rotary, turned, difference))


def _unit(axis: Axis) -> str:
    return "m" if axis.kind == "linear" else "rad"
