"""What else could have caused it: probabilities, ranking, and groups that a recording cannot tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.special import logsumexp

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.hypotheses import Hypothesis, HypothesisTable
from rotary_error_monitor.gap.p_values import chi_square_quantile
from rotary_error_monitor.gap.shrink import HeldOut
from rotary_error_monitor.gap.steps import Step

Key = tuple[str, str]

REJECTED = 0.01
"""Level of the likelihood-ratio test by which the recording rejects an alternative to a cause."""

RANKED = 20
"""Candidates whose held-out gap is reported."""


@dataclass(frozen=True)
class Alternatives:
    """Ranking rows (name, location, probability, held-out gap), best first, and groups of keys."""

    ranking: tuple[tuple[str, str, float, float], ...]
    groups: tuple[tuple[Key, ...], ...]

    def probability(self, key: Key) -> float:
        """Probability of a candidate; 0 if it is not ranked."""
        return next((row[2] for row in self.ranking if (row[0], row[1]) == key), 0.0)


def rank_alternatives(
    step: Step,
    causes: Sequence[Cause],
    unknown: float,
    dispersion: float = 1.0,
    credits: Mapping[frozenset[Key], float] | None = None,
    needless: Mapping[Key, float] = MappingProxyType({}),
) -> Alternatives:
    """Every candidate in the place of every cause.

    The probability of a candidate is that of all sets that hold it, among the chosen set and those with one member
    replaced, less the chance that something unknown is at work. Without a cause the candidates stand alone, beside the
    possibility of none. `dispersion` is how many times the squares that remain are those of noise: what all candidates
    leave alike is noise to the choice among them. `credits` are the log odds of other sets that were weighed with their
    departures, or fitted, beside the chosen one; `needless` those that a cause is a departure of the others.
    """
    table = step.table
    members = tuple(i for i in (table.position(c.key) for c in causes) if i is not None)
    chosen = table.evaluate(members)
    rows = [chosen]
    for k in range(len(members)):
        rows += table.replacements(members, k, table.free(members))
    if not members:
        rows += table.singles()
    evidence = np.array([row.log_evidence for row in rows])
    logs = (evidence - chosen.log_evidence) / dispersion
    if credits is not None:
        logs = _all_credited(logs, [_keys(table, row) for row in rows], credits)
    for k, member in enumerate(members):
        if table.candidates[member].key in needless:
            rows.append(table.evaluate((*members[:k], *members[k + 1 :])))
            logs = np.append(logs, needless[table.candidates[member].key])
    weights = np.exp(logs - logsumexp(logs)) * (1 - unknown)
    share = np.zeros(len(table.candidates))
    for row, weight in zip(rows, weights, strict=True):
        share[list(row.members)] += weight
    best = np.full(len(table.candidates), -np.inf)
    for row in rows:
        for member in row.members:
            best[member] = max(best[member], row.log_evidence)
    order = _distinct(table, sorted(range(len(best)), key=lambda i: (-share[i], -best[i])))
    held_out = HeldOut(table.blocks, table.conditions)
    ranking = tuple(
        (*table.candidates[i].key, float(share[i]), _rms(held_out, table, _with(members, i, rows)))
        for i in order[:RANKED]
    )
    return Alternatives(ranking, _groups(table, members, chosen, dispersion, credits or {}))


def _keys(table: HypothesisTable, row: Hypothesis) -> frozenset[Key]:
    return frozenset(table.candidates[i].key for i in row.members)


def _all_credited(log_odds: Array, keys: Sequence[frozenset[Key]], credits: Mapping[frozenset[Key], float]) -> Array:
    """(n,) log odds of sets beside the first, which was chosen, from those on the table (n,).

    There all are in their textbook forms, beside noise as it was then. What weighed sets turned out less likely by, the
    best of them, those that were not weighed are taken to be as well.
    """
    own = keys[0]
    turned_out = [credits[k] - log for log, k in zip(log_odds, keys, strict=True) if k != own and k in credits]
    less = min(0.0, max(turned_out, default=0.0))
    return np.array(
        [_credited(log if k == own else log + less, k, own, credits) for log, k in zip(log_odds, keys, strict=True)]
    )


def _credited(
    log_odds: float, keys: frozenset[Key], chosen: frozenset[Key], credits: Mapping[frozenset[Key], float]
) -> float:
    """Log odds of a set in its textbook form beside the one that was chosen, with its departures or fitted.

    None is likelier than that, nor than a set with the same effect, at its best place, that was weighed like it.
    """
    if keys == chosen:
        return log_odds
    if keys in credits:
        return credits[keys]
    added = {name for name, _ in keys - chosen}
    return min(
        log_odds, 0.0, *(odds for other, odds in credits.items() if {name for name, _ in other - chosen} & added)
    )


def _distinct(table: HypothesisTable, order: list[int]) -> list[int]:
    """The first of each name and location."""
    first = {table.candidates[i].key: i for i in reversed(order)}
    return [i for i in order if first[table.candidates[i].key] == i]


def _with(causes: tuple[int, ...], candidate: int, rows: list[Hypothesis]) -> tuple[int, ...]:
    """The best set that holds a candidate."""
    holding = [row for row in rows if candidate in row.members]
    return max(holding, key=lambda row: row.log_evidence).members if holding else (*causes, candidate)


def _rms(held_out: HeldOut, table: HypothesisTable, members: tuple[int, ...]) -> float:
    columns = np.concatenate([np.arange(table.nuisances), table.nuisances + table.columns_of(members)])
    widths = [100 * table.candidates[i].effect.scales()[table.candidates[i].linear] for i in members]
    prior = np.concatenate([np.ones(table.nuisances), *(1 / np.square(width) for width in widths)])
    return held_out.rms(columns.astype(np.intp), prior, table.bounds_of(members))


def _groups(
    table: HypothesisTable,
    causes: tuple[int, ...],
    chosen: Hypothesis,
    dispersion: float,
    credits: Mapping[frozenset[Key], float],
) -> tuple[tuple[Key, ...], ...]:
    """For each cause the candidates that could stand in its place without the recording objecting.

    The likelihood-ratio test compares the fits; a candidate with more degrees of freedom always fits as well where
    it includes the cause, and is named as well: only another measurement can exclude it.
    """
    found = []
    for k, cause in enumerate(causes):
        group = [table.candidates[cause].key]
        without = table.evaluate((*causes[:k], *causes[k + 1 :])).reduction
        for other in table.replacements(causes, k, table.free(causes)):
            i = other.members[k]
            dof = max(abs(chosen.dof - other.dof), 1)
            key = table.candidates[i].key
            fits = chosen.reduction - other.reduction < dispersion * chi_square_quantile(REJECTED, dof)
            if (keys := _keys(table, other)) in credits:
                fits = credits[keys] > np.log(REJECTED)
            if fits and other.reduction > without and key not in group:
                group.append(key)
        if len(group) > 1:
            found.append(tuple(group))
    return tuple(found)
