"""Departures of a cause with the values that a recording gives them: how large they are, and what they are in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.departures import SHARE, Departures, Words

CANCELLED = 2.0
"""Times that kinds of departure are larger than what they do together from which they cancel one another."""


@dataclass(frozen=True)
class FittedDepartures:
    """Departures of a cause with their values.

    Attributes:
        departures: what may depart.
        values: (q,) standard deviations of the prior.
        products: (q, q) of what the cause's best textbook form leaves of white columns with one another, over the
            square of that form.
        grown: size of the cause beside its departures over that which their columns are for.
        beside: the same over that of its best textbook form, which is less where much is there as a whole.
    """

    departures: Departures
    values: Array
    products: Array
    grown: float = 1.0
    beside: float = 1.0

    def share(self, chosen: NDArray[np.bool_] | None = None) -> float:
        """Part of the cause, root mean square, that its best textbook form leaves and (chosen) columns describe."""
        return self._share(self.values if chosen is None else np.where(chosen, self.values, 0.0))

    def shares(self) -> dict[str, float]:
        """The share of each kind alone."""
        return {kind: self.share(own) for kind, own in self._kinds()}

    def size(self) -> float:
        """The share of all together, or where kinds cancel one another, as they are: what cancels is no smaller.

        A kind that may be there as a whole counts by its prior, as `SHARE` of the cause where it is one standard
        deviation: a play that stays at rest may show longer there than in motion, and is no larger for that.
        """
        fair = self.values.copy()
        for kind, own in self._kinds():
            if kind in self.departures.whole:
                widest = float(np.sqrt(np.max(np.diag(self.products)[own], initial=0.0)))
                fair[own] *= SHARE / max(SHARE, widest * self.grown)
        return max(self._share(fair), math.hypot(*(self._share(np.where(own, fair, 0.0)) for _, own in self._kinds())))

    def cancelling(self) -> list[str]:
        """The two largest kinds, where all are far larger than what they do together; else none."""
        shares = self.shares()
        if self.size() <= CANCELLED * max(self.share(), SHARE):
            return []
        return sorted(shares, key=lambda kind: -shares[kind])[:2]

    def _kinds(self) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        """Each kind, and (q,) which columns are of it."""
        kinds = np.array(self.departures.kinds)
        for kind in dict.fromkeys(self.departures.kinds):
            yield kind, kinds == kind

    def _share(self, values: Array) -> float:
        return float(np.sqrt(max(float(values @ self.products @ values), 0.0)))

    def effects(self) -> tuple[Cause, ...]:
        """Those that are known effects, such as neighbouring orders, with their sizes: a twin can hold them."""
        found: dict[tuple[str, str], Cause] = {}
        for cause, value in zip(self.departures.effects, self.values, strict=False):
            if cause is not None:
                linear = cause.effect.indices(Role.LINEAR)
                values = cause.values.copy()
                values[linear] *= value
                if cause.key in found:
                    values[linear] += found[cause.key].values[linear]
                found[cause.key] = cause.with_values(values)
        return tuple(found.values())


@dataclass(frozen=True)
class FittedDeparture:
    """A departure as it is told.

    Attributes:
        pattern: in words.
        share: of the cause's own gap (root mean square).
        held: whether it is known effects, which a twin can hold.
    """

    pattern: str
    share: float
    held: bool = False


def describe(fitted: FittedDepartures) -> tuple[FittedDeparture, ...]:
    """Departures of one cause in words, the largest first."""
    told, departures, values = [], fitted.departures, fitted.values
    for kind, share in fitted.shares().items():
        own = np.array([other == kind for other in departures.kinds])
        change: dict[Words, float] = {}
        size: dict[Words, float] = {}
        for i in np.flatnonzero(own):
            words = departures.words[i]
            size[words] = size.get(words, 0.0) + float(values[i]) ** 2 * float(fitted.products[i, i])
            change[words] = change.get(words, 0.0) + float(values[i] * departures.changes[i])
        largest = max(size, key=lambda words: size[words])
        held = bool(departures.effects) and all(departures.effects[i] is not None for i in np.flatnonzero(own))
        if kind in departures.whole:
            share /= max(1.0, fitted.beside)
        told.append(FittedDeparture(largest(change[largest]), share, held))
    return tuple(sorted(told, key=lambda row: -row.share))
