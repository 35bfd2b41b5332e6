"""Repeated runs over a guideway: what they have in common, where they differ, how sure the mean is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.positioning import Outlier, find_outlying
from rotary_error_monitor.metrology.scans import fit_scans, neighbour_correlation
from rotary_error_monitor.metrology.straightness import check_profile

SAME_STOP = 0.1
"""Part of the least spacing within which stops of different runs are the same: over so short a way a profile that the
stops resolve is a straight line to 1 % of its finest wave, and a straight line is averaged exactly."""

SIX_SIGMA = 6.0
"""Standard deviations between two readings of one stop's position that noise never exceeds."""

LARGEST_TOLERANCE = 0.45
"""Part of the least spacing that the tolerance stays below, so that no stop is taken for its neighbour."""

LEAST_SHARED = 2 / 3
"""Stops per reading above which most stops belong to one run alone: the runs share none."""

SAME_GRID = 0.75
"""Part of a run's median spacing that the median spacing of all stops together does not fall below, if the runs share a
grid: stops that some of them leave out change it little, a second grid between those of the first halves it."""

FALSE_ALARM = 1e-3
"""Probability that clean runs show any outlier."""

ROUNDING = 1e-12
"""Part of a reading that arithmetic may round away."""

UNSURE_END = 3.0
"""Times the usual standard deviation of the mean from which a node at an end of scans is left out, if one reading is
surer: a direction may have no sample near it, while the range of a curve is often decided at its ends."""

MOST_NODES = 1001
"""Nodes of a spline through scans."""


@dataclass(frozen=True)
class Run:
    """One pass over a guideway: positions (n,) m, readings (n,) m, direction +1 or -1."""

    positions: Array
    readings: Array
    direction: int


@dataclass(frozen=True)
class RepeatedRuns:
    """What repeated passes over the same guideway have in common and where they differ, on common positions.

    Attributes:
        positions: (n,) m: the stops, all that any run visited; or nodes evenly spaced where runs share no stops.
        mean: (n,) mean of the forward and backward means, m.
        reversal: (n,) forward mean minus backward mean, m, interpolated at stops that one direction left out; None if
            all runs go one way.
        spread: (n,) standard deviation of a reading about the mean of its direction, m; zero where none is repeated.
        largest_deviation: largest distance of any reading from the mean of its direction, m.
        uncertainty: (n,) standard uncertainty of `mean` by repetition, m; None if no run was repeated.
        weights: (n,) variance of `mean` over that of a reading.
        correlation: of neighbouring readings' departures from the mean, 0 or above: drift within a run.
        stops: whether the runs share their stops.
        scatter: standard deviation of a reading about the mean of its direction, over all positions, m; zero where none
            is repeated.
        outliers: readings that stand off from the others at their stop; `target` counts the stops, `cycle` the runs
            of a direction.
        freedom: degrees of freedom of `scatter`.
        residuals: of scans, (n,) of each run in the order given, its readings less the spline of its direction, m.
    """

    positions: Array
    mean: Array
    reversal: Array | None
    spread: Array
    largest_deviation: float
    uncertainty: Array | None
    weights: Array
    correlation: float
    stops: bool
    scatter: float = 0.0
    outliers: tuple[Outlier, ...] = ()
    freedom: int = 0
    residuals: tuple[NDArray[np.float64], ...] = ()


def combine_runs(
    runs: Sequence[Run],
    *,
    noise: float = 0.0,
    position_noise: float = 0.0,
    spacing: float | None = None,
    drop_outliers: bool = False,
) -> RepeatedRuns:
    """Mean, reversal part and repeatability of runs; nothing is cut, no run needs to visit all stops.

    Stops of different runs that are as near to one another as `position_noise` (standard deviation, m) and a part of
    their spacing let them be are the same stop, and are averaged. Runs that share no stops, such as scans, are fitted
    by a spline with a node every `spacing` m (by default the largest median sample spacing, up to twice that where the
    samples leave gaps). Each run has a height of its own: a shift of the sensor between runs is no repeatability.

    Args:
        runs: in any order, each with its positions in any order.
        noise: stated standard deviation of a reading, m: no reading is an outlier for half of it.
        position_noise: standard deviation of a stop's position, m.
        spacing: of the nodes; runs that share their stops have none.
        drop_outliers: leave out readings that stand off from the others at their stop.

    Raises:
        InputError: no run, a run that cannot be evaluated or is of no direction, or a part of the way that no run of
            a direction covers.
    """
    _check_runs(runs)
    if (stops := _common_stops(runs, position_noise)) is None:
        return _combine_scans(runs, spacing)
    positions, indices = stops
    tables = _tabulate(runs, positions, indices)
    placed = list(zip(runs, indices, strict=True))
    if any(np.any(run.positions != positions[index]) for run, index in placed):
        # a stop that is a little off reads the slope there as well
        slope = np.gradient(_average(positions, tables, ()).mean, positions)
        straight = [
            replace(run, readings=run.readings - slope[i] * (run.positions - positions[i])) for run, i in placed
        ]
        tables = _tabulate(straight, positions, indices)
    least = max(noise / 2, ROUNDING * max(float(np.abs(run.readings).max()) for run in runs))
    outliers = find_outlying(list(tables.items()), false_alarm=FALSE_ALARM, least_scale=least)
    if drop_outliers and outliers:
        for outlier in outliers:
            tables[outlier.direction][outlier.target, outlier.cycle] = np.nan
        tables = {sign: table - _heights(table) for sign, table in tables.items()}
    return _average(positions, tables, outliers)


