"""What a twin predicts beside sets of causes, kept between the steps of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.effects.effect import Cause, Role, values_of
from rotary_error_monitor.twin.stage import Signals, StageTwin

KEPT = 6
"""Predictions and signatures of causes with sizes that are kept: a set is fitted, weighed, and fitted again."""


class KeptPredictions:
    """The predictions that were asked for last.

    Args:
        twin: that predicts.
        most: of them that are kept.
    """

    def __init__(self, twin: StageTwin, most: int = KEPT) -> None:
        self._twin, self._most = twin, most
        self._found: dict[tuple[tuple[str, str, bytes], ...], Signals] = {}

    def beside(self, causes: Sequence[Cause]) -> Signals:
        """Predicted signals (n, k) of all streams with these causes, not to be changed.

        Raises:
            UnpredictableError: a value is not finite.
        """
        key = values_of(causes)
        if key not in self._found:
            made = self._twin.predict(causes)
            while len(self._found) >= self._most:
                self._found.pop(next(iter(self._found)))
            self._found[key] = made
        return self._found[key]

    def beside_sized(self, causes: Sequence[Cause]) -> Signals:
        """The same without the causes that have no size, which do nothing."""
        return self.beside([cause for cause in causes if np.any(cause.values[cause.effect.indices(Role.LINEAR)])])

    def forget(self) -> None:
        """Give back the memory."""
        self._found.clear()
