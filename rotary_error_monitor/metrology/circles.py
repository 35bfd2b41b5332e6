"""Centres of a polar profile: least squares, minimum zone, minimum circumscribed, maximum inscribed (ISO 230-7, 3.2).

Error motion is thousands of times smaller than the base circle of its polar picture. Then a shift (a, b) of the centre
takes `a cos(angle) + b sin(angle)` off the profile (limaçon), the least-squares centre is a linear fit, and the other
three are linear programmes with an exact solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError

CENTRES: Mapping[str, str] = {
    "LSC": "least-squares circle",
    "MZC": "minimum zone circles",
    "MCC": "minimum circumscribed circle",
    "MIC": "maximum inscribed circle",
}
"""How a centre is chosen, by its abbreviation in ISO 230-7."""

MOST_EXCHANGES = 100
"""Exchanges of one constraint after which the general solver takes over; mostly ten are enough for 360 points."""

ROUNDING = 1e-12
"""What counts as zero beside numbers of about one: some thousand times their rounding."""


@dataclass(frozen=True)
class Centre:
    """A centre of a polar profile.

    Attributes:
        shift: (x, y) of the centre, in the profile's unit.
        value: distance of the two circles about it that hold the profile: largest less smallest radius.
    """

    shift: tuple[float, float]
    value: float


def find_centre(angles: Array, profile: Array, method: str) -> Centre:
    """Centre of a polar profile and the value about it.

    Args:
        angles: (k,) rad, over the whole turn.
        profile: (k,) deviation from the base circle.
        method: one of `CENTRES`.

    Raises:
        InputError: there is no such method, or fewer than three angles.
    """
    if method not in CENTRES:
        raise InputError(f"'{method}' is no centre of a polar profile; there are {', '.join(CENTRES)}")
    if len(angles) < 3:
        raise InputError(f"a polar profile of {len(angles)} angles; at least 3 have a centre")
    waves = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if method == "LSC":
        shift = np.linalg.lstsq(np.column_stack([waves, np.ones(len(angles))]), profile, rcond=None)[0][:2]
    else:
        shift = _programme(waves, profile, method)
    left = profile - waves @ shift
    return Centre((float(shift[0]), float(shift[1])), float(np.ptp(left)))


def _programme(waves: Array, profile: Array, method: str) -> Array:
    """(2,) shift by a linear programme in shift and outer or inner radius, solved in units of the profile's size."""
    size = float(np.ptp(profile))
    if size == 0.0:
        return np.zeros(2)
    scaled, one = (profile - float(profile.mean())) / size, np.ones((len(profile), 1))
    within, without = np.hstack([-waves, -one]), np.hstack([waves, one])  # of the outer circle, of the inner one
    if method == "MCC":
        rows, edges, cost = within, -scaled, np.array([0.0, 0.0, 1.0])
    elif method == "MIC":
        rows, edges, cost = without, scaled, np.array([0.0, 0.0, -1.0])
    else:
        rows = np.vstack([np.insert(within, 3, 0.0, axis=1), np.insert(without, 2, 0.0, axis=1)])
        edges, cost = np.concatenate([-scaled, scaled]), np.array([0.0, 0.0, 1.0, -1.0])
    found = _exchanged(rows, edges, cost, _spread(len(profile), method))
    if found is None:
        from scipy.optimize import linprog  # loads for a third of a second, and is rarely needed

        solution = linprog(cost, rows, edges, bounds=(None, None), method="highs")
        assert solution.x is not None, solution.message  # such a programme always has a solution
        found = solution.x
    return np.asarray(found[:2] * size)


def _spread(count: int, method: str) -> list[int]:
    """Constraints whose circles no shift makes better at all points: three points, or four by turns, over the turn."""
    if method != "MZC":
        return [0, count // 3, 2 * count // 3]
    return [0, count // 2, count + count // 4, count + 3 * count // 4]


def _exchanged(rows: Array, edges: Array, cost: Array, basis: list[int]) -> Array | None:
    """Least `cost @ x` where `rows @ x <= edges`, by exchange of constraints (dual simplex method, Lemke 1954).

    The constraint that is violated most takes the place of one of as many as there are unknowns, until none is. None
    where the `basis` to begin with does not hold the cost, where the solution is not the only one, or none is found.
    """
    for _ in range(MOST_EXCHANGES):
        active = rows[basis]
        try:
            x = np.linalg.solve(active, edges[basis])
            excess = rows @ x - edges
            worst = int(excess.argmax())
            pulls, change = np.linalg.solve(active.T, np.stack([-cost, rows[worst]], axis=1)).T
        except np.linalg.LinAlgError:
            return None
        if pulls.min() < ROUNDING:
            return None
        if excess[worst] <= ROUNDING:
            return np.asarray(x, np.float64)
        places = np.flatnonzero(change > ROUNDING)
        if len(places) == 0:
            return None
        basis[places[(pulls[places] / change[places]).argmin()]] = worst
    return None