def _check_runs(runs: Sequence[Run]) -> None:
    """Refuse no run at all, one that cannot be evaluated, or of no direction.

    Raises:
        InputError: as `combine_runs`.
    """
    if not runs:
        raise InputError("no run; give at least one")
    for run in runs:
        check_profile(run.positions, run.readings)
    if {run.direction for run in runs} - {1, -1}:
        raise InputError(f"directions {sorted({run.direction for run in runs})}: +1 and -1 are known")


def _tabulate(runs: Sequence[Run], positions: Array, indices: Sequence[NDArray[np.int64]]) -> dict[int, Array]:
    """Readings (s, r) by stop and run of each direction, NaN where a stop was left out, heights of runs removed."""
    tables = {}
    for sign in sorted({run.direction for run in runs}, reverse=True):
        chosen = [(run, index) for run, index in zip(runs, indices, strict=True) if run.direction == sign]
        table = np.full((len(positions), len(chosen)), np.nan)
        for column, (run, index) in zip(table.T, chosen, strict=True):
            column[index] = run.readings
        tables[sign] = table - _heights(table)
    return tables


def _common_stops(runs: Sequence[Run], position_noise: float) -> tuple[Array, list[NDArray[np.int64]]] | None:
    """Mean position of each stop and which stop each reading of a run is; None if runs have few stops in common."""
    steps = np.concatenate([np.diff(np.sort(run.positions)) for run in runs])
    least = float(steps.min())
    tolerance = min(max(SAME_STOP * least, SIX_SIGMA * position_noise), LARGEST_TOLERANCE * least)
    everything = np.concatenate([run.positions for run in runs])
    order = np.argsort(everything, kind="stable")
    ranked = everything[order]
    label = np.concatenate([[0], np.cumsum(np.diff(ranked) > tolerance)])
    first = np.searchsorted(label, np.arange(label[-1] + 1))
    last = np.append(first[1:], len(label)) - 1
    if len(runs) > 1 and (
        np.any(ranked[last] - ranked[first] > tolerance)
        or len(first) > LEAST_SHARED * len(everything)
        or np.median(np.diff(ranked[first])) < SAME_GRID * min(np.median(np.diff(np.sort(r.positions))) for r in runs)
    ):
        return None
    index = np.empty(len(everything), dtype=np.int64)
    index[order] = label
    bounds = np.cumsum([len(run.positions) for run in runs])[:-1]
    parts = np.split(index, bounds)
    if any(len(np.unique(part)) < len(part) for part in parts) or not _connected(runs, parts):
        return None
    return np.bincount(index, everything) / np.bincount(index), parts


def _heights(table: Array) -> Array:
    """(r,) height of each run in readings (s, r), NaN where a run left a stop out, by least squares; their sum is 0."""
    seen = np.isfinite(table).astype(np.float64)
    values = np.nan_to_num(table)
    visits = seen.sum(axis=1)
    share = np.divide(1.0, visits, out=np.zeros_like(visits), where=visits > 0)
    normal = np.diag(seen.sum(axis=0)) - seen.T @ (share[:, None] * seen)
    right = values.sum(axis=0) - seen.T @ (share * values.sum(axis=1))
    return np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0])


def _connected(runs: Sequence[Run], indices: Sequence[NDArray[np.int64]]) -> bool:
    """Whether runs of each direction, and the directions, have stops in common that tell their heights apart."""
    ways = [
        set(np.concatenate([index for run, index in zip(runs, indices, strict=True) if run.direction == sign]).tolist())
        for sign in {run.direction for run in runs}
    ]
    if not set.intersection(*ways):
        return False
    for sign in (1, -1):
        chosen = [set(index.tolist()) for run, index in zip(runs, indices, strict=True) if run.direction == sign]
        while len(chosen) > 1:
            first = chosen.pop()
            near = next((other for other in chosen if other & first), None)
            if near is None:
                return False
            near |= first
    return True


