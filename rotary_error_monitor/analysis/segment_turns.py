"""Whole turns of the signals of one segment, and their noise, from estimates that are looked at part by part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from rotary_error_monitor.analysis.rotation import speeds_in
from rotary_error_monitor.analysis.runs import Segment
from rotary_error_monitor.analysis.signals import (
    Estimates,
    LongEstimates,
    Signal,
    SignalName,
    Survey,
    signals_of,
    survey,
)
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.spindle_figures import SignalNoise
from rotary_error_monitor.metrology.turns import RunSurvey, TurnCutter, TurnProfiles
from rotary_error_monitor.signals.rows import Keep, parts_of

_Part = tuple[bool, Estimates, list[list[Signal]]]

_SUMS = 4
"""Numbers of a signal that are summed: variance, turning part of it, and both of proven samples alone."""


@dataclass(frozen=True)
class SignalGroup:
    """Signals that are observable at the same times.

    Attributes:
        signals: which they are.
        turns: whole turns of all of them; None where samples are too few.
        noise: of each, over the turns that count; none where no turn does.
    """

    signals: tuple[SignalName, ...]
    turns: TurnProfiles | None
    noise: tuple[SignalNoise, ...]

    @property
    def quantity(self) -> str:
        """Of all of them."""
        return self.signals[0].quantity


class SegmentTurns:
    """Turns of one segment."""

    def __init__(
        self,
        segment: Segment,
        estimates: LongEstimates,
        stage: StageDescription,
        heights: Sequence[float],
        most_waves: int,
        keep: Keep,
    ) -> None:
        """Turns of a segment; arguments as of `analyse_motion`."""
        self._runs, self._estimates = segment.runs, estimates
        self._stage, self._heights, self._most_waves, self._keep = stage, heights, most_waves, keep
        self._known: Survey = survey(estimates, segment.runs, stage)
        self.is_proven = self._known.proven

    def groups(self) -> Iterator[SignalGroup]:
        """Groups of signals, one after another."""
        # signals of a segment that is no longer than a part of a recording are made once
        is_short = len(list(parts_of(0, sum(last - first for first, last in self._runs)))) == 1
        kept = list(self._parts()) if is_short else None
        first, seen = _survey(kept or self._parts())
        grids = [each.grid(self._most_waves) for each in seen]
        cutters = [
            None if grid is None else TurnCutter(each, grid, len(signals), 2 + _SUMS * len(signals), self._keep)
            for each, grid, signals in zip(seen, grids, first, strict=True)
        ]
        for begins, part, groups in kept or self._parts():
            for cutter, signals in zip(cutters, groups, strict=True):
                if cutter is None:
                    continue
                if begins:
                    cutter.begin()
                values = np.stack([signal.values for signal in signals], axis=1)
                cutter.add(part.theta, values, part.stamp_ns, _summed(part, signals))
        for cutter, signals in zip(cutters, first, strict=True):
            names = tuple(signal.name for signal in signals)
            if cutter is None:
                yield SignalGroup(names, None, ())
                continue
            turns = cutter.finish()
            noise = _noise(cutter.sums, [signal.shape for signal in signals]) if turns.count else ()
            yield SignalGroup(names, turns, noise)

    def _parts(self) -> Iterator[_Part]:
        """Whether a run begins, a part of its estimates, and the signals that they show, by groups."""
        for first, last in self._runs:
            for begin, end in parts_of(first, last):
                part = self._estimates.part(begin, end)
                speed = speeds_in(self._estimates, begin, end).speed
                shown = signals_of(part, speed, self._known, self._stage, self._heights)
                alike = groupby(shown, key=lambda signal: (signal.quantity, bool(signal.height)))
                yield begin == first, part, [list(group) for _, group in alike]


def _survey(parts: Iterable[_Part]) -> tuple[list[list[Signal]], list[RunSurvey]]:
    """Signals of each group in the first part, and how many samples its runs have."""
    seen: list[RunSurvey] = []
    found: list[list[Signal]] = []
    for begins, part, groups in parts:
        if not found:
            found = groups
            seen = [RunSurvey() for _ in groups]
        for each, group in zip(seen, groups, strict=True):
            if begins:
                each.begin()
            each.add(part.theta, np.stack([signal.values for signal in group], axis=1))
    return found, seen


def _summed(part: Estimates, signals: Sequence[Signal]) -> Array:
    """(m, 2 + 4 c) what is summed over the samples: 1, whether it is proven, then variances of each signal."""
    proven = part.proven
    columns = [np.ones(len(part)), proven.astype(np.float64)]
    for signal in signals:
        variance = signal.variance - signal.still
        columns += [variance, signal.turning, np.where(proven, variance, 0.0), np.where(proven, signal.turning, 0.0)]
    return np.stack(columns, axis=1)


def _noise(sums: Array, shapes: Sequence[float]) -> tuple[SignalNoise, ...]:
    """Noise of each signal, from sums over the samples of the turns that count: over proven ones, if there are any."""
    count, proven = sums[:2]
    found = []
    for shape, each in zip(shapes, sums[2:].reshape(-1, _SUMS), strict=True):
        variance, turning = (each[2:] / proven if proven else each[:2] / count).tolist()
        random = max(variance - turning - shape, 0.0)
        found.append(SignalNoise(random**0.5, shape**0.5, turning**0.5))
    return tuple(found)
