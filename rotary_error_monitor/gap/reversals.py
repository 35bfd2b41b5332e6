"""Something unknown that slipped at one moment, for good, in the place of what jumps where a rotor turns back.

A play is taken up again at the next reversal, and what slipped stays. In a recording of one reversal they differ by
little or nothing, and noise as slow as the jitter of a rotor hides when it was: a slip is weighed against the play.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.hypotheses import price_of
from rotary_error_monitor.gap.normal import Normal, solve_scaled
from rotary_error_monitor.gap.problem import Columns
from rotary_error_monitor.gap.proportion import amplitudes_of, is_linear, price_of_departures


@runtime_checkable
class Reversing(Protocol):
    """A problem with causes that may act by the direction of travel."""

    def slipped(self, place: int, causes: Sequence[Cause]) -> tuple[Array, Columns]:
        """What slips where the cause at one place among the causes acts.

        Returns:
            (m,) logarithm of the probability of each moment at which it may, and white rows of all amplitudes of a slip
            at each, one moment after the other. None where the cause does not jump at reversals, or there are none.
        """


def log_odds_of_slips(
    total: Normal, nuisances: int, causes: Sequence[Cause], departing: Sequence[int], place: int, log_priors: Array
) -> float:
    """Logarithm of the marginal likelihood of a slip in the place of a cause with its departures, over that of these.

    The moment is summed over; what the choice of kinds of departure costs is not counted.

    Args:
        total: products of columns of uncertain parameters, causes, departures and the slips, one after the other, and
            with what the causes leave of the data.
        nuisances: number of uncertain parameters.
        causes: as fitted.
        departing: (q,) position of the cause to which each column of departures belongs.
        place: position of the cause.
        log_priors: (m,) of the slips.
    """
    amplitudes = [amplitudes_of(cause) for cause in causes]
    edges = nuisances + np.cumsum([0, *(len(values) for values in amplitudes)])
    own = [np.arange(a, b) for a, b in itertools.pairwise(edges.tolist())]
    linear = [is_linear(cause) for cause in causes]
    fitted = slice(nuisances, edges[-1])
    table = Normal(
        total.gram, total.moment + total.gram[:, fitted] @ np.concatenate(amplitudes), total.power, total.count
    )
    columns = edges[-1] + np.arange(len(departing))
    found = [_log_evidence(table, nuisances, own, linear, columns)]
    kept = columns[np.asarray(departing, np.intp) != place]
    for slip in np.split(np.arange(edges[-1] + len(departing), len(total.moment)), len(log_priors)):
        others = [slip if k == place else each for k, each in enumerate(own)]
        counted = [np.ones(len(slip), bool) if k == place else each for k, each in enumerate(linear)]
        found.append(_log_evidence(table, nuisances, others, counted, kept))
    return float(logsumexp(found[1:] + log_priors) - found[0])


def _log_evidence(
    table: Normal,
    nuisances: int,
    members: Sequence[NDArray[np.intp]],
    linear: Sequence[NDArray[np.bool_]],
    departing: NDArray[np.intp],
) -> float:
    """That of columns of causes, some of each amplitudes, beside uncertain parameters and departures."""
    widths = nuisances, sum(map(len, members)), len(departing)
    index = np.concatenate([np.arange(nuisances), *members, departing])
    gram, moment = table.gram[np.ix_(index, index)], table.moment[index]
    solved = solve_scaled(gram + np.diag(np.repeat([1.0, 1e-12, 1.0], widths)), moment)
    places = np.split(nuisances + np.arange(widths[1]), np.cumsum([len(own) for own in members])[:-1])
    counted = [own[used] for own, used in zip(places, linear, strict=True)]
    powers = np.array([solved[own] @ gram[np.ix_(own, own)] @ solved[own] for own in counted])
    price = price_of_departures(gram, *widths[:2]) + float(np.sum(price_of(powers, np.array([*map(len, counted)]))))
    return 0.5 * float(moment @ solved) - price
