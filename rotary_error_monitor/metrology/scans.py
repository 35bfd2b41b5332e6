"""Scans of one profile at positions of their own: their common spline, and the height of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from rotary_error_monitor.errors import InputError

DEGREE = 3
"""Of the common spline: of all curves through the same heights the cubic one bends least (Holladay 1957)."""

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

    values: NDArray[np.float64]
    weights: NDArray[np.float64]
    residual: NDArray[np.float64]
    freedom: int


def fit_scans(scans: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], breaks: NDArray[np.float64]) -> ScanFit:
    """Cubic spline with nodes at rising `breaks` (b,) m through scans of positions and readings (n,) m.

    Raises:
        InputError: no scan has a sample between two breaks.
    """
    positions = np.concatenate([positions for positions, _ in scans])
    count, _ = np.histogram(positions, breaks)
    if np.any(count == 0):
        at = int(np.argmin(count))
        raise InputError(
            f"no run of a direction has a sample from {breaks[at]:g} m to {breaks[at + 1]:g} m; measure without the gap"
        )
    knots = np.concatenate([np.full(DEGREE, breaks[0]), breaks, np.full(DEGREE, breaks[-1])])
    spline = BSpline.design_matrix(positions, knots, DEGREE).toarray()
    which = np.repeat(np.arange(len(scans)), [len(positions) for positions, _ in scans])
    heights = (which[:, None] == np.arange(1, len(scans))).astype(np.float64)
    design = np.concatenate([spline, heights], axis=1)
    readings = np.concatenate([readings for _, readings in scans])
    solution, _, rank, _ = np.linalg.lstsq(design, readings, rcond=None)
    at_breaks = BSpline.design_matrix(breaks, knots, DEGREE).toarray()
    size = spline.shape[1]
    inverse = np.linalg.pinv(design.T @ design, hermitian=True)[:size, :size]
    return ScanFit(
        values=at_breaks @ solution[:size],
        weights=np.asarray(((at_breaks @ inverse) * at_breaks).sum(axis=1)),
        residual=readings - design @ solution,
        freedom=len(readings) - int(rank),
    )


def neighbour_correlation(departures: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> float:
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
