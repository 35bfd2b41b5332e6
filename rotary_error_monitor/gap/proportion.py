"""Something unknown that does what a cause does, in proportion to a quantity: as a force squared is no compliance.

Over a recording in which the quantity hardly varies this is the cause with a departure that is fair: a force between
300 and 360 N squared is the force, larger by some per cent where it is larger. But of all such departures it is the one
with which nothing is left where the quantity is zero, and no textbook form is. A cause that departs has its size by
chance; what is proportional has no choice. The more exactly a recording tells the departure, the more it tells for what
had to be so (Jefferys and Berger, American Scientist 80, 1992).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.hypotheses import price_of
from rotary_error_monitor.gap.normal import Normal, solve_scaled

SAME = 1e-9
"""Part of the squares of a cause below which what is proportional to a quantity in its place is rounding."""

Label = tuple[int, str]
"""Position of departures among those that are offered, and a kind of departure."""


def amplitudes_of(cause: Cause) -> Array:
    """Values of a cause in the order of its columns, zero for shapes."""
    shapes = set(cause.effect.indices(Role.SHAPE))
    return np.array([0.0 if i in shapes else cause.values[i] for i in cause.effect.indices(Role.LINEAR, Role.SHAPE)])


def price_of_departures(gram: Array, nuisances: int, amplitudes: int) -> float:
    """What columns of departures, which stand last, cost by their priors: half of a logarithm of a determinant.

    Args:
        gram: (q, q) products of all columns with one another.
        nuisances: number of columns of uncertain parameters, which stand first.
        amplitudes: number of those of the causes, which come then.
    """
    first = nuisances + amplitudes
    inner = gram[:first, :first] + np.diag(np.repeat([1.0, 1e-12], [nuisances, amplitudes]))
    apart = gram[first:, first:] - gram[first:, :first] @ solve_scaled(inner, gram[:first, first:])
    return 0.5 * float(np.linalg.slogdet(np.eye(len(apart)) + apart)[1])


def log_odds_in_proportion(
    total: Normal,
    nuisances: int,
    causes: Sequence[Cause],
    offered: Sequence[Departures],
    chosen: Collection[Label],
    scatter: float = 1.0,
) -> tuple[float, ...]:
    """Logarithm of the marginal likelihood of what is proportional in the place of each cause, over that of the causes.

    Each quantity is as likely beforehand as any other; -inf where a cause is proportional to none. The kinds that
    describe the cause beside are as many as before, or none.

    Args:
        total: products of columns of uncertain parameters, causes and all departures that are offered, and with what
            the causes leave of the data.
        nuisances: number of uncertain parameters.
        causes: as fitted.
        offered: departures of the causes.
        chosen: kinds that are taken.
        scatter: how many times the squares of noise they leave (`dispersion`): what none describes is noise to the
            choice between the two.
    """
    table = _Table(total, nuisances, causes, offered, scatter)
    all_chosen = frozenset(chosen)
    as_it_is = {all_chosen: table.log_evidence(all_chosen)}
    instead = list[tuple[int, float]]()
    for k, departures in enumerate(offered):
        beside = frozenset(label for label in chosen if label[0] != k)
        for values in departures.proportional:
            kind = departures.kinds[int(np.flatnonzero(np.any(values != 0, axis=1))[0])]
            others = {beside, all_chosen - {(k, kind)}} if (k, kind) in chosen else {beside}
            # Kinds that were chosen for all they take of the data may be worth less than they cost where much is left:
            # what is proportional is no likelier for doing without them.
            as_it_is |= {some: table.log_evidence(some) for some in others - as_it_is.keys()}
            instead.append((departures.cause, max(table.log_evidence(some, (k, values)) for some in others)))
    price = float(np.log(max(len(instead), 1)))
    found = np.full(len(causes), -np.inf)
    for place, evidence in instead:
        found[place] = np.logaddexp(found[place], evidence - max(as_it_is.values()) - price)
    return tuple(map(float, found))


class _Table:
    """Normal equations with the causes put back into the data, and the marginal likelihood of choices of columns."""

    def __init__(
        self,
        total: Normal,
        nuisances: int,
        causes: Sequence[Cause],
        offered: Sequence[Departures],
        scatter: float,
    ) -> None:
        amplitudes = [amplitudes_of(cause) for cause in causes]
        widths = [len(values) for values in amplitudes]
        self._nuisances, self._first = nuisances, nuisances + sum(widths)
        own = np.split(np.arange(nuisances, self._first, dtype=np.intp), np.cumsum(widths)[:-1])
        self._linear = [places[is_linear(cause)] for places, cause in zip(own, causes, strict=True)]
        self._gram = total.gram
        fitted = slice(nuisances, self._first)
        self._moment = total.moment + total.gram[:, fitted] @ np.concatenate(amplitudes)
        self._offered, self._scatter = offered, scatter
        self._labels = [(k, kind) for k, departures in enumerate(offered) for kind in departures.kinds]
        self._starts = np.cumsum([self._first, *(len(departures.kinds) for departures in offered)])

    def log_evidence(self, chosen: Collection[Label], instead: tuple[int, Array] | None = None) -> float:
        """That of the causes with some kinds of departure, priors of places aside.

        Args:
            chosen: the kinds.
            instead: in the place of the cause of these departures what those values make of it.
        """
        gram, moment = self._gram, self._moment
        if instead is not None:
            gram, moment = self._in_proportion(*instead)
        taken = self._first + np.flatnonzero([label in chosen for label in self._labels])
        index = np.r_[: self._first, taken]
        gram, moment = gram[np.ix_(index, index)], moment[index]
        widths = self._nuisances, self._first - self._nuisances, len(taken)
        solved = solve_scaled(gram + np.diag(np.repeat([1.0, 1e-12, 1.0], widths)), moment)
        powers = np.array([solved[own] @ gram[np.ix_(own, own)] @ solved[own] for own in self._linear])
        counts = np.array([len(own) for own in self._linear])
        price = price_of_departures(gram, *widths[:2]) + float(np.sum(price_of(powers, counts)))
        return (
            0.5 * float(moment @ solved) / self._scatter - price - len(chosen) * float(np.log(len(set(self._labels))))
        )

    def _in_proportion(self, place: int, values: Array) -> tuple[Array, Array]:
        """Products in which each amplitude's column has been added what makes the cause proportional."""
        own = self._linear[self._offered[place].cause]
        apart = slice(self._starts[place], self._starts[place + 1])
        gram, moment = self._gram.copy(), self._moment.copy()
        added = self._gram[:, apart] @ values
        gram[:, own] += added
        gram[own] += added.T
        gram[np.ix_(own, own)] += values.T @ added[apart]
        moment[own] += values.T @ moment[apart]
        # Where the quantity is none wherever the cause acts, nothing is left but rounding.
        gone = own[np.diag(gram)[own] <= SAME * np.diag(self._gram)[own]]
        gram[gone], gram[:, gone], moment[gone] = 0.0, 0.0, 0.0
        return gram, moment


def is_linear(cause: Cause) -> NDArray[np.bool_]:
    """(k,) which of the columns of a cause are those of amplitudes, and not of shapes."""
    shapes = set(cause.effect.indices(Role.SHAPE))
    return np.array([i not in shapes for i in cause.effect.indices(Role.LINEAR, Role.SHAPE)])
