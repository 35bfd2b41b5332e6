"""Runs of a table that are another run once more: what was measured once and written twice tells nothing of scatter."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.csv_tables import Table
from rotary_error_monitor.metrology.positioning import EXACT
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM

EQUAL = 0.2821
"""Probability that two normal readings are the same, times their standard deviation over a step that is smaller."""


@dataclass(frozen=True)
class _Equality:
    """How often readings at one place are the same: pairs of runs, and those among them that are."""

    pairs: float
    equal: float

    def chance(self, step: float, noise: float) -> float:
        """Probability that two readings are the same: as other pairs show, or by step and least noise without any."""
        if self.pairs > 0:
            return (self.equal + 1) / (self.pairs + 2)
        return min(1.0, EQUAL * step / noise)


def refuse_copies(
    table: Table, runs: Mapping[str, Sequence[int]], places: Array, readings: Array, noise: float
) -> None:
    """Hold that no run is another one to the last digit; where readings are as coarse as that, it may be.

    How probable equal readings are is told by the runs that are not the same; where all are, by the least `noise`.

    Args:
        table: of which they are.
        runs: rows of each run, by what it is called.
        places: (n, k) what makes two readings of the same, such as target and direction.
        readings: (n,) or (n, j).
        noise: standard deviation of a reading, at least, in their unit.

    Raises:
        InputError: one that is, more often than by chance once in a thousand times.
    """
    readings = np.round(readings[:, None] if readings.ndim == 1 else readings, EXACT)
    whole = np.concatenate([places, readings], axis=1)
    first: dict[Hashable, str] = {}
    copies: list[tuple[str, str]] = []
    for name, rows in runs.items():
        content = np.sort(whole[list(rows)].view([("", np.float64)] * whole.shape[1]), axis=0).tobytes()
        if content in first:
            copies.append((name, first[content]))
        first.setdefault(content, name)
    if not copies:
        return
    kept = np.concatenate([np.array(runs[name]) for name in first.values()])
    # readings that are all the same tell no step: it may be as coarse as that
    step = step_of(readings.ravel()) if np.ptp(readings) else np.inf
    chance = _equality(places[kept], readings[kept]).chance(step, noise)
    count = sum(len(runs[name]) for name, _ in copies) * readings.shape[1]
    if len(runs) ** 2 / 2 * chance**count >= FALSE_ALARM:
        return
    name, other = copies[0]
    raise table.error(
        runs[name][0],
        f"{name} is {other} once more, to the last digit (line {table.lines[runs[other][0]]}), as are "
        f"{len(copies)} of {len(runs)}; give what was measured once, for a copy says nothing of scatter",
    )


def _equality(places: Array, readings: Array) -> _Equality:
    """How often readings (n, j) at the same place (n, k) are equal."""
    _, group = np.unique(places, axis=0, return_inverse=True)
    pairs = equal = 0.0
    for column in readings.T:
        _, counts = np.unique(np.stack([group.ravel(), column]), axis=1, return_counts=True)
        equal += float((counts * (counts - 1)).sum()) / 2
    counts = np.bincount(group.ravel())
    pairs = readings.shape[1] * float((counts * (counts - 1)).sum()) / 2
    return _Equality(pairs, equal)
