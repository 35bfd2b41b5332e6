"""Least squares within bounds, from normal equations: no estimate leaves what is physically sensible."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array

SWEEPS = 200
"""Sweeps of coordinate descent: columns that correlate by 0.99 are then within 2 % of their optimum, others exact."""


def solve_within(gram: Array, moment: Array, low: Array, high: Array, start: Array) -> Array:
    """(p,) amplitudes that minimise `a' gram a / 2 - moment' a` between bounds that hold 0.

    The amplitudes at a bound are sought as an active set: those that a solution of the others drives beyond a bound are
    held there, those that a bound holds against their gradient are let go (Lawson and Hanson, Solving Least Squares
    Problems, chapter 23).

    Args:
        gram: (p, p) positive semidefinite.
        moment: (p,).
        low: (p,) at most 0.
        high: (p,) at least 0.
        start: (p,) solution without bounds; returned as it is where it lies within them.
    """
    if np.all((start >= low) & (start <= high)):
        return start
    held = np.zeros(len(start), bool)
    found = np.clip(start, low, high)
    for _ in range(4 * len(start)):
        free = ~held
        trial = found.copy()
        if free.any():
            trial[free] = _solve(gram[np.ix_(free, free)], moment[free] - gram[np.ix_(free, held)] @ found[held])
        beyond = free & ((trial < low) | (trial > high))
        if beyond.any():
            held |= beyond
            found = np.clip(trial, low, high)
            continue
        found = np.clip(trial, low, high)
        pull = moment - gram @ found
        wrongly = held & (((found >= high) & (pull < 0)) | ((found <= low) & (pull > 0)))
        if not wrongly.any():
            break
        # One at a time: several let go together may come back together.
        gain = np.where(wrongly, np.square(pull) / np.maximum(np.diag(gram), np.finfo(np.float64).tiny), 0.0)
        held[int(np.argmax(gain))] = False
    return found


def _solve(gram: Array, moment: Array) -> Array:
    """Amplitudes without bounds, of columns of any length; those that nothing shows stay 0."""
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inner = gram * np.outer(scale, scale) + 1e-12 * np.eye(len(gram))
    return np.asarray(scale * np.linalg.solve(inner, scale * moment), np.float64)


def descend_within(gram: Array, moment: Array, low: Array, high: Array, start: Array) -> Array:
    """(k, w) the same for k sets of w amplitudes at once, near enough for a first look.

    Coordinate descent: each amplitude in turn takes its best value between its bounds, so none ever leaves them and
    every sweep explains more. A column without any length keeps 0.

    Args:
        gram: (k, w, w).
        moment: (k, w).
        low: (k, w).
        high: (k, w).
        start: (k, w).
    """
    found = np.clip(start, low, high)
    length = np.einsum("kii->ki", gram)
    seen = length > 0
    for _ in range(SWEEPS):
        before = found.copy()
        for i in range(found.shape[1]):
            pull = moment[:, i] - np.einsum("kj,kj->k", gram[:, i], found) + length[:, i] * found[:, i]
            best = np.clip(pull / np.where(seen[:, i], length[:, i], 1.0), low[:, i], high[:, i])
            found[:, i] = np.where(seen[:, i], best, 0.0)
        if np.max(np.abs(found - before) * np.sqrt(length), initial=0.0) < 1e-3:
            break  # less than a thousandth of a standard deviation
    return found
