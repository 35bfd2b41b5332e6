"""Whether what heads contradict one another by is more than chance allows, in one window and over many."""

from __future__ import annotations

from collections.abc import Sequence

from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.pipeline.evidence import LONG, SHORT
from rotary_error_monitor.pipeline.trailing import Trailing


class LastingContradiction:
    """Contradictions of the latest windows, as chi-square over its degrees of freedom."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._found = Trailing(LONG)
        # of `excesses`, and for what degrees of freedom
        self._bounds_of, self._bounds = (0.0, (0, 0, 0)), [0.0]

    def clear(self) -> None:
        """Forget all windows."""
        self._found.clear()

    def add(self, contradictions: Sequence[float]) -> Sequence[int]:
        """Take in windows one after another; give the place behind each, as `excesses` takes it."""
        return self._found.add(contradictions)

    def excesses(self, freedom: float, end: int) -> tuple[float, float, float]:
        """Means over what chance allows, for the last window up to a place and the longer spans, where it is more."""
        found = self._found
        counts = 1, found.count(end, SHORT), found.count(end, LONG)
        if (freedom, counts) != self._bounds_of:
            self._bounds_of, self._bounds = (freedom, counts), [chi_square_bound(freedom * each) for each in counts]
        of_last, of_some, of_all = self._bounds
        return found.last(end) / of_last, found.excess(end, SHORT, of_some), found.excess(end, LONG, of_all)
