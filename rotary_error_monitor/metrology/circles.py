"""Centres of a polar profile: least squares, minimum zone, minimum circumscribed, maximum inscribed (ISO 230-7, 3.2).

Error motion is thousands of times smaller than the base circle of its polar picture. Then a shift (a, b) of the centre
takes `a cos(angle) + b sin(angle)` off the profile (limaçon), the least-squares centre is a linear fit, and the other
three are linear programmes with an exact solution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from rotary_error_monitor.errors import InputError

Array = NDArray[np.float64]

CENTRES: Mapping[str, str] = {
    "LSC": "least-squares circle",
    "MZC": "minimum zone circles",
    "MCC": "minimum circumscribed circle",
    "MIC": "maximum inscribed circle",
}
"""How a centre is chosen, by its abbreviation in ISO 230-7."""


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
    """(2,) shift by a linear programme in shift, outer and inner radius, solved in units of the profile's size."""
    size = float(np.ptp(profile))
    if size == 0.0:
        return np.zeros(2)
    level = float(profile.mean())
    rows, edges = [], []
    scaled, one, nothing = (profile - level) / size, np.ones((len(profile), 1)), np.zeros((len(profile), 1))
    if method in ("MZC", "MCC"):  # all within the outer circle
        rows.append(np.hstack([-waves, -one, nothing]))
        edges.append(-scaled)
    if method in ("MZC", "MIC"):  # all without the inner circle
        rows.append(np.hstack([waves, nothing, one]))
        edges.append(scaled)
    cost = np.array([0.0, 0.0, method != "MIC", -float(method != "MCC")])
    bounds: list[tuple[float | None, float | None]] = [(None, None)] * 4
    if method == "MCC":
        bounds[3] = (0.0, 0.0)
    if method == "MIC":
        bounds[2] = (0.0, 0.0)
    found = linprog(cost, np.vstack(rows), np.concatenate(edges), bounds=bounds, method="highs")
    assert found.x is not None, found.message  # such a programme always has a solution
    return np.asarray(found.x[:2] * size)
