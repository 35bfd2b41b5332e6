"""What a signal goes with, in words: how much of it functions of one quantity explain, and which are worth naming."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rotary_error_monitor.arrays import Array

MOST_NAMED = 4
"""Dependences that one sentence names: more nobody reads, and each explains a tenth of the signal or more."""

_NO_COLUMN = 1e-12
"""A column that varies by less is constant but for rounding: angles, directions and parts of a travel are of size 1."""


def explained_by(table: Array, values: Array) -> float:
    """Squares of values (n,) that columns (n, p) explain beside a constant."""
    centred = table - table.mean(axis=0)
    kept = centred[:, np.abs(centred).max(axis=0) > _NO_COLUMN]
    if kept.shape[1] == 0:
        return 0.0
    fitted, *_ = np.linalg.lstsq(kept, values, rcond=None)
    return float(np.sum(np.square(kept @ fitted)))


def explained_by_constant(values: Array) -> float:
    """Squares of values (n,) that their mean explains."""
    return float(np.mean(values)) ** 2 * len(values)


def name_dependences(parts: Iterable[tuple[float, str]], least: float) -> str:
    """Words for the dependences that explain more than `least` of a signal, the largest first.

    Args:
        parts: part of the signal's power that each explains alone, and its name.
        least: part from which a dependence is named.
    """
    named = sorted((part for part in parts if part[0] > least), reverse=True)[:MOST_NAMED]
    return "; ".join(f"{name} ({min(part, 1.0):.0%})" for part, name in named) or "no simple dependence"
