"""Angular positioning by ISO 230-2, where a recording stops at positions again and again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rotary_error_monitor.analysis.rotation import RotationCourse, Stretch
from rotary_error_monitor.analysis.runs import rests
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.positioning import (
    PositioningFigures,
    PositioningRuns,
    check_standard_test,
    estimate_positioning,
)
from rotary_error_monitor.signals.rows import parts_of
from rotary_error_monitor.units import TURN

LEAST_REST_NS = 200_000_000
"""Shortest stop that is one, ns; its first half is left to the drive to settle."""

SAME = 1e-3
"""Distance from which two targets differ, rad."""


@dataclass(frozen=True)
class Positioning:
    """What the stops show: figures, or none and why in the remarks.

    Attributes:
        stops: how many.
        figures: of ISO 230-2, rad; None where they are not told.
        remarks: departures from the standard test, and what is not told.
    """

    stops: int
    figures: PositioningFigures | None
    remarks: tuple[str, ...]


class LongPositions(RotationCourse, Protocol):
    """Rotation over time, and what it is off the command, of which a part is looked at at once."""

    def deviation(self, first: int, last: int) -> Array:
        """Rotation less command from one estimate to before another, rad, NaN where not observable."""


def positioning_of(estimates: LongPositions) -> Positioning:
    """Positioning by the stops of a recording."""
    stops: dict[tuple[int, int], list[float]] = {}
    count = 0
    for rest in rests(estimates):
        if rest.first == 0 or rest.end_ns - rest.begin_ns < LEAST_REST_NS:
            continue  # of what was before the recording nobody knows the direction
        rotation, deviation = _settled(estimates, rest)
        if deviation is None:
            continue
        count += 1
        earlier = estimates.place(rest.begin_ns - LEAST_REST_NS)
        before = rest.begin - float(estimates.read(earlier, earlier + 1)[1][0])
        place = round((rotation - deviation) / SAME) % round(TURN / SAME)
        stops.setdefault((place, 1 if before > 0 else -1), []).append(deviation)
    return _figures(stops, count)


def _settled(estimates: LongPositions, rest: Stretch) -> tuple[float, float | None]:
    """Means over the second half of a rest, rad: rotation, and that less command, None where it is not observable."""
    rotation = deviation = 0.0
    seen, begin = 0, (rest.first + rest.last) // 2
    for first, last in parts_of(begin, rest.last):
        part = estimates.deviation(first, last)
        known = part[np.isfinite(part)]
        rotation += float(estimates.read(first, last)[1].sum())
        deviation += float(known.sum())
        seen += len(known)
    return rotation / (rest.last - begin), deviation / seen if seen else None


def _figures(stops: dict[tuple[int, int], list[float]], count: int) -> Positioning:
    ways = {sense: sorted(p for (p, s), values in stops.items() if s == sense and len(values) > 1) for sense in (1, -1)}
    both = [place for place in ways[1] if place in ways[-1]]
    one = max(ways, key=lambda sense: len(ways[sense]))
    places, senses = (both, (1, -1)) if len(both) > 1 else (ways[one], (one,))
    if len(places) < 2:
        told = f"{count} stop(s): ISO 230-2 takes at least two targets, each approached twice from the same side"
        return Positioning(count, None, (told,) if count else ())
    tables = [_table([stops[place, sense] for place in places]) for sense in senses]
    try:
        runs = PositioningRuns(np.array(places) * SAME, tables[0], tables[1] if len(tables) > 1 else None, rotary=True)
    except InputError as error:
        return Positioning(count, None, (str(error),))
    return Positioning(count, estimate_positioning(runs), check_standard_test(runs))


def _table(readings: list[list[float]]) -> Array:
    """(targets, cycles) readings, NaN where a target has fewer."""
    table = np.full((len(readings), max(map(len, readings))), np.nan)
    for row, values in zip(table, readings, strict=True):
        row[: len(values)] = values
    return table