def _average(positions: Array, tables: dict[int, Array], outliers: tuple[Outlier, ...]) -> RepeatedRuns:
    """Stop by stop, from readings (s, r) of each direction with the heights of their runs removed."""
    counts = {sign: np.isfinite(table).sum(axis=1) for sign, table in tables.items()}
    means = {sign: np.nansum(table, axis=1) / np.maximum(counts[sign], 1) for sign, table in tables.items()}
    reversal = None
    if len(tables) == 2:
        both = (counts[1] > 0) & (counts[-1] > 0)
        # the heights of the directions are those of their sensors as well: their difference has no meaning
        shift = np.mean((means[1] - means[-1])[both])
        means[-1], tables = means[-1] + shift, {1: tables[1], -1: tables[-1] + shift}
        reversal = np.interp(positions, positions[both], (means[1] - means[-1])[both])
        means = {sign: np.where(counts[sign] > 0, means[sign], means[-sign] + sign * reversal) for sign in (1, -1)}
    deviations = {sign: table - means[sign][:, None] for sign, table in tables.items()}
    freedom = sum(
        int(count.sum()) - int((count > 0).sum()) - (tables[sign].shape[1] - 1) for sign, count in counts.items()
    )
    squares = np.sum([np.nansum(each**2, axis=1) for each in deviations.values()], axis=0)
    repeats = np.sum([np.maximum(count - 1, 0) for count in counts.values()], axis=0)
    weights = np.sum([1 / np.maximum(count, 1) for count in counts.values()], axis=0) / len(tables) ** 2
    uncertainty, scatter = None, 0.0
    if freedom > 0:
        scatter = math.sqrt(float(squares.sum()) / freedom)
        variance = weights * scatter**2
        if reversal is not None:  # half the reversal is missing where one direction is, and known as it varies
            alone = (counts[1] == 0) | (counts[-1] == 0)
            variance = variance + np.where(alone, np.var(reversal) / 4, 0.0)
        uncertainty = np.sqrt(variance)
    return RepeatedRuns(
        positions=positions,
        mean=np.mean(list(means.values()), axis=0),
        reversal=reversal,
        spread=np.sqrt(squares / np.maximum(repeats, 1)),
        largest_deviation=max(float(np.nanmax(np.abs(each))) for each in deviations.values()),
        uncertainty=uncertainty,
        weights=weights,
        correlation=neighbour_correlation([(positions, column) for each in deviations.values() for column in each.T]),
        stops=True,
        scatter=scatter,
        outliers=outliers,
        freedom=max(0, freedom),
    )


def _longest_step(runs: Sequence[Run], first: float, last: float) -> float:
    """Longest way from `first` to `last` without a sample of all runs of a direction, m."""
    ways = [
        np.concatenate([[first, last], *(run.positions for run in runs if run.direction == sign)])
        for sign in {run.direction for run in runs}
    ]
    return max(float(np.diff(np.sort(way)).max()) for way in ways)


def _combine_scans(runs: Sequence[Run], spacing: float | None) -> RepeatedRuns:
    """Runs at positions of their own: a cubic spline for each direction, and the height of each run."""
    first = min(float(run.positions.min()) for run in runs)
    last = max(float(run.positions.max()) for run in runs)
    if spacing is None:
        usual = max(float(np.median(np.diff(np.sort(run.positions)))) for run in runs)
        spacing = min(2 * usual, max(usual, _longest_step(runs, first, last)))
    # a little fewer rather than more: each two nodes have a sample between them
    breaks = np.linspace(
        first, last, min(max(2, math.floor((last - first) / spacing * (1 + ROUNDING)) + 1), MOST_NODES)
    )
    known, residuals = {}, dict[int, NDArray[np.float64]]()
    for sign in sorted({run.direction for run in runs}, reverse=True):
        own = [number for number, run in enumerate(runs) if run.direction == sign]
        scans = [(runs[number].positions, runs[number].readings) for number in own]
        known[sign] = fit_scans(scans, breaks)
        ends = np.cumsum([len(positions) for positions, _ in scans])[:-1]
        residuals.update(zip(own, np.split(known[sign].residual, ends), strict=True))
    means = {sign: fit.values - (fit.values.mean() if len(known) == 2 else 0.0) for sign, fit in known.items()}
    freedom = sum(fit.freedom for fit in known.values())
    squares = sum(float((fit.residual**2).sum()) for fit in known.values())
    weights = np.sum([fit.weights for fit in known.values()], axis=0) / len(known) ** 2
    variance = squares / freedom if freedom > 0 else 0.0
    sure = _sure_nodes(weights)
    reversal = means[1] - means[-1] if len(means) == 2 else None
    return RepeatedRuns(
        positions=breaks[sure],
        mean=np.mean(list(means.values()), axis=0)[sure],
        reversal=None if reversal is None else reversal[sure],
        spread=np.full(len(breaks[sure]), np.sqrt(variance)),
        largest_deviation=max(float(np.abs(fit.residual).max()) for fit in known.values()),
        uncertainty=np.sqrt(variance * weights[sure]) if freedom > 0 else None,
        weights=weights[sure],
        correlation=neighbour_correlation([(runs[number].positions, part) for number, part in residuals.items()]),
        stops=False,
        scatter=math.sqrt(variance),
        freedom=max(0, freedom),
        residuals=tuple(residuals[number] for number in range(len(runs))),
    )


def _sure_nodes(weights: Array) -> slice:
    """All nodes but those at the ends whose variance, in units of a reading's, stands out of the others'."""
    sure = np.flatnonzero(weights <= max(1.0, UNSURE_END**2 * float(np.median(weights))))
    return slice(int(sure[0]), int(sure[-1]) + 1)
