"""Whether the velocities of joint states say what their positions do: one sign, one unit, one axis for both."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.pipeline.joint_positions import AxisSteps

CONTRADICTED = "against its velocity"
UNCONFIRMED = "not held against its velocity yet"

BLOCK_NS = 10_000_000
"""Joint states are looked at together for this time at least, ns: at 1 kHz each by itself says little."""

LAG_NS = 30_000_000
"""By how much velocities may be behind or ahead of positions, ns: a filter of 20 ms, or the lag of a servo loop."""

LOOKS_NS = (40_000_000, 80_000_000, 160_000_000, 320_000_000)
"""Times, ns, over which ways are held against velocities: the shortest tells a sign, the longest a slow axis."""

UNSTEADY = 0.03
"""Time, s, by whose motion an axis may be off: two stamps by 5 ms each, and a servo thread that waits for 20 ms."""

STOOD_NS = 20_000_000
"""An axis that stood for this long, ns, makes up for a stall when it moves: that step is not held against it."""

LEAST_WAY = 4e-5
"""What rounding in a controller may add to a way between two positions, m or rad."""

SLOW = 2e-3
"""Part of its fastest speed by which what a driver says of an axis may be off: of 0.5 m/s 1 mm/s."""

BURST = 0.1
"""Time, s, in which an axis starts and stops at its full acceleration at most once between two joint states."""

COURSE = 3
"""Joint states without a pause between them before a pause is one: fewer are the controller's own slow pace."""

SMOOTH, ABRUPT = 0.25, 0.5
"""Parts of a contradiction: what changes its speed from state to state by less than the one goes on; by more than the
other it stepped."""

PLAIN = 3.0
"""A way that agrees with velocities by chance does not exceed what may be between them by as much."""

BORNE_OUT_NS = 100_000_000
"""Time, ns, for which an axis goes as its velocities say before that bears it out: another one may for a moment."""

Flags = NDArray[np.bool_]


class _Block(NamedTuple):
    """Joint states from one stamp to another, ns.

    Attributes:
        way: of each axis, m or rad.
        low, high: lowest and highest velocity said of each axis, m/s or rad/s.
        period: longest time between two states, s.
        said, went: largest change from state to state of the velocity said, and of that of the positions.
    """

    start_ns: int
    end_ns: int
    way: Array
    low: Array
    high: Array
    period: float
    said: Array
    went: Array


class _Sum(NamedTuple):
    """Way of each axis from the begin to the end of a block, and those of the lowest and highest velocity, m or rad."""

    end_ns: int
    ways: Array
    block: _Block


