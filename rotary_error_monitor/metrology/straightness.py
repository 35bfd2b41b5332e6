"""Straightness of a linear axis: reference lines and figures (ISO 230-1), repeated runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from rotary_error_monitor.errors import InputError

LineMethod = Literal["least_squares", "end_point", "minimum_zone"]


@dataclass(frozen=True)
class ReferenceLine:
    """Line `offset + slope * (position - origin)` that straightness deviations are measured from; m, and rad."""

    origin: float
    offset: float
    slope: float

    def heights(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) heights of the line at `positions` (n,) m."""
        return self.offset + self.slope * (positions - self.origin)


@dataclass(frozen=True)
class Straightness:
    """Straightness of a profile against a reference line.

    Attributes:
        line: the reference line.
        deviations: (n,) profile minus line, m.
        error: straightness error, the range of the deviations, m.
    """

    line: ReferenceLine
    deviations: NDArray[np.float64]
    error: float


def fit_line(
    positions: NDArray[np.float64], profile: NDArray[np.float64], method: LineMethod = "least_squares"
) -> ReferenceLine:
    """Reference line of a profile (n,) m over positions (n,) m, in any order and spacing (ISO 230-1:2012, clause 3.4).

    `least_squares` and `end_point` as named; `minimum_zone` is the middle of the two parallel lines of least distance
    that hold all points, which gives the smallest straightness error there is.

    Raises:
        InputError: fewer than two different positions, shapes that differ, or a number that is not finite.
    """
    check_profile(positions, profile)
    origin = float(positions.mean())
    x = positions - origin
    if method == "least_squares":
        slope = float(x @ (profile - profile.mean()) / (x @ x))
        return ReferenceLine(origin, float(profile.mean()), slope)
    if method == "end_point":
        first, last = int(np.argmin(x)), int(np.argmax(x))
        slope = float((profile[last] - profile[first]) / (x[last] - x[first]))
        return ReferenceLine(origin, float(profile[first] - slope * x[first]), slope)
    offset, slope = _chebyshev_line(x, profile)
    return ReferenceLine(origin, offset, slope)


def estimate_straightness(
    positions: NDArray[np.float64], profile: NDArray[np.float64], method: LineMethod = "least_squares"
) -> Straightness:
    """Deviations of a profile from its reference line, and their range; arguments and errors as `fit_line`."""
    line = fit_line(positions, profile, method)
    deviations = profile - line.heights(positions)
    return Straightness(line, deviations, float(np.ptp(deviations)))


def _chebyshev_line(x: NDArray[np.float64], profile: NDArray[np.float64]) -> tuple[float, float]:
    """Offset and slope of least largest distance: a linear program, scaled to numbers about one."""
    reach = float(np.abs(x).max())
    middle, height = float(profile.mean()), float(np.ptp(profile))
    if height == 0:
        return middle, 0.0
    u, v = x / reach, (profile - middle) / height
    ones = np.ones_like(u)
    upper = np.column_stack([-ones, -u, -ones])
    lower = np.column_stack([ones, u, -ones])
    solution = linprog(
        [0, 0, 1],
        A_ub=np.concatenate([upper, lower]),
        b_ub=np.concatenate([-v, v]),
        bounds=[(None, None)] * 2 + [(0, None)],
    )
    assert solution.x is not None, "a zone wide enough holds all points"
    offset, slope, _ = solution.x
    return middle + height * float(offset), height / reach * float(slope)


def check_profile(positions: NDArray[np.float64], profile: NDArray[np.float64]) -> None:
    """Hold that a profile can be evaluated.

    Raises:
        InputError: fewer than two different positions, shapes that differ, or a number that is not finite.
    """
    if positions.ndim != 1 or positions.shape != profile.shape:
        raise InputError(f"positions of shape {positions.shape} and a profile of shape {profile.shape} do not fit")
    for name, values in (("position", positions), ("profile", profile)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} {int(np.argmin(np.isfinite(values)))} is not finite; drop or mend that sample")
    if len(positions) < 2 or np.ptp(positions) == 0:
        raise InputError(
            f"{len(positions)} sample(s) at one position make no profile; at least two positions are needed"
        )


