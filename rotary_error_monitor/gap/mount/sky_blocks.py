"""Pointings cut into patches of the sky of equal numbers, so that whole patches can be left out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.gap.problem import Array, Conditions

FOLDS = 6
BLOCKS = 24
"""Patches; every sixth of them is left out together, so that the others lie around it."""


def sky_patches(readings: Array) -> list[NDArray[np.intp]]:
    """Rows of each patch, from readings (n, 2): halves, and halves of these, across the wider axis; at last thirds."""
    return _split(readings, np.arange(len(readings), dtype=np.intp), BLOCKS)


def sky_conditions(patches: list[NDArray[np.intp]]) -> Conditions:
    """Blocks of pointings that are arranged patch after patch."""
    edges = np.concatenate([[0], np.cumsum([len(patch) for patch in patches])]) - 0.5
    labels = (np.arange(len(patches)) % FOLDS).astype(np.intp)
    return Conditions(edges, labels, tuple(f"patches {i + 1}/{FOLDS}" for i in range(FOLDS)))


def _split(readings: Array, rows: NDArray[np.intp], parts: int) -> list[NDArray[np.intp]]:
    if parts == 1:
        return [rows]
    wider = int(np.argmax(np.ptp(readings[rows], axis=0)))
    rows = rows[np.argsort(readings[rows, wider], kind="stable")]
    pieces = 2 if parts % 2 == 0 else parts
    return [patch for piece in np.array_split(rows, pieces) for patch in _split(readings, piece, parts // pieces)]
