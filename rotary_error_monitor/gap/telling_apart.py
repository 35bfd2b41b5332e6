"""Which measurement tells effects apart: how far what one shows is from the nearest that the others can do."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rotary_error_monitor.arrays import Array

DECISIVE = 5.0
"""Distance, in standard deviations, from which a measurement is worth the work."""


def distance(wanted: Array, table: Array) -> float:
    """Standard deviations between what one effect shows (n,) and the nearest that columns (n, p) of another can do."""
    fitted, *_ = np.linalg.lstsq(table, wanted, rcond=None)
    return float(np.linalg.norm(wanted - table @ fitted))


def advise_best(scored: Iterable[tuple[float, str]], others: str) -> str:
    """Words for the measurement that tells effects apart best.

    Args:
        scored: distance that each measurement is expected to give, and its words.
        others: begins the sentence where none is decisive: what was tried in vain, the best of which is named.
    """
    best, words = max(scored)
    if best < DECISIVE:
        return f"{others} ({words}) would by {best:.1f} standard deviations"
    return f"{words}: expected to tell them apart by {best:.0f} standard deviations"