@dataclass(frozen=True)
class Run:
    """One pass over a guideway: positions (n,) m, readings (n,) m, direction +1 or -1."""

    positions: NDArray[np.float64]
    readings: NDArray[np.float64]
    direction: int


@dataclass(frozen=True)
class RepeatedRuns:
    """What repeated passes over the same guideway have in common and where they differ, on common positions.

    Attributes:
        positions: (n,) m.
        mean: (n,) mean of the forward and backward means, m.
        reversal: (n,) forward mean minus backward mean, m; None if all runs go one way.
        spread: (n,) standard deviation of a run about the mean of its direction, m.
        largest_deviation: largest distance of any run from the mean of its direction, m.
        standard_uncertainty: of `mean` by repetition, pooled over the positions, m.
    """

    positions: NDArray[np.float64]
    mean: NDArray[np.float64]
    reversal: NDArray[np.float64] | None
    spread: NDArray[np.float64]
    largest_deviation: float
    standard_uncertainty: float


def combine_runs(runs: Sequence[Run], *, spacing: float | None = None) -> RepeatedRuns:
    """Mean, reversal part and repeatability of runs that need not share their sample positions.

    Each run is averaged in cells of `spacing` (m; by default twice the largest median sample spacing) over the range
    that all runs cover. Each run's mean height is removed: a shift of the sensor between runs is no repeatability.

    Raises:
        InputError: fewer than two runs in a direction, runs that do not overlap, or a run with a gap.
    """
    for run in runs:
        check_profile(run.positions, run.readings)
    counts = {sign: sum(run.direction == sign for run in runs) for sign in (1, -1)}
    if sum(counts.values()) != len(runs):
        raise InputError(f"directions {sorted({run.direction for run in runs})}: +1 and -1 are known")
    if not any(counts.values()) or 1 in counts.values():
        raise InputError(
            f"{counts[1]} runs forward and {counts[-1]} backward; repeatability needs two in each direction"
        )
    edges = _common_cells(runs, spacing)
    cells = np.stack([_cell_means(run, edges) for run in runs])
    cells = cells - cells.mean(axis=1, keepdims=True)
    directions = np.array([run.direction for run in runs])
    means = {sign: cells[directions == sign].mean(axis=0) for sign, count in counts.items() if count}
    residuals = cells - np.stack([means[int(sign)] for sign in directions])
    freedom = len(runs) - len(means)
    variance = (residuals**2).sum(axis=0) / freedom
    share = sum(1 / counts[sign] for sign in means) / len(means) ** 2
    return RepeatedRuns(
        positions=(edges[1:] + edges[:-1]) / 2,
        mean=np.mean(list(means.values()), axis=0),
        reversal=means[1] - means[-1] if len(means) == 2 else None,
        spread=np.sqrt(variance),
        largest_deviation=float(np.abs(residuals).max()),
        standard_uncertainty=float(np.sqrt(variance.mean() * share)),
    )


def _common_cells(runs: Sequence[Run], spacing: float | None) -> NDArray[np.float64]:
    first = max(float(run.positions.min()) for run in runs)
    last = min(float(run.positions.max()) for run in runs)
    if spacing is None:
        spacing = 2 * max(float(np.median(np.abs(np.diff(run.positions)))) for run in runs)
    count = int((last - first) / spacing)
    if count < 2:
        raise InputError(f"all runs share only {first:g} m to {last:g} m, cells of {spacing:g} m need more")
    return np.linspace(first, last, count + 1)


def _cell_means(run: Run, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    index = np.searchsorted(edges, run.positions, side="right") - 1
    index[run.positions == edges[-1]] = len(edges) - 2
    inside = (index >= 0) & (index < len(edges) - 1)
    count = np.bincount(index[inside], minlength=len(edges) - 1)
    if np.any(count == 0):
        at = int(np.argmin(count))
        raise InputError(
            f"a run has no sample from {edges[at]:g} m to {edges[at + 1]:g} m; measure it again without the gap"
        )
    return np.bincount(index[inside], weights=run.readings[inside], minlength=len(edges) - 1) / count
