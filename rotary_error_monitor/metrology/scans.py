"""Scans of one profile at positions of their own: their common spline, and the height of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError

DEGREE = 3
"""Of the common spline: of all curves through the same heights the cubic one bends least (Holladay 1957)."""

LEAST_PIVOT = 1e-4
"""Of the banded Cholesky factor, beside its largest pivot: normal equations then keep eight digits."""

FEWEST_CORRELATED = 4
"""Readings of a run from which two neighbours beside its line say something of one another."""


@dataclass(frozen=True)
class ScanFit:
    """A spline through scans.

    Attributes:
        values: (b,) at the breaks, in the height of the first scan.
        weights: (b,) variance of the values over that of a reading.
        residual: (n,) of all readings.
        freedom: degrees of freedom of the residual.
    """

    values: Array
    weights: Array
    residual: Array
    freedom: int


def fit_scans(scans: Sequence[tuple[Array, Array]], breaks: Array) -> ScanFit:
    """Cubic spline with nodes at rising `breaks` (b,) m through scans of positions and readings (n,) m.

    Raises:
        InputError: no scan has a sample between two breaks.
    """
    positions = np.concatenate([positions for positions, _ in scans])
    if empty := gap_between(breaks, positions):
        raise InputError(f"no run of a direction has a sample {empty}; measure without the gap")
    knots = knots_of(breaks)
    spline = csr_array(BSpline.design_matrix(positions, knots, DEGREE))
    which = np.repeat(np.arange(len(scans)), [len(positions) for positions, _ in scans])
    heights = (which[:, None] == np.arange(1, len(scans))).astype(np.float64)
    readings = np.concatenate([readings for _, readings in scans])
    at_breaks = csr_array(BSpline.design_matrix(breaks, knots, DEGREE))
    return _fit_banded(spline, heights, readings, at_breaks) or _fit_dense(spline, heights, readings, at_breaks)


def gap_between(breaks: Array, samples: Array) -> str:
    """Between which of rising `breaks` (b,) m there is no sample (n,) m, in words; empty where there is one in each."""
    count, _ = np.histogram(samples, breaks)
    at = int(np.argmin(count))
    return "" if count[at] else f"from {breaks[at] * 1e3:g} mm to {breaks[at + 1] * 1e3:g} mm"


def knots_of(breaks: Array) -> Array:
    """Knots of a spline with nodes at rising `breaks` (b,)."""
    return np.concatenate([np.full(DEGREE, breaks[0]), breaks, np.full(DEGREE, breaks[-1])])


def upper_band(matrix: csr_array) -> Array:
    """(DEGREE + 1, n) diagonals of a spline's normal matrix (n, n), as LAPACK takes them."""
    band = np.zeros((DEGREE + 1, matrix.shape[0]))
    for above in range(DEGREE + 1):
        band[DEGREE - above, above:] = matrix.diagonal(above)
    return band


def _fit_banded(spline: csr_array, heights: Array, readings: Array, at_breaks: csr_array) -> ScanFit | None:
    """By normal equations, the spline's banded block eliminated first; None where samples hardly tell a coefficient."""
    normal = csr_array(spline.T @ spline)
    try:
        factor = cholesky_banded(upper_band(normal))
    except np.linalg.LinAlgError:
        return None
    pivots = factor[DEGREE]
    if pivots.min() < LEAST_PIVOT * pivots.max():
        return None
    cross = np.asarray(spline.T @ heights)
    gain = cho_solve_banded((factor, False), cross)
    alone = cho_solve_banded((factor, False), np.asarray(spline.T @ readings))
    inverse = np.linalg.inv(heights.T @ heights - cross.T @ gain)
    shifts = inverse @ (heights.T @ readings - cross.T @ alone)
    coefficients = alone - gain @ shifts
    through = at_breaks @ gain
    within = cho_solve_banded((factor, False), at_breaks.T.toarray())
    weights = np.asarray(at_breaks.multiply(within.T).sum(axis=1)).ravel() + ((through @ inverse) * through).sum(axis=1)
    return ScanFit(
        values=at_breaks @ coefficients,
        weights=weights,
        residual=readings - spline @ coefficients - heights @ shifts,
        freedom=len(readings) - len(coefficients) - len(shifts),
    )


def _fit_dense(spline: csr_array, heights: Array, readings: Array, at_breaks: csr_array) -> ScanFit:
    """By singular values: of what samples do not tell the smallest."""
    design = np.concatenate([spline.toarray(), heights], axis=1)
    solution, _, rank, _ = np.linalg.lstsq(design, readings, rcond=None)
    size = spline.shape[1]
    inverse = np.linalg.pinv(design.T @ design, hermitian=True)[:size, :size]
    rows = at_breaks.toarray()
    return ScanFit(
        values=rows @ solution[:size],
        weights=np.asarray(((rows @ inverse) * rows).sum(axis=1)),
        residual=readings - design @ solution,
        freedom=len(readings) - int(rank),
    )


def neighbour_correlation(departures: Sequence[tuple[Array, Array]]) -> float:
    """Correlation of neighbours in positions and departures (n,) of runs, NaN where there is none; 0 or above.

    The line of each run is taken out: it makes no error of straightness.
    """
    product, square = 0.0, 0.0
    for positions, values in departures:
        seen = np.isfinite(values)
        if seen.sum() < FEWEST_CORRELATED:
            continue
        order = np.argsort(positions[seen])
        x, y = positions[seen][order], values[seen][order]
        rest = y - np.polynomial.Polynomial.fit(x, y, 1)(x)
        product += float(rest[1:] @ rest[:-1])
        square += float(rest @ rest)
    return max(0.0, product / square) if square > 0 else 0.0
