"""Angular positioning by ISO 230-2, where a recording stops at positions again and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.runs import rests
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.positioning import (
    PositioningFigures,
    PositioningRuns,
    check_standard_test,
    estimate_positioning,
)
from rotary_error_monitor.metrology.turns import TURN

Array = NDArray[np.float64]

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


def estimate_stops(stamp_ns: NDArray[np.int64], theta: Array, ecc: Array) -> Positioning:
    """Positioning by the stops of a recording.

    Args:
        stamp_ns: (n,) timestamps (ns).
        theta: (n,) rotation, rad.
        ecc: (n,) rotation less command, rad, NaN where not observable.
    """
    stops: dict[tuple[int, int], list[float]] = {}
    count = 0
    for first, last in rests(stamp_ns, theta):
        if first == 0 or stamp_ns[last - 1] - stamp_ns[first] < LEAST_REST_NS:
            continue  # of what was before the recording nobody knows the direction
        settled = slice((first + last) // 2, last)
        deviation = ecc[settled][np.isfinite(ecc[settled])]
        if len(deviation) == 0:
            continue
        count += 1
        before = theta[first] - theta[np.searchsorted(stamp_ns, stamp_ns[first] - LEAST_REST_NS)]
        target = float(np.mean(theta[settled])) - float(np.mean(deviation))
        place = round(target / SAME) % round(TURN / SAME)
        stops.setdefault((place, 1 if before > 0 else -1), []).append(float(np.mean(deviation)))
    return _figures(stops, count)


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
