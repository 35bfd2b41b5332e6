"""How often something goes out for people beside what goes out for programs."""

from __future__ import annotations


class Pace:
    """One message in each period of the stamps, whichever way the clock was set between two of them."""

    def __init__(self, period_ns: int) -> None:
        """One each `period_ns`, on a grid that is fixed in absolute time."""
        self._period_ns = period_ns
        self._last: int | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Whether what is of this timestamp (ns) goes out: true once in each period."""
        period = stamp_ns // self._period_ns
        if period == self._last:
            return False
        self._last = period
        return True
