"""Whether axes that stood and then jumped were frozen: they are where they would have come to in the meantime."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.pipeline.joint_positions import AxisSteps

SHORTEST_NS, LONGEST_NS = 20_000_000, 2_000_000_000
"""Times for which an axis stood, ns: in less its course before a jump tells more, and for longer no axis keeps to the
mean of the speeds before and behind."""

LOOK_NS = 50_000_000
"""Time, ns, from which the speed behind a jump shows beside the jitter of stamps."""

CLOSE = 0.5
"""Part of a jump by which it may be off that course, as where a single state is told from a jump."""


class _Jump(NamedTuple):
    """A jump of axes that stood: where and when to, which of them, and for each since when, where, and how fast."""

    stamp_ns: int
    row: Array
    which: NDArray[np.intp]
    since_ns: NDArray[np.int64]
    place: Array
    speed: Array


class JointStands:
    """Keeps how axes came to stand, and holds what comes behind a jump against it.

    An axis that truly stood and whose position was set elsewhere is not where the mean of the speeds before and behind
    takes it: it did not move, or not as far.
    """

    def __init__(self, axes: Sequence[Axis]) -> None:
        self._fastest = np.array([axis.fastest for axis in axes])
        self._steps = AxisSteps(axes)
        self.reset()

    def reset(self) -> None:
        """Nothing was seen."""
        count = len(self._fastest)
        self._since_ns = np.zeros(count, np.int64)
        self._place, self._speed = np.full(count, np.nan), np.full(count, np.nan)
        self._jump: _Jump | None = None

    def note(self, stamp_ns: int, row: Array, step: Array, passed: float) -> None:
        """Take in a state and its steps (m, rad) since the last one, s."""
        moves = step != 0.0
        if moves.any():
            self._since_ns = np.where(moves, stamp_ns, self._since_ns)
            self._place = np.where(moves, row, self._place)
            self._speed = np.where(moves, step / passed, self._speed)

    def jumped(self, last_ns: int, stamp_ns: int, row: Array, which: list[int]) -> None:
        """Take in a state to which some axes jumped from the last one, whose stamp (ns) is that."""
        axes = np.array(which)
        since_ns = self._since_ns[axes]
        stood_ns = last_ns - since_ns
        speed = self._speed[axes]
        told = bool((np.isfinite(speed) & (stood_ns >= SHORTEST_NS) & (stood_ns <= LONGEST_NS)).all())
        found = _Jump(stamp_ns, row, axes, since_ns, self._place[axes], speed)
        self._jump = found if told else None

    def were_frozen(self, stamp_ns: int, row: Array) -> bool:
        """Whether a state shows that the axes of the last jump moved on while they seemed to stand; asked once."""
        jump = self._jump
        if jump is None or stamp_ns - jump.stamp_ns < LOOK_NS:
            return False
        self._jump = None
        speed = self._steps(row - jump.row)[jump.which] / ((stamp_ns - jump.stamp_ns) * 1e-9)
        time = (jump.stamp_ns - jump.since_ns) * 1e-9
        way, expected = jump.row[jump.which] - jump.place, 0.5 * (jump.speed + speed) * time
        off = self._steps(way - expected, jump.which)
        near = np.abs(off) < CLOSE * np.abs(self._steps(way, jump.which))
        return bool((near & (np.abs(expected + off) <= self._fastest[jump.which] * time)).all())
