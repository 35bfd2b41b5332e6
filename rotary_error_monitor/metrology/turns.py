"""Error motion over whole turns: cut out, brought to equal angles, and filtered over the angle (ISO 230-7, 4.4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.turn_cutting import RunCutter, TurnGrid
from rotary_error_monitor.signals.rows import Keep, Rows, RowsInMemory, parts_of
from rotary_error_monitor.units import TURN

MOST_WAVES = 150
"""Cut-off of the filter over the angle, waves a turn, where there are samples enough: the usual series of roundness
instruments is 15, 50, 150, 500 (ISO 12181-2), and with 150 the 18th order still comes out whole to 1 %."""

SAMPLES_A_WAVE = 7
"""Samples in a wave of the cut-off, at least (ISO 12181-2)."""

LEAST_WAVES = 3
"""Cut-off below which a profile shows no order that matters."""

ANGLES_A_WAVE = 4
"""Angles in a wave of the cut-off at which a profile is given."""

_MOST_VALUES = 1 << 20
"""Values of profiles that are worked with at once."""


@dataclass(frozen=True)
class TurnSummary:
    """What profiles of n turns show at each of k angles: mean, smallest and largest (…, k)."""

    mean: Array
    lowest: Array
    highest: Array

    @staticmethod
    def of(profiles: Array) -> TurnSummary:
        """Of profiles (…, n, k)."""
        return TurnSummary(profiles.mean(axis=-2), profiles.min(axis=-2), profiles.max(axis=-2))

    @staticmethod
    def of_parts(parts: Iterator[Array], count: int) -> TurnSummary:
        """Of profiles that come in parts (m, k), `count` in all."""
        first = next(parts)
        total, lowest, highest = first.sum(axis=0), first.min(axis=0), first.max(axis=0)
        for part in parts:
            total += part.sum(axis=0)
            lowest, highest = np.minimum(lowest, part.min(axis=0)), np.maximum(highest, part.max(axis=0))
        return TurnSummary(total / count, lowest, highest)


@dataclass(frozen=True)
class TurnProfiles:
    """c signals over n whole turns in one direction.

    Attributes:
        signals: (n, k) values of each signal at k equal angles from 0 on, filtered; in its unit.
        cut_off: waves a turn of which the filter lets half of the amplitude through.
        samples: samples in a turn, the mean.
        labels: (n, 2) of the first and last sample of each turn: what their caller called them, or their numbers.
        edges: (n,) number of the angle at which each turn is cut: before it another turn begins, or ends.
        incomplete: whole turns that are left out, for samples are missing in them.
        whole: turns that the runs would hold if they were joined: also where no whole turn is in one of them.
    """

    signals: tuple[Rows, ...]
    cut_off: int
    samples: float
    labels: NDArray[np.int64]
    edges: NDArray[np.intp]
    incomplete: int
    whole: float

    @property
    def count(self) -> int:
        """Turns."""
        return len(self.edges)

    @property
    def points(self) -> int:
        """Angles of a profile."""
        return ANGLES_A_WAVE * self.cut_off

    @property
    def angles(self) -> Array:
        """(k,) angles of the profiles, rad."""
        return np.asarray(np.arange(self.points) * (TURN / self.points))

    @property
    def profiles(self) -> Array:
        """(n, k, c) values of all signals: all of them in memory."""
        return np.stack([signal.read(0, self.count) for signal in self.signals], axis=2)

    @cached_property
    def transmission(self) -> Array:
        """(k // 2 + 1,) part of the amplitude of each order from 0 on that the filter lets through."""
        orders = np.arange(self.points // 2 + 1)
        return np.asarray(np.exp(-math.log(2) * (orders / self.cut_off) ** 2))

    def parts(self, signal: int) -> Iterator[tuple[Array, NDArray[np.intp]]]:
        """Profiles (m, k) of a signal, some turns at a time, and their edges (m,)."""
        for first, last in parts_of(0, self.count, max(1, _MOST_VALUES // self.points)):
            yield self.signals[signal].read(first, last), self.edges[first:last]

    def summary(self, signal: int) -> TurnSummary:
        """Of the profiles of a signal, of which there is one at least."""
        return TurnSummary.of_parts((profiles for profiles, _ in self.parts(signal)), self.count)


def cut_turns(
    theta: Array, values: Array, runs: Sequence[tuple[int, int]], most_waves: int = MOST_WAVES
) -> TurnProfiles | None:
    """Whole turns of signals; None where samples are too few for a profile. See `TurnCutter`.

    Args:
        theta: (m,) rotation, rad, unwrapped.
        values: (m, c) signals; a row that is not finite is a missing sample.
        runs: first sample and the one after the last of each stretch in one and the same direction.
        most_waves: cut-off of the filter over the angle, waves a turn; less where samples are few.
    """
    seen = RunSurvey()
    for first, last in runs:
        seen.begin()
        seen.add(theta[first:last], values[first:last])
    if (grid := seen.grid(most_waves)) is None:
        return None
    cutter = TurnCutter(seen, grid, values.shape[1])
    for first, last in runs:
        cutter.begin()
        cutter.add(theta[first:last], values[first:last], np.arange(first, last))
    return cutter.finish()


class RunSurvey:
    """How many samples the runs have, in how much of a turn: what a profile's angles and filter follow from."""

    def __init__(self) -> None:
        self._counts: list[int] = []
        self._ends: list[tuple[float, float]] = []

    def begin(self) -> None:
        """The next run begins."""
        self._counts.append(0)
        self._ends.append((0.0, 0.0))

    def add(self, theta: Array, values: Array) -> None:
        """Take samples of the run: rotation (m,), rad, and signals (m, c), not finite where one is missing."""
        there = np.flatnonzero(np.isfinite(values).all(axis=1))
        if len(there):
            begin = self._ends[-1][0] if self._counts[-1] else float(theta[there[0]])
            self._ends[-1] = begin, float(theta[there[-1]])
            self._counts[-1] += len(there)

    def turned(self, run: int) -> float:
        """Rotation from the first to the last sample of a run, rad; 0 where it has one sample at most."""
        begin, end = self._ends[run]
        return end - begin if self._counts[run] > 1 else 0.0

    @property
    def whole(self) -> float:
        """Turns of all runs."""
        return sum(abs(self.turned(run)) for run in range(len(self._counts))) / TURN

    def grid(self, most_waves: int) -> TurnGrid | None:
        """Angles and filter of the profiles; None where samples are too few for one."""
        if not self.whole > 0:
            return None
        several = [run for run, count in enumerate(self._counts) if count > 1]
        with np.errstate(divide="ignore"):  # a run that does not turn has no end of samples in a turn
            shares = np.divide([self._counts[run] for run in several], [abs(self.turned(run)) for run in several])
        samples = float(np.median(shares)) * TURN
        cut_off = min(most_waves, int(samples / SAMPLES_A_WAVE))
        if cut_off < LEAST_WAVES:
            return None
        count = ANGLES_A_WAVE * cut_off
        return TurnGrid(count, max(1, math.ceil(samples / count)), cut_off, samples)


class TurnCutter:
    """Cuts whole turns of signals out of runs that come in parts.

    Parts of a turn at the end of a run do not count. A turn in which samples are missing over more than half a wave of
    the cut-off is left out. Values between samples are interpolated in a straight line.
    """

    def __init__(self, seen: RunSurvey, grid: TurnGrid, signals: int, sums: int = 0, keep: Keep = RowsInMemory) -> None:
        """Cutter for runs that a survey has seen.

        Args:
            seen: the same runs.
            grid: of the profiles.
            signals: how many.
            sums: how many numbers of each sample are summed over the samples of the turns that count.
            keep: where profiles are kept.
        """
        self._seen, self._grid = seen, grid
        self._signals = tuple(keep((grid.count,), np.float64) for _ in range(signals))
        self._labels: list[NDArray[np.int64]] = []
        self._edges: list[int] = []
        self._incomplete = 0
        self._run = -1
        self._cutter: RunCutter | None = None
        self.sums: Array = np.zeros(sums)

    def begin(self) -> None:
        """The next run begins."""
        self._end_run()
        self._run += 1
        turned = self._seen.turned(self._run)
        self._cutter = RunCutter(self._grid, 1 if turned > 0 else -1, len(self.sums)) if turned else None

    def add(self, theta: Array, values: Array, labels: NDArray[np.int64], summed: Array | None = None) -> None:
        """Take samples of the run.

        Args:
            theta: (m,) rotation, rad.
            values: (m, c) signals; a row that is not finite is a missing sample.
            labels: (m,) what samples are called.
            summed: (m, s) numbers to be summed; none where none are.
        """
        if self._cutter is None:
            return
        there = np.isfinite(values).all(axis=1)
        if there.any():
            numbers = np.empty((len(theta), 0)) if summed is None else summed
            self._cutter.add(theta[there], values[there], labels[there], numbers[there])
            self._take()

    def finish(self) -> TurnProfiles:
        """Turns of all runs: no more samples will come."""
        self._end_run()
        labels = np.array(self._labels, np.int64).reshape(-1, 2)
        edges = np.array(self._edges, np.intp)
        grid = self._grid
        return TurnProfiles(
            self._signals, grid.cut_off, grid.samples, labels, edges, self._incomplete, self._seen.whole
        )

    def _end_run(self) -> None:
        if self._cutter is not None:
            self._cutter.end()
            self._take()
            self._cutter = None

    def _take(self) -> None:
        assert self._cutter is not None
        for turn in self._cutter.turns():
            if turn.profile is None:
                self._incomplete += 1
                continue
            for rows, column in zip(self._signals, turn.profile.T, strict=True):
                rows.append(column[None])
            self._labels.append(turn.labels)
            self._edges.append(turn.edge)
            self.sums += turn.sums
