"""What a textbook's jump at a reversal is in a real drive or bearing: it takes some travel, and stays at rest."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.rotor import AT_REST, RotorState
from rotary_error_monitor.gap.departures import Modulation
from rotary_error_monitor.twin.stage import StageInputs

STEP = 0.01
"""s between the instants at which the command is looked at; a shorter stop is none."""

TRAVELS = tuple(float(np.pi / 2**k) for k in range(1, 7))
"""rad of travel over which a side is taken up after a reversal (presliding, compliant flanks), from 3 to 90 degrees.

In two-fold steps: what is taken up over a travel between two of them is a sum of theirs to half a per cent.
"""

RELEASES = (np.inf, 2.0, 0.5, 0.125)
"""s within which what is displaced creeps back at rest, in four-fold steps; or it stays."""


@dataclass(frozen=True)
class Play:
    """The side that the travelled way leaves, which textbooks have at once and only while the rotor turns.

    Over a travel `L` the side `s` follows the direction `d` as `ds = (d - s) |dtheta| / L` (Dahl 1976).

    Attributes:
        inputs: of the stage.
        duration: of the recording, s.
    """

    inputs: StageInputs
    duration: float

    def remembering(self) -> StageInputs:
        """Inputs with a speed next to nothing at rest, in the direction of before; forward before anything moved."""

        def omega(time: Array) -> Array:
            speed = np.asarray(self.inputs.omega(time), np.float64)
            side = self._last[self._leg(time)]
            return np.where(np.abs(speed) > AT_REST, speed, 2 * AT_REST * np.where(side != 0, side, 1.0))

        return replace(self.inputs, omega=omega)

    def resting(self, time: Array) -> Array:
        """(n, r) what stays at rest of a side that was taken at once, or over each travel; and before any motion."""
        leg = self._leg(time)
        since, last = time - self._begins[leg], self._last[leg]
        taken = [np.abs(last), *(last * side[leg] for side, _ in self._sides)]
        kept = [*(taken[0] * np.exp(-since / release) for release in RELEASES), *taken[1:]]
        return np.column_stack([*kept, last == 0])

    def sides(self, time: Array) -> Array:
        """(n, 2 t) for each of the travels the side from none at the beginning, and what is left of one before."""
        leg = self._leg(time)
        way = self._way[leg]
        command = np.asarray(self.inputs.command(np.stack([time, self._begins[leg]])), np.float64)
        travel = np.abs(way * (command[0] - command[1]))
        columns = []
        for length, (side, before) in zip(TRAVELS, self._sides, strict=True):
            left = np.exp(-travel / length)
            columns += [way * (1 - left) + side[leg] * left, before[leg] * left]
        return np.column_stack(columns)

    def yielding(self, state: RotorState, peak: float) -> list[Modulation]:
        """Modulations by what of a side is not taken yet, beside that of the direction."""
        way, sides = state.direction, self.sides(state.time).T
        parts = [*(way * sides[::2] - np.abs(way)), *(way * sides[1::2])]
        return [Modulation("after reversals", peak * part, yields) for part in parts]

    def taken(self, time: Array) -> Array:
        """(n, t / 2) the sides from none over every other travel, of which those between are sums to a few per cent."""
        return self.sides(time)[:, 2::4]

    @cached_property
    def _legs(self) -> tuple[Array, Array]:
        """(s,) beginning of each stretch of one direction, and that direction; 0 at rest."""
        time = np.arange(0.0, self.duration + STEP, STEP)
        omega = np.asarray(self.inputs.omega(time), np.float64)
        way = np.where(np.abs(omega) > AT_REST, np.sign(omega), 0.0)
        begins = np.flatnonzero(np.diff(way, prepend=np.nan) != 0)
        return time[begins], way[begins]

    @property
    def reversals(self) -> list[tuple[float, ...]]:
        """Time of each, s; where the rotor stood still in between when it came to rest, and when it went on."""
        moving, found = np.flatnonzero(self._way), list[tuple[float, ...]]()
        for before, after in itertools.pairwise(moving.tolist()):
            if self._way[before] == self._way[after]:
                continue
            last = float(self._begins[after])
            if after > before + 1:
                found.append((float(self._begins[before + 1]), last))
                continue
            speeds = np.abs(np.asarray(self.inputs.omega(np.array([last - STEP, last])), np.float64))
            found.append((last - STEP * float(speeds[1] / speeds.sum()),))
        return found

    def since(self, moments: Array, time: Array) -> Array:
        """(n, m) the side that was taken last, from each moment on; 0 before it."""
        side = np.sign(np.asarray(self.remembering().omega(time), np.float64))
        return np.where(time[:, None] >= moments, side[:, None], 0.0)

    @property
    def _begins(self) -> Array:
        return self._legs[0]

    @property
    def _way(self) -> Array:
        return self._legs[1]

    @cached_property
    def _last(self) -> Array:
        """(s,) direction of each stretch, or at rest the one before it; 0 before anything moved."""
        moving = np.maximum.accumulate(np.where(self._way != 0, np.arange(len(self._way)), -1))
        return np.asarray(np.where(moving >= 0, self._way[moving], 0.0), np.float64)

    @cached_property
    def _sides(self) -> list[tuple[Array, Array]]:
        """For each travel the side (s,) at the beginning of each stretch, from none before the recording; and what is
        left of one that was there.
        """
        angle = np.asarray(self.inputs.command(np.append(self._begins, self.duration)), np.float64)
        found = []
        for length in TRAVELS:
            kept = np.exp(-np.abs(np.diff(angle)) / length)
            side, before = [0.0], [1.0]
            for way, keep in zip(self._way[:-1].tolist(), kept[:-1].tolist(), strict=True):
                side.append(way + (side[-1] - way) * keep if way else side[-1])
                before.append(before[-1] * keep if way else before[-1])
            found.append((np.array(side), np.array(before)))
        return found

    def _leg(self, time: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
        return np.maximum(np.searchsorted(self._begins, time, "right") - 1, 0)


def yields(change: float) -> str:
    """Words for what takes some travel after a reversal."""
    return "yields after a reversal"


def stays(change: float) -> str:
    """Words for what textbooks put back at rest."""
    return "stays at rest"
