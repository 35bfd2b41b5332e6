"""Which kinds of departure a recording asks for: by their evidence, each paid for by how many there are."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.departures import Departing
from rotary_error_monitor.gap.fitting import Fit, KnownProducts, fit_causes, stacked_beside
from rotary_error_monitor.gap.held_out import dispersion
from rotary_error_monitor.gap.normal import Normal, solve_scaled, width_of
from rotary_error_monitor.gap.problem import Problem
from rotary_error_monitor.gap.proportion import log_odds_in_proportion

MOST_EXCHANGED = 3
"""Kinds of which one may give way to another: what needs more is hardly a cause that departs, and the time that it
takes to look at all goes with the square of their number."""

_NO_MORE = 1e-9
"""Growth of the evidence that is rounding."""


def with_departures(problem: Problem, fit: Fit, false_alarms: float = 1.0, without: Collection[str] = ()) -> Fit:
    """The causes of a fit fitted again with those kinds of departure that the recording asks for.

    Kinds join one by one, each time that with the most evidence, as long as that grows by more than the number of kinds
    there are: each is as likely beforehand as any other, and as none. Where nothing else says that something is left, a
    kind must be likelier by the false-alarm rate as well: so seldom the evidence of none grows by that. The fit
    tells as well how much likelier something proportional to a quantity would be in the place of each cause.

    Args:
        problem: recording beside twin.
        fit: causes in their textbook forms.
        false_alarms: largest chance of a kind where nothing is left.
        without: kinds that may not join.
    """
    known = problem.departures(fit.causes) if isinstance(problem, Departing) else ()
    kinds = [[i for i, kind in enumerate(d.kinds) if kind not in without] for d in known]
    offered = [d if len(own) == len(d.kinds) else d.chosen(own) for d, own in zip(known, kinds, strict=True) if own]
    if not offered:
        return fit
    stacked = stacked_beside(problem, fit, [d.columns for d in offered])
    labels, total = [(k, kind) for k, d in enumerate(offered) for kind in d.kinds], stacked.total()
    likeliest, _ = likeliest_kinds(*integrated_beside(fit, total), labels, -float(np.log(false_alarms)))
    chosen = set(labels) & likeliest
    kept = [d.chosen([i for i, kind in enumerate(d.kinds) if (k, kind) in chosen]) for k, d in enumerate(offered)]
    kept = [d for d in kept if d.kinds]
    if not kept:
        return fit
    first = len(stacked.moment[0]) - len(labels)
    own = np.r_[: len(fit.nuisance_values), first + np.flatnonzero([label in chosen for label in labels])]
    products = KnownProducts(fit.nuisance, stacked.gram[:, own[:, None], own])
    del stacked
    log_prior = -len(chosen) * float(np.log(len(set(labels))))
    departing = fit_causes(problem, fit.causes, departures=kept, known=products)
    nuisances, scatter = len(fit.nuisance_values), dispersion(departing)
    proportional = log_odds_in_proportion(total, nuisances, fit.causes, offered, chosen, scatter)
    return replace(departing, log_prior=log_prior, proportional=proportional)


def integrated_beside(fit: Fit, total: Normal) -> tuple[Array, Array]:
    """Products of the last columns with one another and with the data, all that is fitted integrated out."""
    widths = len(fit.nuisance_values), sum(map(width_of, fit.columns)), len(fit.departure_values)
    first = sum(widths)
    across = np.column_stack([total.gram[:first, first:], total.moment[:first]])
    taken = across.T @ solve_scaled(total.gram[:first, :first] + np.diag(np.repeat([1.0, 1e-12, 1.0], widths)), across)
    return total.gram[first:, first:] - taken[:-1, :-1], total.moment[first:] - taken[:-1, -1]


def likeliest_kinds(
    gram: Array, moment: Array, labels: Sequence[Hashable], least: float = 0.0
) -> tuple[set[Hashable], float]:
    """Kinds of columns that data ask for, and the logarithm of their marginal likelihood relative to none.

    Kinds join one by one, each time that with the most evidence, as long as that grows by more than the logarithm of
    the number of kinds there are, and `least`. Those that joined before leave where they are worth no more than that,
    and one gives way to another in its place with which the evidence is larger: what took most of the data when it
    joined may need others that cancel much of it.

    Args:
        gram: (q, q) products of columns with unit Gaussian priors.
        moment: (q,) of those with the data.
        labels: (q,) kind of each column.
        least: how much more evidence each must bring.
    """
    kinds = list(dict.fromkeys(labels))
    places = {kind: np.array([i for i, label in enumerate(labels) if label == kind]) for kind in kinds}
    price = float(np.log(len(kinds)))
    chosen: list[Hashable] = []
    best = 0.0

    def evidence(some: Sequence[Hashable]) -> float:
        return log_evidence(gram, moment, np.concatenate([places[kind] for kind in some]))

    while len(chosen) < len(kinds):
        trials = {kind: evidence([*chosen, kind]) for kind in kinds if kind not in chosen}
        kind = max(trials, key=lambda k: trials[k])
        if trials[kind] <= best + price + least:
            break
        best = trials[kind]
        chosen.append(kind)
        while len(chosen) > 1:
            without = {kind: evidence([k for k in chosen if k != kind]) for kind in chosen[:-1]}
            least_needed = max(without, key=lambda k: without[k])
            if without[least_needed] <= best - price:
                break
            best = without[least_needed]
            chosen.remove(least_needed)
        if len(chosen) <= MOST_EXCHANGED:
            chosen, best = _exchanged(chosen, kinds, evidence, best)
    return set(chosen), best - price * len(chosen)


def _exchanged(
    chosen: list[Hashable], kinds: Sequence[Hashable], evidence: Callable[[Sequence[Hashable]], float], best: float
) -> tuple[list[Hashable], float]:
    """Kinds of which one at a time gives way to another, as long as the evidence, `best` at first, grows by it."""
    while True:
        others = [kind for kind in kinds if kind not in chosen]
        trials = [[*chosen[:k], kind, *chosen[k + 1 :]] for k in range(len(chosen)) for kind in others]
        grown = {i: evidence(trial) for i, trial in enumerate(trials)}
        likeliest = max(grown, key=lambda i: grown[i], default=-1)
        if likeliest < 0 or grown[likeliest] <= best + _NO_MORE:
            return chosen, best
        chosen, best = trials[likeliest], grown[likeliest]


def log_evidence(gram: Array, moment: Array, index: NDArray[np.intp]) -> float:
    """Logarithm of the marginal likelihood of columns with unit Gaussian priors, relative to none of them."""
    inner = gram[np.ix_(index, index)] + np.eye(len(index))
    return float(0.5 * moment[index] @ np.linalg.solve(inner, moment[index]) - 0.5 * np.linalg.slogdet(inner)[1])
