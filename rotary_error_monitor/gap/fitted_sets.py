"""Sets of causes as they depart: each is fitted once, however often it is weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.alternatives import Key
from rotary_error_monitor.gap.departure_selection import with_departures
from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.problem import Problem

CauseSet = frozenset[Key]
"""Names and places of the causes of a set."""


def set_of(causes: Sequence[Cause]) -> CauseSet:
    """The set that causes are, whatever their values."""
    return frozenset(cause.key for cause in causes)


@dataclass
class FittedSets:
    """Sets of causes of one recording beside one noise: where more is learnt of that, all are fitted anew.

    Attributes:
        problem: recording beside twin.
        seen: sets that were weighed.
    """

    problem: Problem
    seen: set[CauseSet] = field(default_factory=set)
    _departing: dict[tuple[tuple[Key, ...], float, str], Fit | None] = field(default_factory=dict)

    def departing(self, fit: Fit, false_alarms: float = 1.0, without: str = "") -> Fit:
        """The causes of a fit with the departures that the recording asks for; the fit itself where it asks for none.

        Args:
            fit: causes in their textbook forms.
            false_alarms: as `with_departures`.
            without: a kind that may not be among them.

        Raises:
            UnpredictableError: the twin cannot predict them.
        """
        # In their order: all that is said of them is.
        key = tuple(cause.key for cause in fit.causes), false_alarms, without
        if key not in self._departing:
            found = with_departures(self.problem, fit, false_alarms, {without} if without else ())
            self._departing[key] = None if found is fit else found.without_data()
            return found
        known = self._departing[key]
        return fit if known is None else replace(known, data=self.problem.residual(known.causes))
