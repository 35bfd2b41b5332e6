"""The trend of the day: the largest value of each minute, over 24 hours, in memory that does not grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import NANOSECONDS

MINUTES = 24 * 60
_MINUTE_NS = 60 * NANOSECONDS


class DayTrend:
    """Largest values by minute; a clock that is set back by more than a minute begins the day anew."""

    def __init__(self, names: Sequence[str]) -> None:
        """Nothing yet, for values of these names."""
        self._place = {name: place for place, name in enumerate(names)}
        self._values = np.full((len(names), MINUTES), np.nan)
        self._minute: int | None = None

    def note(self, name: str, value: float, now_ns: int) -> None:
        """Take note of a value at a timestamp (ns); one that is not finite is left out."""
        if not np.isfinite(value):
            return
        self._advance(now_ns // _MINUTE_NS)
        cell = self._place[name], now_ns // _MINUTE_NS % MINUTES
        self._values[cell] = np.fmax(self._values[cell], value)

    def series(self, name: str, now_ns: int) -> NDArray[np.float64]:
        """(1440,) the minutes up to that of a timestamp (ns), the oldest first; NaN where there was nothing."""
        self._advance(now_ns // _MINUTE_NS)
        return np.roll(self._values[self._place[name]], -(now_ns // _MINUTE_NS % MINUTES) - 1)

    def _advance(self, minute: int) -> None:
        last = self._minute
        if last is None or minute < last - 1 or minute - last >= MINUTES:
            self._values[:] = np.nan
        elif minute > last:
            self._values[:, np.arange(last + 1, minute + 1) % MINUTES] = np.nan
        self._minute = minute if last is None or minute < last - 1 else max(minute, last)
