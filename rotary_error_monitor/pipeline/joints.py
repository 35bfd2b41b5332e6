"""Where the machine's axes stand at the ticks of the error motion, from joint states that come at their own times.

For a tick the joint state counts that is at least `lag` older: it has arrived by then, so the choice depends on stamps
alone. From it and the one before, the position at the tick is extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.libraries import address
from rotary_error_monitor.pipeline.joint_checks import JointChecks
from rotary_error_monitor.pipeline.kernel import Joints, chosen_kernel
from rotary_error_monitor.pipeline.travel import STILL, TravelDirections
from rotary_error_monitor.signals.blocks import NANOSECONDS, block_from_samples
from rotary_error_monitor.signals.streams import SampleStream

MEMORY_NS = 10_000_000_000
"""How long a refused joint state is remembered, ns: longer than any joint state is used."""

LONGEST_STEP = 0.2
"""Joint states further apart (s) are not extrapolated: the position is held."""


@dataclass(frozen=True)
class AxisPositions:
    """Axes at m ticks.

    Attributes:
        positions: (m, axes) in m or rad.
        directions: (m, axes) sign of travel: +1, -1, 0 unknown.
        turned: (m, axes) probability that an axis has turned back since.
        age: (m,) time since the joint state that was used, s.
        known: (m,) whether there was one.
        stamps: (m,) of the joint state that was used, timestamp (ns).
        stamped: (m, axes) positions as it told them, before they were carried on to the tick.
        told: (m,) whether it names the monitored axis.
        doubted: (m,) whether later ones were there and not believed.
    """

    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    turned: NDArray[np.float64]
    age: NDArray[np.float64]
    known: NDArray[np.bool_]
    stamps: NDArray[np.int64]
    stamped: NDArray[np.float64]
    told: NDArray[np.bool_]
    doubted: NDArray[np.bool_]

    def at(self, chosen: NDArray[np.int64]) -> AxisPositions:
        """The same at some of the ticks."""
        return AxisPositions(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def replaced(self, which: NDArray[np.bool_], other: AxisPositions) -> AxisPositions:
        """The same with all of `other` at the ticks `which`, (m,)."""
        both = ((getattr(self, each.name), getattr(other, each.name)) for each in fields(self))
        return AxisPositions(*(np.where(which[:, None] if mine.ndim > 1 else which, its, mine) for mine, its in both))


class JointTrack:
    """The latest joint states of one machine.

    Attributes:
        stream: samples that were believed, for diagnostics.
        checks: which are.
        doubt: why the last one was not believed; empty where it was.
    """

    def __init__(self, machine: MachineDescription, lag_ns: int, patience_ns: int) -> None:
        self._letters = machine.letters
        self._optional = machine.monitored
        self._rotary = np.array([axis.kind == "rotary" for axis in machine.axes])
        self._quickest = np.array([axis.quickest for axis in machine.axes])
        self._lag_ns = lag_ns
        self._compiled = Joints(
            quickest=address(self._quickest),
            rotary=address(self._rotary),
            axes=len(self._letters),
            lag=lag_ns,
            longest_step=LONGEST_STEP,
            still=STILL,
        )
        names = [*(f"q_{letter}" for letter in self._letters), *(f"direction_{letter}" for letter in self._letters)]
        self.stream = SampleStream([*names, "told"], patience_ns)
        self._refused = np.empty(0, np.int64)
        self.checks = JointChecks(machine)
        self.doubt = ""
        self._travel = TravelDirections(machine)
        self._last: NDArray[np.float64] | None = None

    def push(self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]) -> bool:
        """Take in one joint state; give whether it was taken (it is not where its stamp is not after the last one).

        Raises:
            InputError: an axis of the machine is missing; the monitored one may be.
        """
        missing = [letter for letter in self._letters if letter not in positions and letter != self._optional]
        if missing:
            held = excerpt(", ".join(positions)) or "nothing"
            raise InputError(f"joint state of {held} lacks axis {', '.join(missing)}")
        row = np.array([positions.get(letter, math.nan) for letter in self._letters])
        speed = np.array([velocities.get(letter, 0.0) for letter in self._letters])
        newest, heard = self.stream.newest_ns, self.checks.heard_ns
        if newest is None or stamp_ns > newest:
            if heard is not None and newest != heard and stamp_ns <= heard:
                return False  # that of one that was refused: an axis cannot have moved since
            unnamed = self._optional if self._optional not in positions else None
            self.doubt = self.checks.judge(stamp_ns, row, velocities, unnamed)
            if self.doubt:
                self._refused = np.append(self._refused, stamp_ns)
                return False
        speed = np.where(self.checks.velocities.unused, 0.0, speed)
        told = not np.isnan(row).any()
        row = row if told else np.nan_to_num(row)
        recent = newest is not None and stamp_ns - newest <= LONGEST_STEP * NANOSECONDS
        # over a longer pause an axis may have turned back: then its speed tells which way it goes
        if self._last is not None and recent:
            direction = self._travel.move(self._moved(row - self._last), speed)
        else:
            direction = self._travel.resume(speed)
        taken = self.stream.push(
            block_from_samples(np.array([stamp_ns]), self.stream.names, np.concatenate([row, direction, [told]])[None])
        )
        if taken:
            self._last = row
        return bool(taken)

    def count_decided(self, ticks_ns: NDArray[np.int64], watermark_ns: int) -> int:
        """How many of the leading ticks have their joint state, or need not wait for it any longer."""
        newest = self.stream.newest_ns
        reach = -1 if newest is None else newest + self._lag_ns
        if self.stream.is_absent(watermark_ns - self._lag_ns):
            reach = max(reach, watermark_ns)
        return int(ticks_ns.searchsorted(reach, side="right"))

    def at(self, ticks_ns: NDArray[np.int64], used_ns: NDArray[np.int64] | None = None) -> AxisPositions:
        """Axes at ticks (m,); `used_ns` names the stamp of the joint state of each tick instead of the rule."""
        times, values = self.stream.times_ns, self.stream.values
        axes, kernel = len(self._letters), chosen_kernel()
        if kernel is not None and used_ns is None and len(times):
            found = kernel.axes_at(self._compiled, times, values, self._refused, ticks_ns)
            if found is not None:
                (positions, directions, turned, stamped, age), stamps, (known, told, doubted) = found
                return AxisPositions(positions, directions, turned, age, known, stamps, stamped, told, doubted)
        wanted = ticks_ns - self._lag_ns if used_ns is None else used_ns
        index = np.searchsorted(times, wanted, side="right") - 1
        known = index >= 1
        if used_ns is not None and len(times):
            # One of the tick's own time needs none before it: nothing is extrapolated.
            known |= (index >= 0) & (used_ns == ticks_ns)
            known &= times[np.clip(index, 0, len(times) - 1)] == used_ns
        if not known.any():
            return _nowhere(len(ticks_ns), axes)
        here = np.where(known, index, 0)
        before = np.maximum(here - 1, 0)
        step = (times[here] - times[before]) * 1e-9
        age = np.asarray((ticks_ns - times[here]) * 1e-9, np.float64)
        moved = self._moved(values[here, :axes] - values[before, :axes])
        part = np.where((step > 0) & (step <= LONGEST_STEP), age / np.where(step > 0, step, 1.0), 0.0)
        positions = values[here, :axes] + moved * part[:, None]
        refused_by = np.searchsorted(self._refused, [times[here], wanted], side="right")
        doubted = refused_by[1] > refused_by[0]
        told = values[here, -1] > 0.0
        turned = self._turned(moved, step[:, None], age[:, None])
        return AxisPositions(
            positions, values[here, axes:-1], turned, age, known, times[here], values[here, :axes], told, doubted
        )

    def _turned(
        self, moved: NDArray[np.float64], step: NDArray[np.float64], age: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(m, axes) probability that axes have turned back since they moved (m or rad) in a step of time (s).

        Their acceleration since the middle of the step is rectangular within its limits (JCGM 100:2008, 4.3.7). An axis
        that stands has not turned.
        """
        speed = np.abs(moved) / np.where(step > 0, step, np.inf)
        lost = self._quickest * (age + 0.5 * step)
        part = np.divide(speed, lost, out=np.ones_like(moved), where=(np.abs(moved) > STILL) & (lost > speed))
        return 0.5 - 0.5 * part

    def reset(self) -> None:
        """Believe the next joint state wherever it is."""
        self.checks.reset()
        self._refused = self._refused[:0]
        self.doubt = ""

    def clear(self) -> None:
        """Forget all joint states: the clock was set back."""
        self.reset()
        self.stream.clear()
        self._last = None

    def trim(self, before_ns: int) -> None:
        """Forget joint states that no tick from `before_ns` on needs."""
        self.stream.trim(before_ns - self._lag_ns, margin=64)
        if len(self._refused):
            self._refused = self._refused[self._refused > before_ns - self._lag_ns - MEMORY_NS]

    def _moved(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """A rotary axis may be told modulo a turn."""
        turns = np.rint(difference / (2 * np.pi)) * (2 * np.pi)
        return np.asarray(np.where(self._rotary, difference - turns, difference))


def pack_directions(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) directions of travel (m, axes) in one number: sum of (sign + 1) * 3^i."""
    return np.asarray((directions + 1.0) @ _powers(directions.shape[1]))  # whole numbers: exact


@cache
def _powers(axes: int) -> NDArray[np.float64]:
    return np.asarray(3.0 ** np.arange(axes), np.float64)


def unpack_directions(packed: NDArray[np.float64], axes: int) -> NDArray[np.float64]:
    """(m, axes) directions of travel from `pack_directions`."""
    whole = packed.astype(np.int64)
    return np.stack([(whole // 3**i) % 3 - 1 for i in range(axes)], axis=1).astype(np.float64)


def _nowhere(count: int, axes: int) -> AxisPositions:
    """Positions at ticks for which there is no joint state."""
    zero, none = np.zeros((count, axes)), np.zeros(count, np.bool_)
    return AxisPositions(zero, zero, zero, np.zeros(count), none, np.zeros(count, np.int64), zero, none, none)
