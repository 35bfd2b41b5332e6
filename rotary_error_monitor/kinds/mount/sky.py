"""The sky around a pointing: patches that are left out whole, and how well a mount repeats among neighbours.

What neighbouring pointings do not share is noise, whatever causes what they share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.problem import Conditions
from rotary_error_monitor.gap.table import folded

FOLDS = 6
"""Parts that are left out in turn: a sixth leaves enough to fit, as of poses of a machine and of sectors."""

BLOCKS = 24
"""Patches; every sixth of them is left out together, so that the others lie around it."""

ON_SKY, OVER_TIME = 12, 8
"""Pointings from which one is predicted: four for each coefficient of a plane over the sky, or of a line over time."""

OUTLIER = 8.0
"""Standard deviations from its neighbours beyond which a pointing is a mistake: no noise of a night reaches them."""

MOST_OUTLIERS = 0.05
"""Part of the pointings that can be mistakes: of more, what is far from its neighbours is how the mount is."""

_NINE_TENTHS = 1.6449
"""Nine tenths of normal numbers are closer to zero than this many standard deviations."""


def sky_patches(readings: Array) -> list[NDArray[np.intp]]:
    """Rows of each patch, from readings (n, 2): halves, and halves of these, across the wider axis; at last thirds."""
    return _split(readings, np.arange(len(readings), dtype=np.intp), BLOCKS)


def sky_conditions(patches: list[NDArray[np.intp]]) -> Conditions:
    """Blocks of pointings that are arranged patch after patch."""
    return folded(np.concatenate([[0], np.cumsum([len(patch) for patch in patches])]), FOLDS, "patches")


def neighbourhood(places: Array) -> tuple[NDArray[np.intp], Array]:
    """For each of n places (n, k) its neighbours (n, m) and how to predict it from them (n, m).

    The weights are those of a plane through the neighbours (Cleveland 1979, without tapering): all that is smooth over
    a neighbourhood is predicted, noise is not.
    """
    count = min(ON_SKY if places.shape[1] > 1 else OVER_TIME, len(places) - 1)
    _, found = cKDTree(places).query(places, count + 1)
    neighbours = np.asarray(found, np.intp)[:, 1:]
    away = places[neighbours] - places[:, None]
    table = np.concatenate([np.ones((*away.shape[:2], 1)), away], axis=2)
    gram = np.einsum("nmi,nmj->nij", table, table)
    # Where neighbours lie in a line the plane is not known across it; it is not needed there either.
    gram += 1e-6 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(gram.shape[1])
    first = np.zeros((gram.shape[1], 1))
    first[0] = 1.0
    solved = np.linalg.solve(gram, np.broadcast_to(first, (len(places), *first.shape)))
    return neighbours, np.asarray((table @ solved)[:, :, 0], np.float64)


def estimate_repeatability(errors: Array, places: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Standard deviations (k,) of components of errors (n, k) that neighbours do not share, and (n,) no outlier.

    A place further from its neighbours than 8 standard deviations is an outlier, at most one in twenty of them.
    """
    neighbours, weights = neighbourhood(places)
    kept = np.ones(len(errors), bool)
    for _ in range(3):
        used = weights * kept[neighbours]
        used = used / np.maximum(used.sum(axis=1, keepdims=True), 0.1)
        predicted = np.einsum("nm,nmk->nk", used, errors[neighbours])
        alone = (errors - predicted) / np.sqrt(1 + np.sum(np.square(used), axis=1))[:, None]
        spread = np.quantile(np.abs(alone[kept]), 0.9, axis=0) / _NINE_TENTHS
        distance = np.max(np.abs(alone) / np.maximum(spread, 1e-300), axis=1)
        kept = distance < max(OUTLIER, float(np.quantile(distance, 1 - MOST_OUTLIERS)))
    return np.sqrt(np.mean(np.square(alone[kept]), axis=0)), kept


def unshared(columns: Array, places: Array) -> Array:
    """(n, q) what neighbours do not share of columns (n, q), scaled to be as loud as they are of white noise."""
    neighbours, weights = neighbourhood(places)
    predicted = np.einsum("nm,nmq->nq", weights, columns[neighbours])
    return np.asarray((columns - predicted) / np.sqrt(1 + np.sum(np.square(weights), axis=1))[:, None], np.float64)


def _split(readings: Array, rows: NDArray[np.intp], parts: int) -> list[NDArray[np.intp]]:
    if parts == 1:
        return [rows]
    wider = int(np.argmax(np.ptp(readings[rows], axis=0)))
    rows = rows[np.argsort(readings[rows, wider], kind="stable")]
    pieces = 2 if parts % 2 == 0 else parts
    return [patch for piece in np.array_split(rows, pieces) for patch in _split(readings, piece, parts // pieces)]
