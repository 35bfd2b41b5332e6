"""Sets of causes that were tried, and those that may look the same, weighed with their departures and without."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.alternatives import REJECTED, Key
from rotary_error_monitor.gap.departures import LARGEST_POWER
from rotary_error_monitor.gap.fitted_sets import FittedSets, set_of
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.held_out import dispersion
from rotary_error_monitor.gap.hypotheses import Hypothesis
from rotary_error_monitor.gap.p_values import chi_square_quantile, log_f_tail
from rotary_error_monitor.gap.posterior import (
    Posterior,
    beside_proportional,
    departures_of,
    marginal_likelihood,
    may_depart,
    powers_of,
    reductions_beside,
    weigh_against_unknown,
)
from rotary_error_monitor.gap.prior_conflict import find_left
from rotary_error_monitor.gap.problem import Problem, StructureTest
from rotary_error_monitor.gap.shrink import measure_gap
from rotary_error_monitor.gap.steps import Step
from rotary_error_monitor.gap.verdict import doubt_about
from rotary_error_monitor.twin.finite import UnpredictableError

MOST_RIVALS = 2
"""Causes in the place of one that looks the same, whose departures are looked at as well: each costs a fit."""


def weigh_step(sets: FittedSets, step: Step) -> Iterator[Posterior]:
    """The causes of a step and those that may look the same, with departures and without, and what is left of them."""
    found = list(weigh_causes(sets, step, step.fit.causes))
    yield from found
    for causes in rivals_of(step) if any(posterior.near for posterior in found) else ():
        yield from weigh_causes(sets, step, causes)


def weigh_causes(
    sets: FittedSets, step: Step, causes: tuple[Cause, ...], false_alarms: float = 1.0
) -> Iterator[Posterior]:
    """Causes weighed; without those that something unknown is likelier than, weighed again; none a second time."""
    while causes and (keys := set_of(causes)) not in sets.seen:
        sets.seen.add(keys)
        try:
            posterior = _posterior(sets, step, causes, false_alarms)
        except UnpredictableError:
            return
        if doubt_about(sets.problem, posterior.fit):
            return
        yield posterior
        fewer = tuple(c for c, odds in zip(posterior.fit.causes, posterior.log_odds, strict=True) if odds > 0)
        if len(fewer) == len(causes):
            return
        causes = fewer


def _posterior(sets: FittedSets, step: Step, causes: tuple[Cause, ...], false_alarms: float) -> Posterior:
    """Causes with departures or without: where nothing is left of either form the likelier, else that with better odds.

    Sets that leave nothing are compared by evidence, for which each has to stand in its likeliest form.
    """
    problem = sets.problem
    fit = fit_causes(problem, causes)
    best = weigh_fit(problem, step, fit)
    if best.near or best.settled:
        departing = sets.departing(fit, false_alarms)
        best = beside_proportional(best, departing)
        if departing is not fit and _predicts(
            problem, weighed := _weigh_departing(sets, step, fit, departing, false_alarms), fit
        ):
            best = _better_form(best, weighed)
    needless, instead = departures_instead(sets, step, best.fit)
    return instead[0] if instead else replace(best, fit=best.fit.without_data(), needless=needless)


def _better_form(textbook: Posterior, departing: Posterior) -> Posterior:
    """Of two forms of a set that leave nothing the likelier, else that with better odds."""
    both = textbook.settled and departing.settled
    return max(textbook, departing, key=lambda form: marginal_likelihood(form.fit) if both else form.total)


def _weigh_departing(sets: FittedSets, step: Step, fit: Fit, departing: Fit, false_alarms: float) -> Posterior:
    """Causes as they depart; with other kinds where those of the most evidence are too large, for they cancel.

    A course of which there is no column may be the difference of two that are far larger. Where others leave nothing
    either, what departs is no larger than with those.
    """
    forms = [weigh_fit(sets.problem, step, departing)]
    if forms[0].settled and not forms[0].likelier:
        for kind in dict.fromkeys(kind for each in departures_of(departing) for kind in each.cancelling()):
            other = sets.departing(fit, false_alarms, kind)
            if other is not fit and (found := weigh_fit(sets.problem, step, other)).settled:
                forms.append(found)
    return max(forms, key=lambda form: form.total)


def departures_instead(
    sets: FittedSets, step: Step, fit: Fit, false_alarms: float = 1.0
) -> tuple[dict[Key, float], list[Posterior]]:
    """Log odds that a cause is a departure of the others, and the others where that is likelier, the best first.

    That is looked at where a cause is no larger beside the others than a departure can be (`LARGEST_POWER`).
    """
    problem = sets.problem
    powers = [sum(power.values()) for power in powers_of(problem, fit)]
    odds: dict[Key, float] = {}
    likelier: list[tuple[float, Posterior]] = []
    for k, cause in enumerate(fit.causes):
        member = step.table.position(cause.key)
        if powers[k] > LARGEST_POWER * max(powers) or member is None:
            continue
        others = fit_causes(problem, (*fit.causes[:k], *fit.causes[k + 1 :]))
        departing = sets.departing(others, false_alarms) if may_depart(problem, others) else others
        needless = marginal_likelihood(departing) - marginal_likelihood(fit) - step.table.log_prior(member)
        if needless > 0:
            posterior = _weigh_departing(sets, step, others, departing, false_alarms)
            if not _predicts(problem, posterior, others):  # no rival, and so nothing that speaks against the cause
                continue
            if not posterior.likelier:
                posterior = _better_form(beside_proportional(weigh_fit(problem, step, others), departing), posterior)
            likelier.append((needless, replace(posterior, fit=posterior.fit.without_data())))
        odds[cause.key] = needless
    return odds, [posterior for _, posterior in sorted(likelier, key=lambda row: -row[0])]


def _predicts(problem: Problem, departing: Posterior, textbook: Fit) -> bool:
    """Whether causes as they depart predict conditions that were left out better than they do in their textbook forms.

    Beside something unknown two departures that look nearly the same may cancel, each larger than the cause: what they
    describe is this recording, and nothing that stays.
    """
    if departing.settled:
        return True
    return measure_gap(departing.fit, problem.conditions).after < measure_gap(textbook, problem.conditions).after


def weigh_fit(problem: Problem, step: Step, fit: Fit) -> Posterior:
    """A fit against something unknown, with all structure that it leaves."""
    left = sorted([*find_left(problem, fit), *_entering(problem, step, fit)], key=lambda f: f.log_p_value)
    return weigh_against_unknown(problem, fit, left, step.log_alarm, step.table.effects)


def _entering(problem: Problem, step: Step, fit: Fit) -> list[StructureTest]:
    """The known effect that stood out beside the causes of a step, if it does so still."""
    table, entering = step.table, step.entering
    if entering is None or not step.improvable:
        return []
    member = entering.members[-1]
    candidate = table.candidates[member]
    if candidate.key in {cause.key for cause in fit.causes}:
        return []
    at_zero = candidate.cause(np.zeros(len(candidate.linear)))
    columns = problem.signature(at_zero, candidate.linear, fit.causes)
    reductions, dof = reductions_beside(problem, fit, columns)
    # All known effects together have as much of the false-alarm rate as all tests for structure.
    log_p_value = log_f_tail(sum(reductions.values()) / dof, dof, table.noise_dof) - table.log_prior(member)
    log_p_value += step.log_alarm - step.log_alarm_entering
    words = " at ".join(filter(None, candidate.key))
    return [
        StructureTest(channel, "known effect", log_p_value, reduction, f"as by {words}")
        for channel, reduction in reductions.items()
    ]


def rivals_of(step: Step) -> Iterator[tuple[Cause, ...]]:
    """Sets with one cause replaced that, as they may depart, could explain as much as the step's.

    The set itself is replaced first where another is likelier once what none describes counts as noise.
    """
    table, scatter = step.table, dispersion(step.fit)
    grown = tuple(i for i in (table.position(c.key) for c in step.fit.causes) if i is not None)
    full = table.exchange(table.evaluate(grown), scatter)
    members, near = full.members, list[Hypothesis]()
    if members != grown:
        yield table.causes(full)
    for k in range(len(members)):
        own = full.reduction - table.evaluate((*members[:k], *members[k + 1 :])).reduction
        for hypothesis in table.replacements(members, k, table.free(members)):
            alike = scatter * chi_square_quantile(REJECTED, max(abs(full.dof - hypothesis.dof), 1))
            if full.reduction - hypothesis.reduction < max(alike, LARGEST_POWER * own):
                near.append(hypothesis)
    for hypothesis in sorted(near, key=lambda w: -w.evidence_in(scatter))[:MOST_RIVALS]:
        yield table.causes(hypothesis)
