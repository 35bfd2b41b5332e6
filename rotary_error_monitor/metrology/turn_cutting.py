"""Cutting one run into whole turns: brought to equal angles and filtered over the angle, part of the run after part."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.units import TURN

_HALF = math.sqrt(math.log(2) / 2) / math.pi
"""Standard deviation of a Gaussian, in waves, that lets half of the amplitude through (ISO 16610-21)."""

_TRUNCATED = 4.0
"""Standard deviations from which on the filter's weights are left out, as `gaussian_filter1d` does."""


@dataclass(frozen=True)
class TurnGrid:
    """Angles of profiles, and their filter.

    Attributes:
        count: angles of a profile.
        fine: angles that are filtered for each of them.
        cut_off: waves a turn of which the filter lets half of the amplitude through.
        samples: in a turn.
    """

    count: int
    fine: int
    cut_off: int
    samples: float

    @property
    def points(self) -> int:
        """Angles of a turn that are filtered."""
        return self.count * self.fine

    @property
    def deviation(self) -> float:
        """Standard deviation of the filter's Gaussian, in these angles."""
        return _HALF * self.points / self.cut_off

    @property
    def reach(self) -> int:
        """Angles to each side that the filter takes."""
        return int(_TRUNCATED * self.deviation + 0.5)


@dataclass(frozen=True)
class Turn:
    """One whole turn.

    Attributes:
        profile: (count, c) from angle 0 on; None where samples are missing.
        labels: (2,) of its first and last sample.
        edge: number of the angle at which it is cut.
        sums: (s,) over its samples.
    """

    profile: Array | None
    labels: NDArray[np.int64]
    edge: int
    sums: Array


class RunCutter:
    """Cuts one run, whose samples come part after part.

    Angles are counted in the sense of the rotation; they are multiples of a step, number p at `p * step`. Turn m goes
    from number `first + m * points` on.
    """

    def __init__(self, grid: TurnGrid, sense: int, sums: int) -> None:
        """Cutter of a run that turns in a sense, 1 or -1, with so many numbers to be summed."""
        self._grid, self._sense = grid, sense
        self._step = TURN / grid.points
        self._angle = np.empty(0)
        self._values: Array | None = None
        self._labels = np.empty(0, np.int64)
        self._top = -math.inf
        self._first: int | None = None
        self._next = 0  # number of the angle that is interpolated next
        self._even: Array | None = None  # from number `_kept` on
        self._kept = 0
        self._ready = 0  # number of the angle that is filtered next
        self._gaps: set[int] = set()  # turns in which samples are missing
        self._smooth: list[Array] = []  # at each `fine`-th angle, those of turn `_turn` first
        self._turn = 0
        self._begins: list[int] = []  # label of the first sample from each turn's begin on, and of the last before it
        self._ends: list[int] = []
        self._sums: list[Array] = []
        self._open = np.zeros(sums)
        self._last_label = 0
        self._ended = False

    def add(self, theta: Array, values: Array, labels: NDArray[np.int64], summed: Array) -> None:
        """Take samples: rotation (m,), signals (m, c), labels (m,), and numbers to be summed (m, s)."""
        # its jitter may turn back where the rotor hardly moves
        angle = np.maximum(np.maximum.accumulate(self._sense * theta), self._top)
        self._top = float(angle[-1])
        if self._first is None:
            self._first = self._next = self._kept = self._ready = math.ceil(angle[0] / self._step)
            self._even = np.empty((0, values.shape[1]))
        self._pass_edges(angle, labels, summed)
        self._angle = np.concatenate([self._angle, angle])
        self._values = values if self._values is None else np.concatenate([self._values, values])
        last = math.floor(self._top / self._step)
        self._interpolate(last if last * self._step < self._top else last - 1)
        self._filter()

    def end(self) -> None:
        """No more samples will come."""
        if self._first is None:
            return
        self._interpolate(math.floor(self._top / self._step))
        self._ended = True
        self._filter()
        self._ends.append(self._last_label)
        self._sums.append(self._open)

    def turns(self) -> Iterator[Turn]:
        """Turns that are complete by now, each once."""
        count, fine = self._grid.count, self._grid.fine
        while self._first is not None:
            begin = self._first + self._turn * self._grid.points
            if self._ready < begin + self._grid.points or len(self._ends) <= self._turn + 1:
                return
            rows = np.concatenate(self._smooth)
            self._smooth = [rows[count:]]
            number = (-(-begin // fine) + np.arange(count)) % count
            profile = np.empty((count, rows.shape[1]))
            profile[number if self._sense > 0 else (-number) % count] = rows[:count]
            edge = int(number[0] if self._sense > 0 else (1 - number[0]) % count)
            labels = np.array([self._begins[self._turn], self._ends[self._turn + 1]])
            missing = self._turn in self._gaps
            yield Turn(None if missing else profile, labels, edge, self._sums[self._turn + 1])
            self._turn += 1

    def _pass_edges(self, angle: Array, labels: NDArray[np.int64], summed: Array) -> None:
        """Note where turns begin and end, and what is summed between."""
        assert self._first is not None
        at = 0
        while (edge := (self._first + len(self._begins) * self._grid.points) * self._step) <= angle[-1]:
            place = int(np.searchsorted(angle, edge))
            self._sums.append(self._open + summed[at:place].sum(axis=0))
            self._open = np.zeros(summed.shape[1])
            self._ends.append(int(labels[place - 1]) if place else self._last_label)
            self._begins.append(int(labels[place]))
            at = place
        self._open = self._open + summed[at:].sum(axis=0)
        self._last_label = int(labels[-1])

    def _interpolate(self, last: int) -> None:
        """Values at equal angles up to number `last`."""
        if last < self._next:
            return
        assert self._values is not None and self._even is not None and self._first is not None
        places = np.arange(self._next, last + 1)
        at = places * self._step
        after = np.clip(np.searchsorted(self._angle, at), 1, len(self._angle) - 1)
        gap = self._angle[after] - self._angle[after - 1] > TURN / (2 * self._grid.cut_off)
        self._gaps |= set(((places[gap] - self._first) // self._grid.points).tolist())
        even = np.stack([np.interp(at, self._angle, column) for column in self._values.T], axis=1)
        self._even = np.concatenate([self._even, even])
        self._next = last + 1
        # the next angle lies behind the last one: it needs the sample before it, and those after
        passed = max(int(np.searchsorted(self._angle, at[-1])) - 1, 0)
        self._angle, self._values = self._angle[passed:], self._values[passed:]

    def _filter(self) -> None:
        """Filter what has all its neighbours."""
        from scipy.ndimage import gaussian_filter1d  # loads for a third of a second, and a replay cuts no turns

        assert self._even is not None
        reach, fine = self._grid.reach, self._grid.fine
        until = self._next if self._ended else self._next - reach
        if until <= self._ready:
            return
        smooth = gaussian_filter1d(self._even, self._grid.deviation, axis=0, mode="nearest", truncate=_TRUNCATED)[
            self._ready - self._kept : until - self._kept
        ]
        self._smooth.append(smooth[-self._ready % fine :: fine])
        self._ready = until
        kept = max(until - reach, self._kept)
        self._even, self._kept = self._even[kept - self._kept :], kept