class JointVelocities:
    """Holds the ways of the axes against the velocities that the same joint states say, axis by axis.

    A way must lie between those of the lowest and the highest velocity around its time. One that does not contradicts
    them, until the axis has moved as they say. Which of the two is wrong:

    * of the monitored axis the velocity, for its encoder holds its position;
    * the velocity as well where it stepped while the speed of the positions, which bore it out before, went on;
    * else nobody knows, and the positions are not believed.

    A velocity that was 0 ever since the begin, of an axis that moves, is one that its driver does not fill in.
    """

    def __init__(self, axes: Sequence[Axis], monitored: str | None) -> None:
        self._axes = axes
        self._quickest = np.array([axis.quickest for axis in axes])
        self._slow = SLOW * np.array([axis.fastest for axis in axes])
        self._way = AxisSteps(axes)
        self._vouched = np.array([axis.letter == monitored for axis in axes])
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        none = np.zeros(len(self._axes), np.bool_)
        self._filled, self._unfilled, self._wrong, self._held = none, none, none, none
        self._moved = self._expected = np.zeros(len(self._axes))
        self._time = 0.0
        self._pausing = False
        self._count = 0
        self._begin()

    def pause(self) -> None:
        """The axes may be elsewhere by now: what they do next has to bear out where they are."""
        self._pausing = self._count >= COURSE
        self._wrong = np.zeros_like(self._wrong)
        self._begin()

    def interrupt(self) -> None:
        """The last joint state was not believed: what comes next is no way from it."""
        self._last_ns: int | None = None
        self._blocks: deque[_Block] = deque()
        self._sums: deque[_Sum] = deque()
        self._next = 1

    def _begin(self) -> None:
        self._proven = np.zeros(len(self._axes), np.bool_)
        self._agree_ns = np.zeros(len(self._axes), np.int64)
        self._count = 0
        self.interrupt()

    @property
    def unused(self) -> Flags:
        """(axes,) whose velocities are not used."""
        return self._wrong | self._held | self._unfilled

    @property
    def remarks(self) -> tuple[str, ...]:
        """Which velocities are not used though the positions are believed, and why."""
        empty, wrong = (
            ", ".join(axis.letter for axis, told in zip(self._axes, flags.tolist(), strict=True) if told)
            for flags in (self._unfilled, self._wrong)
        )
        return (
            *([f"velocities of axis {empty} are not used: always 0 while it moves"] if empty else []),
            *([f"velocities of axis {wrong} are not used: its positions do not go as they say"] if wrong else []),
        )

    def judge(self, stamp_ns: int, row: Array, velocities: Array | None) -> str:
        """Why a joint state is not believed of which all else is; empty where it is.

        Args:
            stamp_ns: its stamp, timestamp (ns).
            row: position of each axis, m or rad.
            velocities: of each axis, m/s or rad/s; none where nothing is said of them.
        """
        if velocities is None:
            self.interrupt()
            self._pausing = False
            return self._told(None)
        self._filled = self._filled | (velocities != 0.0)
        self._unfilled = self._unfilled & ~self._filled
        self._count += 1
        if self._last_ns is None:
            self._open(stamp_ns, row, velocities)
            self._stood_ns = self._moves_ns = np.full(len(self._axes), stamp_ns)
            self._speed = np.full(len(self._axes), np.nan)
        else:
            self._add(self._last_ns, stamp_ns, row, velocities)
        self._last_ns, self._row, self._velocities = stamp_ns, row, velocities
        return self._told(velocities)

    def _open(self, stamp_ns: int, row: Array, velocities: Array) -> None:
        """Begin a block."""
        self._from_ns, self._from, self._period = stamp_ns, row, 0.0
        self._low = self._high = velocities
        self._said = self._went = np.zeros(len(self._axes))

    def _add(self, last_ns: int, stamp_ns: int, row: Array, velocities: Array) -> None:
        """Go on with a block, and end it where it is long enough."""
        passed = (stamp_ns - last_ns) * 1e-9
        step = self._way(row - self._row)
        moves = step != 0.0
        resumes = moves & (last_ns - self._stood_ns >= STOOD_NS)
        self._moves_ns = np.where(resumes, stamp_ns, self._moves_ns)
        self._stood_ns = np.where(moves, stamp_ns, self._stood_ns)
        speed = step / passed
        self._said = np.maximum(self._said, np.abs(velocities - self._velocities))
        self._went = np.fmax(self._went, np.abs(speed - self._speed))
        self._speed = speed
        self._low, self._high = np.minimum(self._low, velocities), np.maximum(self._high, velocities)
        self._period = max(self._period, passed)
        if stamp_ns - self._from_ns < BLOCK_NS:
            return
        way = self._way(row - self._from)
        ended = _Block(self._from_ns, stamp_ns, way, self._low, self._high, self._period, self._said, self._went)
        self._blocks.append(ended)
        self._open(stamp_ns, row, velocities)
        self._sum()

    def _sum(self) -> None:
        """Add what has velocities enough before and after it to the ways, and look at these."""
        blocks = self._blocks
        while self._next + 1 < len(blocks) and blocks[-1].end_ns - blocks[self._next].end_ns >= LAG_NS:
            block = blocks[self._next]
            if block.start_ns - blocks[0].start_ns >= LAG_NS:
                while self._next > 1 and blocks[0].end_ns <= block.start_ns - LAG_NS:
                    blocks.popleft()
                    self._next -= 1
                time = (block.end_ns - block.start_ns) * 1e-9
                low, high = (
                    np.min([each.low for each in blocks], axis=0),
                    np.max([each.high for each in blocks], axis=0),
                )
                if not self._sums:
                    self._sums.append(_Sum(block.start_ns, np.zeros((3, len(self._axes))), block))
                ways = self._sums[-1].ways + np.array([block.way, time * low, time * high])
                self._sums.append(_Sum(block.end_ns, ways, block))
                while len(self._sums) > COURSE and block.end_ns - self._sums[1].end_ns >= LOOKS_NS[-1]:
                    self._sums.popleft()
                self._look()
            self._next += 1

    def _look(self) -> None:
        """Hold the ways up to the last sum against their velocities."""
        last, looks, chosen, longest = self._sums[-1], iter(LOOKS_NS), [], []
        look, period, count = next(looks), last.block.period, 0
        for each in islice(reversed(self._sums), 1, None):
            period, count = max(period, each.block.period), count + 1
            time_ns = last.end_ns - each.end_ns
            if time_ns >= look:
                chosen.append(each)
                longest.append(0.25 * period**2 * min(time_ns * 1e-9 / max(period, 1e-9), 1.0 + time_ns * 1e-9 / BURST))
                look = next((each for each in looks if each > time_ns), 1 << 62)
        if not chosen:
            return
        block_ns = last.end_ns - self._sums[-2].end_ns
        since_ns = np.array([each.end_ns for each in chosen])[:, None]
        time = (last.end_ns - since_ns) * 1e-9
        ways = last.ways - np.array([each.ways for each in chosen])
        way, low, high = ways[:, 0], ways[:, 1], ways[:, 2]
        most = np.abs(ways).max(axis=1)
        allowed = most * UNSTEADY / time + LEAST_WAY + self._slow * time + self._quickest * np.array(longest)[:, None]
        off = np.abs(way - np.clip(way, low, high))
        counts = self._moves_ns <= since_ns  # false for what an axis made up for
        against = counts & (off > allowed)
        # what would be within many velocities bears out none
        agrees = counts & (off <= allowed) & (np.abs(way) > PLAIN * (allowed + 0.5 * (high - low)))
        # axes may go alike for a moment, and only the longest look tells slow ones
        self._pausing = self._pausing and last.end_ns - self._sums[0].end_ns < LOOKS_NS[-1]
        if not self._held.any():
            self._moved, self._expected, self._time = way[-1], 0.5 * (low + high)[-1], float(time[-1, 0])
        self._note(against.any(axis=0), agrees.any(axis=0), np.where(against, off / time, 0.0).max(axis=0), block_ns)

    def _note(self, against: Flags, agrees: Flags, off: Array, block_ns: int) -> None:
        """Take in which axes go against velocities, by how much (m/s, rad/s), and which agree in a block (ns)."""
        self._unfilled = self._unfilled | (against & ~self._filled)
        agrees, against = agrees & ~against, against & self._filled
        self._agree_ns = np.where(against, 0, self._agree_ns + np.where(agrees, block_ns, 0))
        agrees = self._agree_ns >= BORNE_OUT_NS
        self._wrong, self._held = self._wrong & ~agrees, self._held & ~agrees
        new = against & ~self._wrong & ~self._held
        if new.any():
            recent = [*(each.block for each in self._sums), *self._blocks]
            said, went = np.max([each.said for each in recent], axis=0), np.max([each.went for each in recent], axis=0)
            goes_on = self._proven & (said >= ABRUPT * off) & (went <= SMOOTH * off)
            self._wrong = self._wrong | (new & (self._vouched | goes_on))
            self._held = self._held | (new & ~self._wrong)
        self._proven = self._proven | agrees

    def _told(self, velocities: Array | None) -> str:
        """Why the last joint state is not believed."""
        if self._held.any():
            which = int(np.argmax(self._held))
            axis, unit = self._axes[which], "m" if self._axes[which].kind == "linear" else "rad"
            moved, expected = f"{self._moved[which]:.3g} {unit}", f"{self._expected[which]:.3g} {unit}"
            return (
                f"axis {axis.letter} goes against its velocity: {moved} within {self._time:.2g} s, "
                f"which says {expected}: one of them is wrong, in sign, unit or axis"
            )
        if self._pausing and velocities is not None:
            moving = self._filled & ~self._vouched & (np.abs(velocities) > self._slow)
            if moving.any():
                return f"axis {self._axes[int(np.argmax(moving))].letter} moves after a pause, {UNCONFIRMED}"
            self._pausing = False
        return ""
