"""Straightness of a linear axis: reference lines and figures (ISO 230-1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linprog

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError

LineMethod = Literal["least_squares", "end_point", "minimum_zone"]


@dataclass(frozen=True)
class ReferenceLine:
    """Line `offset + slope * (position - origin)` that straightness deviations are measured from; m, and rad."""

    origin: float
    offset: float
    slope: float

    def heights(self, positions: Array) -> Array:
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
    deviations: Array
    error: float


def fit_line(positions: Array, profile: Array, method: LineMethod = "least_squares") -> ReferenceLine:
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


def estimate_straightness(positions: Array, profile: Array, method: LineMethod = "least_squares") -> Straightness:
    """Deviations of a profile from its reference line, and their range; arguments and errors as `fit_line`."""
    line = fit_line(positions, profile, method)
    deviations = profile - line.heights(positions)
    return Straightness(line, deviations, float(np.ptp(deviations)))


def _chebyshev_line(x: Array, profile: Array) -> tuple[float, float]:
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


def check_profile(positions: Array, profile: Array) -> None:
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
