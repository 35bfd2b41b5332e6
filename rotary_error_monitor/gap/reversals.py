"""Something unknown that slipped at one moment, for good, in the place of what jumps where a rotor turns back.

A play is taken up again at the next reversal, and what slipped stays. In a recording of one reversal they differ by
little or nothing, and noise as slow as the jitter of a rotor hides when it was: a slip is weighed against the play.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import Fit, stacked_beside
from rotary_error_monitor.gap.hypotheses import price_of
from rotary_error_monitor.gap.normal import Normal, solve_scaled
from rotary_error_monitor.gap.problem import Columns, Problem
from rotary_error_monitor.gap.proportion import amplitudes_of, is_linear, price_of_departures

MOMENTS = 40
"""Parts of the recording between which a slip is looked for at first."""

PARTS = 8
"""Into which the parts beside the likeliest moment are cut, until the mean over all moments no longer changes."""

SETTLED = float(np.log(1.1))
"""Change of log odds that decides nothing."""


@runtime_checkable
class Reversing(Problem, Protocol):
    """A problem with causes that may act by the direction of travel."""

    def turning(self, cause: Cause) -> tuple[Array, float]:
        """Times (r,) at which the rotor turns back and length of recording, s; none where a cause does not jump."""

    def slipped(self, place: int, causes: Sequence[Cause], moments: Array) -> Columns:
        """White rows of all amplitudes of a slip where the cause at one place acts, one moment (m,) after the other."""


def odds_of_slips(problem: Problem, fit: Fit) -> tuple[float, ...]:
    """Logarithm of the marginal likelihood of what slipped once, for good, in the place of each cause, over that of the
    causes; -inf where a cause does not jump at reversals.
    """
    found = [-np.inf] * len(fit.causes)
    if not isinstance(problem, Reversing):
        return tuple(found)
    kinds = {(own.cause, kind) for own in fit.departures for kind in own.kinds}
    left = replace(fit, data=problem.residual(fit.causes))
    for place, cause in enumerate(fit.causes):
        turning, duration = problem.turning(cause)
        if not len(turning):
            continue
        found[place] = log_odds_over_moments(turning, duration, partial(_slips_at, problem, left, place))
        # A slip does without the departures of the cause, and what their choice costs.
        found[place] -= fit.log_prior * sum(owner == place for owner, _ in kinds) / max(len(kinds), 1)
    return tuple(found)


def _slips_at(problem: Reversing, fit: Fit, place: int, moments: Array) -> Array:
    """(m,) as `log_odds_of_slips`, of those at moments (m,), of a fit whose data are what its causes leave."""
    slips = problem.slipped(place, fit.causes, moments)
    total = stacked_beside(problem, fit, [slips]).total()
    departing = [own.cause for own in fit.departures for _ in own.kinds]
    return log_odds_of_slips(total, len(fit.nuisance_values), fit.causes, departing, place, len(moments))


def log_odds_over_moments(turning: Array, duration: float, log_odds_at: Callable[[Array], Array]) -> float:
    """Logarithm of the mean marginal likelihood of what slipped at one moment, over that of something else.

    A drive turns its force over at reversals: a slip at one of them is as likely as at all other moments together,
    which are alike. How near the likelihood of a moment has to be known depends on how loud the slip is, and what noise
    hides: the parts beside the likeliest moment are made finer until the mean over the recording no longer changes.

    Args:
        turning: (r,) times of reversals, s.
        duration: of the recording, s.
        log_odds_at: gives those (m,) of slips at moments (m,).
    """
    moments = np.union1d(turning, duration * np.arange(1, MOMENTS) / MOMENTS)
    found, last = log_odds_at(moments), np.inf
    while True:
        edges = np.concatenate([[0.0], moments, [duration]])
        mean = float(logsumexp(found, b=(edges[2:] - edges[:-2]) / (2 * duration)))  # by the trapezoidal rule
        if not abs(mean - last) > SETTLED:
            break
        best = int(np.argmax(found)) + 1
        finer = np.unique(np.linspace(edges[best - 1 : best + 1], edges[best : best + 2], PARTS + 1)[1:-1])
        moments, found, last = np.append(moments, finer), np.append(found, log_odds_at(finer)), mean
        order = np.argsort(moments)
        moments, found = moments[order], found[order]
    at_reversals = float(logsumexp(found[np.isin(moments, turning)])) - np.log(len(turning))
    return float(np.logaddexp(at_reversals, mean) - np.log(2))


def log_odds_of_slips(
    total: Normal, nuisances: int, causes: Sequence[Cause], departing: Sequence[int], place: int, moments: int
) -> Array:
    """(m,) logarithm of the marginal likelihood of each slip in the place of a cause with its departures, over theirs.

    What the choice of kinds of departure costs is not counted.

    Args:
        total: products of columns of uncertain parameters, causes, departures and the slips, one after the other, and
            with what the causes leave of the data.
        nuisances: number of uncertain parameters.
        causes: as fitted.
        departing: (q,) position of the cause to which each column of departures belongs.
        place: position of the cause.
        moments: number of slips.
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
    known = _log_evidence(table, nuisances, own, linear, columns)
    kept = columns[np.asarray(departing, np.intp) != place]
    found = []
    for slip in np.split(np.arange(edges[-1] + len(departing), len(total.moment)), moments):
        others = [slip if k == place else each for k, each in enumerate(own)]
        counted = [np.ones(len(slip), bool) if k == place else each for k, each in enumerate(linear)]
        found.append(_log_evidence(table, nuisances, others, counted, kept) - known)
    return np.array(found)


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
