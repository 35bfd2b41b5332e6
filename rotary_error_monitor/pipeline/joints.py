"""Where the machine's axes stand at the ticks of the error motion, from joint states that come at their own times.

For a tick the joint state counts that is at least `lag` older: it has arrived by then, so the choice depends on stamps
alone. From it and the one before, the position at the tick is extrapolated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.signals.streams import SampleStream

STILL = 1e-9
"""Motion between two joint states (m or rad) that counts as none; the direction of travel then stays."""

LONGEST_STEP = 0.2
"""Joint states further apart (s) are not extrapolated: the position is held."""


@dataclass(frozen=True)
class AxisPositions:
    """Axes at m ticks.

    Attributes:
        positions: (m, axes) in m or rad.
        directions: (m, axes) sign of travel: +1, -1, 0 unknown.
        age: (m,) time since the joint state that was used, s.
        known: (m,) whether there was one.
    """

    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    age: NDArray[np.float64]
    known: NDArray[np.bool_]


class JointTrack:
    """The latest joint states of one machine.

    Attributes:
        stream: samples as they came, for diagnostics.
    """

    def __init__(self, machine: MachineDescription, lag_ns: int, patience_ns: int) -> None:
        self._letters = machine.letters
        self._optional = machine.monitored
        self._rotary = np.array([axis.kind == "rotary" for axis in machine.axes])
        self._lag_ns = lag_ns
        names = [*(f"q_{letter}" for letter in self._letters), *(f"direction_{letter}" for letter in self._letters)]
        self.stream = SampleStream(names, patience_ns)
        self._direction = np.zeros(len(self._letters))
        self._last: NDArray[np.float64] | None = None

    def push(self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]) -> bool:
        """Take in one joint state; give whether it was taken (it is not where its stamp is not after the last one).

        Raises:
            InputError: an axis of the machine is missing; the monitored one may be.
        """
        missing = [letter for letter in self._letters if letter not in positions and letter != self._optional]
        if missing:
            raise InputError(f"joint state of {', '.join(positions) or 'nothing'} lacks axis {', '.join(missing)}")
        row = np.array([positions.get(letter, 0.0) for letter in self._letters])
        speed = np.array([velocities.get(letter, 0.0) for letter in self._letters])
        moved = self._moved(row - self._last) if self._last is not None else np.zeros(len(row))
        direction = np.where(np.abs(moved) > STILL, np.sign(moved), np.sign(speed))
        direction = np.where(direction == 0, self._direction, direction)
        taken = self.stream.push(
            block_from_samples(np.array([stamp_ns]), self.stream.names, np.concatenate([row, direction])[None])
        )
        if taken:
            self._last, self._direction = row, direction
        return bool(taken)

    def count_decided(self, ticks_ns: NDArray[np.int64], watermark_ns: int) -> int:
        """How many of the leading ticks have their joint state, or need not wait for it any longer."""
        newest = self.stream.newest_ns
        reach = -1 if newest is None else newest + self._lag_ns
        if self.stream.is_absent(watermark_ns - self._lag_ns):
            reach = max(reach, watermark_ns)
        return int(np.searchsorted(ticks_ns, reach, side="right"))

    def at(self, ticks_ns: NDArray[np.int64], used_ns: NDArray[np.int64] | None = None) -> AxisPositions:
        """Axes at ticks (m,); `used_ns` names the stamp of the joint state of each tick instead of the rule."""
        times, values = self.stream.times_ns, self.stream.values
        axes = len(self._letters)
        wanted = ticks_ns - self._lag_ns if used_ns is None else used_ns
        index = np.searchsorted(times, wanted, side="right") - 1
        known = index >= 1
        if used_ns is not None and len(times):
            # One of the tick's own time needs none before it: nothing is extrapolated.
            known |= (index >= 0) & (used_ns == ticks_ns)
            known &= times[np.clip(index, 0, len(times) - 1)] == used_ns
        if not known.any():
            zero = np.zeros((len(ticks_ns), axes))
            return AxisPositions(zero, zero, np.zeros(len(ticks_ns)), known)
        here = np.where(known, index, 0)
        before = np.maximum(here - 1, 0)
        step = (times[here] - times[before]) * 1e-9
        age = np.asarray((ticks_ns - times[here]) * 1e-9, np.float64)
        moved = self._moved(values[here, :axes] - values[before, :axes])
        part = np.where((step > 0) & (step <= LONGEST_STEP), age / np.where(step > 0, step, 1.0), 0.0)
        positions: NDArray[np.float64] = values[here, :axes] + moved * part[:, None]
        return AxisPositions(positions, values[here, axes:], age, known)

    def trim(self, before_ns: int) -> None:
        """Forget joint states that no tick from `before_ns` on needs."""
        self.stream.trim(before_ns - self._lag_ns, margin=64)

    def _moved(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """A rotary axis may be told modulo a turn."""
        turns = np.rint(difference / (2 * np.pi)) * (2 * np.pi)
        return np.asarray(np.where(self._rotary, difference - turns, difference))


def pack_directions(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) directions of travel (m, axes) in one number: sum of (sign + 1) * 3^i."""
    total = np.zeros(len(directions))
    for i in range(directions.shape[1]):
        total = total + (directions[:, i] + 1) * 3**i
    return total


def unpack_directions(packed: NDArray[np.float64], axes: int) -> NDArray[np.float64]:
    """(m, axes) directions of travel from `pack_directions`."""
    whole = packed.astype(np.int64)
    return np.stack([(whole // 3**i) % 3 - 1 for i in range(axes)], axis=1).astype(np.float64)


def hold_reason(age_s: float, limit_s: float, what: Sequence[str]) -> str:
    """Why corrections are held: which inputs are how old."""
    return f"{' and '.join(what)} {age_s:.2f} s old; limit {limit_s:.2f} s"
