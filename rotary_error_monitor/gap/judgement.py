"""What a diagnosis concludes from the sets of causes that were tried: verdict, causes, departures, probabilities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from rotary_error_monitor.gap.alternatives import REJECTED, Key
from rotary_error_monitor.gap.departures import SHARE, LeavingOut
from rotary_error_monitor.gap.fitted_sets import FittedSets, set_of
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.held_out import dispersion
from rotary_error_monitor.gap.hypotheses import Hypothesis
from rotary_error_monitor.gap.normal import combine, width_of
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.posterior import (
    Posterior,
    is_likelier_instead,
    marginal_likelihood,
    may_depart,
    weigh_against_unknown,
)
from rotary_error_monitor.gap.prior_conflict import find_left
from rotary_error_monitor.gap.problem import Problem
from rotary_error_monitor.gap.standing import judge_open
from rotary_error_monitor.gap.steps import Selection, Step
from rotary_error_monitor.gap.verdict import (
    Judgement,
    Verdict,
    alarming,
    doubt_about,
    probability_of_unknown,
)
from rotary_error_monitor.gap.weighing import departures_instead, rivals_of, weigh_causes, weigh_fit, weigh_step
from rotary_error_monitor.twin.finite import UnpredictableError

MOST_ROUNDS = 3
"""Times that outliers are looked for beside departures: as a rule the second finds no others."""

MOST_ALONE = 6
"""Effects that are looked at alone where no set is believed: each costs a fit."""


def judge(
    problem: Problem,
    selection: Selection,
    false_alarms: float = FALSE_ALARMS,
    progress: Callable[[str], None] = lambda step: None,
) -> Judgement:
    """The verdict on the sets that were tried; arguments as `diagnose`."""
    null, chosen = selection.null, selection.chosen
    if null.settled:
        return Judgement(Verdict.NO_GAP, null, null.fit, (), probability_of_unknown(null.findings))
    if problem.m_open:
        return judge_open(problem, selection, false_alarms)
    doubts = _doubts(problem, chosen)
    progress("departures")
    sets = FittedSets(problem)
    if chosen.settled and not doubts and (settled := _judge_settled(sets, chosen, false_alarms)):
        return settled
    tried, learnt = _tried(sets, selection), False
    for _ in range(MOST_ROUNDS):
        if not _learns_outliers(problem, [posterior for _, posterior in tried]):
            break
        sets = FittedSets(problem)
        tried, learnt = _tried(sets, selection), True
    believed: Judgement | None = None
    if tried:
        step, best = _likeliest(tried)
        if best.likelier:
            believed = _believed(step, best, [posterior for other, posterior in tried if other is step])
    if believed and believed.verdict is Verdict.EXPLAINED:
        return believed
    alone = _passed_by(sets, null)
    # What the search passed by is believed only if none of the others is likelier.
    if alone and (not believed or alone[0].total > best.total):
        return _believed(null, alone[0], alone)
    if believed:
        return believed
    unknown = 1 - max((posterior.probability for _, posterior in tried), default=0.0)
    fit, findings = null.fit, null.findings
    if learnt:
        fit = fit_causes(problem, ())
        findings = tuple(find_left(problem, fit))
    return Judgement(Verdict.UNKNOWN, null, fit, alarming(findings, null), unknown, doubts=doubts)


def _tried(sets: FittedSets, selection: Selection) -> list[tuple[Step, Posterior]]:
    """All sets of the search, and those that may look the same, weighed; each with the step that it is of."""
    sets.seen.clear()
    return [(step, posterior) for step in selection.steps[1:] for posterior in weigh_step(sets, step)]


def _learns_outliers(problem: Problem, tried: Sequence[Posterior]) -> bool:
    """Whether other rows are outliers beside the causes as they depart than beside their textbook forms.

    What a departure does is left by the textbook form, and outliers hide in it. Of the sets the one counts that
    describes the recording best, whether it is believed or not.
    """
    departing = [posterior.fit for posterior in tried if posterior.fit.departures]
    if not departing or not isinstance(problem, LeavingOut):
        return False
    best = max(departing, key=marginal_likelihood)
    columns = [departures.columns for departures in best.departures]
    values = np.split(best.departure_values, np.cumsum([width_of(rows) for rows in columns])[:-1])
    return problem.learn_outliers(best.causes, combine(problem, columns, values))


def _judge_settled(sets: FittedSets, chosen: Step, false_alarms: float) -> Judgement | None:
    """Of causes that leave only noise; None where something unknown of a form that is known is likelier than one."""
    problem = sets.problem
    fit = fit_causes(problem, chosen.fit.causes, chosen.fit)
    needless, instead = departures_instead(sets, chosen, fit, false_alarms)
    likelier = [posterior for posterior in instead if posterior.settled and posterior.likelier]
    if likelier:
        # Fewer causes that depart: others in their places may do so, which beside the needless one were not looked at.
        fewer = replace(chosen, fit=likelier[0].fit)
        posteriors = [*_settled_with_departures(sets, fewer, likelier[0], false_alarms), *likelier[1:]]
        return _believed(fewer, _likeliest([(fewer, posterior) for posterior in posteriors])[1], posteriors)
    # what is not believed in the place of a cause does not speak against it
    needless = {key: odds for key, odds in needless.items() if odds <= 0}
    departing = sets.departing(fit, false_alarms)
    if departing is not fit:
        # Beside those of rivals, their data would fill the memory.
        fit, departing = fit.without_data(), departing.without_data()
        own = weigh_against_unknown(problem, departing, (), chosen.log_alarm, chosen.table.effects)
        posteriors = _settled_with_departures(sets, chosen, own, false_alarms)
        _, best = _likeliest([(chosen, posterior) for posterior in posteriors])
        # Where something unknown is likelier than causes that depart as far, their textbook forms are refuted as well.
        return _believed(chosen, best, posteriors) if best.likelier else None
    if is_likelier_instead(weigh_against_unknown(problem, fit, (), chosen.log_alarm, chosen.table.effects)):
        return None
    return _in_textbook_forms(problem, chosen, fit, needless)


def _in_textbook_forms(problem: Problem, step: Step, fit: Fit, needless: Mapping[Key, float]) -> Judgement:
    """Of causes that leave only noise and do not depart: they, or a likelier set that leaves no more."""
    # What is alarming, but no more than the twin itself leaves, tells of nothing unknown.
    unknown = probability_of_unknown([f for f in step.findings if f.log_p_value >= step.log_alarm])
    rivals = _fitted_rivals(problem, step)
    better = [rival for rival in rivals if _log_odds(step, fit, rival) < 0]
    standing = [rival for rival in better if weigh_fit(problem, step, fit_causes(problem, rival.causes)).settled]
    best = max(standing, key=partial(_log_evidence, step), default=fit)
    # a likelier one that leaves something is not believed, and does not speak against what leaves nothing
    refused = {set_of(rival.causes) for rival in better} - {set_of(rival.causes) for rival in standing}
    others = [other for other in (fit, *rivals) if set_of(other.causes) not in refused]
    odds = {set_of(other.causes): _log_odds(step, other, best) for other in others}
    credits = {keys: value for keys, value in odds.items() if value > np.log(REJECTED) or keys == set_of(fit.causes)}
    told = best if standing else step.fit
    return Judgement(Verdict.EXPLAINED, step, told, (), unknown, credits=credits or None, needless=needless)


def _fitted_rivals(problem: Problem, step: Step) -> list[Fit]:
    """Near rivals of the causes of a step. On the table all but these are as they are at no size: of large ones that
    would decide between two that are alike.
    """
    found = []
    for causes in rivals_of(step):
        with suppress(UnpredictableError):
            found.append(fit_causes(problem, causes).without_data())
    return found


def _log_odds(step: Step, fit: Fit, beside: Fit) -> float:
    return _log_evidence(step, fit) - _log_evidence(step, beside)


def _passed_by(sets: FittedSets, null: Step) -> list[Posterior]:
    """Single causes with their departures that the search may have passed by, the likeliest first; none where that is
    not likelier than something unknown, or leaves something.

    Uncertain parameters of the twin, if it has any, may have taken the textbook form of a cause, so that only its
    departure shows, which others then seem to explain better: evidence of the textbook form says nothing of these,
    and they are looked at whatever it is. And beside them an effect that is far from linear is told from others by its
    own fit only.
    """
    if not len(null.fit.nuisance_values):
        return []
    table, best = null.table, dict[str, Hypothesis]()
    for hypothesis in sorted(table.singles(), key=lambda hypothesis: -hypothesis.log_evidence):
        if hypothesis.log_evidence > 0:
            best.setdefault(table.candidates[hypothesis.members[0]].effect.name, hypothesis)
    found = list(best.values())
    hidden = [each for each in found[MOST_ALONE:] if 1 - table.taken(each.members[0]) < SHARE**2]
    looked_at = [*found[:MOST_ALONE], *hidden[:MOST_ALONE]]
    fits = [fit for hypothesis in looked_at for fit in _alone(sets, null, hypothesis)]
    scatter = min((dispersion(fit) for fit in fits), default=1.0)
    # What is left of those that can no longer be the likeliest is not looked at: that takes as long as a fit.
    weighed, rest = list[Posterior](), sorted(fits, key=lambda fit: -_log_weight_of(null, fit, scatter))
    while rest and all(_log_weight_of(null, rest[0], scatter) > _log_weight(null, p, scatter) for p in weighed):
        weighed.append(_weighed_alone(sets.problem, null, rest.pop(0)))
    first = max(weighed, key=lambda posterior: _log_weight(null, posterior, scatter), default=None)
    if first is None or not (first.settled and first.likelier):
        return []
    weighed += [_weighed_alone(sets.problem, null, fit) for fit in rest]
    return sorted(weighed, key=lambda posterior: -_log_weight(null, posterior, scatter))


def _alone(sets: FittedSets, null: Step, hypothesis: Hypothesis) -> Iterator[Fit]:
    """A cause with its departures, unless the twin cannot predict it or it leaves too much for them."""
    with suppress(UnpredictableError):
        fit = fit_causes(sets.problem, null.table.causes(hypothesis))
        if may_depart(sets.problem, fit):
            yield sets.departing(fit).without_data()


def _weighed_alone(problem: Problem, null: Step, fit: Fit) -> Posterior:
    return replace(weigh_fit(problem, null, replace(fit, data=problem.residual(fit.causes))), fit=fit)


def _likeliest(tried: Sequence[tuple[Step, Posterior]]) -> tuple[Step, Posterior]:
    """The likeliest set of each size, and of those of which each cause is likelier than something unknown that with the
    highest log odds; where there is none, of all.

    Odds against something unknown hardly tell one good fit from another. Where something unknown is likelier than the
    likeliest set, it is likelier than those that describe less.
    """
    sizes: dict[int, list[tuple[Step, Posterior]]] = {}
    for pair in tried:
        sizes.setdefault(len(pair[1].fit.causes), []).append(pair)
    best = []
    for alike in sizes.values():
        scatter = min(dispersion(posterior.fit) for _, posterior in alike)
        best.append(max(alike, key=lambda pair: _log_weight(pair[0], pair[1], scatter)))
    return max([pair for pair in best if pair[1].likelier] or best, key=lambda pair: pair[1].total)


def _log_weight(step: Step, posterior: Posterior, scatter: float) -> float:
    """Log evidence of a set with its departures and the places and orders of its causes.

    What something unknown is likelier than is so much less likely beside other sets. Squares are divided by `scatter`,
    how many times those of noise the best set leaves: what no set describes is noise to the choice among them.
    """
    return _log_weight_of(step, posterior.fit, scatter) + min(posterior.total, 0.0)


def _log_weight_of(step: Step, fit: Fit, scatter: float) -> float:
    """The same where nothing unknown is likelier: the most that it can be."""
    return _log_evidence(step, fit) + 0.5 * fit.squares * (1 - 1 / scatter)


def _log_evidence(step: Step, fit: Fit) -> float:
    """That of a fit with its departures, and of the places and orders of its causes."""
    members = (step.table.position(cause.key) for cause in fit.causes)
    return marginal_likelihood(fit) + sum(step.table.log_prior(i) for i in members if i is not None)


def _settled_with_departures(sets: FittedSets, step: Step, own: Posterior, false_alarms: float) -> list[Posterior]:
    """Causes that leave only noise, with the departures that show nonetheless, and others in their places."""
    sets.seen.add(set_of(step.fit.causes))
    rivals = [other for causes in rivals_of(step) for other in weigh_causes(sets, step, causes, false_alarms)]
    return [own, *(other for other in rivals if other.settled)]


def _believed(step: Step, best: Posterior, others: list[Posterior]) -> Judgement:
    scatter = dispersion(best.fit)
    weight = _log_weight(step, best, scatter)
    alike = [other for other in others if len(other.fit.causes) == len(best.fit.causes)]
    credits = {set_of(other.fit.causes): _log_weight(step, other, scatter) - weight for other in alike}
    return Judgement(
        Verdict.EXPLAINED if best.settled else Verdict.PARTLY_EXPLAINED,
        step,
        best.fit,
        () if best.settled else alarming(best.findings, step),
        1 - best.probability,
        dispersion(step.fit),
        credits,
        best.needless,
    )


def _doubts(problem: Problem, step: Step) -> tuple[str, ...]:
    """Why causes are not believed however well they fit."""
    return tuple(filter(None, [doubt_about(problem, step.fit)]))
