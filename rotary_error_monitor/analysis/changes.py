"""What changed between two recordings of a stage, and whether it is more than the uncertainty of both."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rotary_error_monitor.analysis.result import Figure


@dataclass(frozen=True)
class Change:
    """One figure that both recordings tell.

    Attributes:
        name: of the figure.
        segment: direction and speed, the same in both; empty for the whole recording.
        before, after: values in the other recording and in this one, in `unit`.
        expanded_uncertainty: of their difference, k = 2: both are taken to be independent.
        unit: SI.
    """

    name: str
    segment: str
    before: float
    after: float
    expanded_uncertainty: float
    unit: str

    @property
    def is_told(self) -> bool:
        """Whether it is more than the uncertainty."""
        return self.ratio > 1.0

    @property
    def ratio(self) -> float:
        """Size of the change over its expanded uncertainty."""
        size = abs(self.after - self.before)
        return size / self.expanded_uncertainty if self.expanded_uncertainty > 0 else math.inf if size else 0.0


def changes_between(before: Sequence[Figure], after: Sequence[Figure]) -> Iterator[Change]:
    """Changes of all figures with an uncertainty that both have, in the order of `after`."""
    known = {(figure.name, figure.segment): figure for figure in before}
    for figure in after:
        old = known.get((figure.name, figure.segment))
        if old is None or old.expanded_uncertainty is None or figure.expanded_uncertainty is None:
            continue
        both = math.hypot(old.expanded_uncertainty, figure.expanded_uncertainty)
        yield Change(figure.name, figure.segment, old.value, figure.value, both, figure.unit)
