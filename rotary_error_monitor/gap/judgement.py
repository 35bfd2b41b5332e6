"""What a diagnosis concludes from the sets of causes that were tried: verdict, causes, departures, probabilities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.alternatives import Key
from rotary_error_monitor.gap.departures import LARGEST_POWER, Departing, LeavingOut
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.held_out import UNNEEDED, chance_of_no_better, dispersion, held_out_squares, predicts
from rotary_error_monitor.gap.hypotheses import Hypothesis
from rotary_error_monitor.gap.normal import combine, width_of
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.p_values import chi_square_quantile, log_chi_square_tail
from rotary_error_monitor.gap.posterior import (
    Posterior,
    marginal_likelihood,
    powers_of,
    reductions_beside,
    weigh_against_unknown,
    with_departures,
)
from rotary_error_monitor.gap.prior_conflict import find_left
from rotary_error_monitor.gap.problem import Finding, Problem
from rotary_error_monitor.gap.shrink import measure_gap
from rotary_error_monitor.gap.standing import standing_departures
from rotary_error_monitor.gap.steps import Selection, Step
from rotary_error_monitor.gap.verdict import REJECTED, Verdict, cancelled_in, probability_of_unknown
from rotary_error_monitor.twin.finite import UnpredictableError

MOST_RIVALS = 2
"""Causes in the place of one that looks the same, whose departures are looked at as well: each costs a fit."""

MOST_ROUNDS = 3
"""Times that outliers are looked for beside departures: as a rule the second finds no others."""

MOST_ALONE = 6
"""Effects that are looked at alone where no set is believed: each costs a fit."""


@dataclass(frozen=True)
class Judgement:
    """Outcome of weighing the sets that were tried.

    Attributes:
        step: set of causes whose table of candidates the alternatives are read from.
        fit: causes with their departures.
        findings: structure that is left; empty where only noise is.
        unknown: probability that something unknown stands in the place of the causes.
        credits: log odds of sets with another cause, by that cause, beside those of the chosen one.
        needless: log odds, by cause, that it is a departure of the others.
        doubts: why causes that fit were not believed.
    """

    verdict: Verdict
    step: Step
    fit: Fit
    findings: tuple[Finding, ...]
    unknown: float
    dispersion: float = 1.0
    credits: Mapping[Key, float] | None = None
    needless: Mapping[Key, float] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


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
        return _judge_open(problem, selection, false_alarms)
    doubts = _doubts(problem, chosen)
    progress("departures")
    if chosen.settled and not doubts:
        return _judge_settled(problem, chosen, false_alarms)
    tried, learnt = _tried(problem, selection), False
    for _ in range(MOST_ROUNDS):
        if not _learns_outliers(problem, [posterior for _, posterior in tried]):
            break
        tried, learnt = _tried(problem, selection), True
    believed: Judgement | None = None
    if tried:
        step, best = _likeliest(tried)
        if best.likelier:
            believed = _believed(step, best, [posterior for other, posterior in tried if other is step])
    if believed and believed.verdict is Verdict.EXPLAINED:
        return believed
    alone = _passed_by(problem, null)
    # What the search passed by is believed only if it leaves nothing, and none of the others is likelier.
    if alone and alone[0].settled and alone[0].likelier and (not believed or alone[0].total > best.total):
        return _believed(null, alone[0], alone)
    if believed:
        return believed
    unknown = 1 - max((posterior.probability for _, posterior in tried), default=0.0)
    fit, findings = null.fit, null.findings
    if learnt:
        fit = fit_causes(problem, ())
        findings = tuple(find_left(problem, fit))
    return Judgement(Verdict.UNKNOWN, null, fit, _alarming(findings, null), unknown, doubts=doubts)


def _tried(problem: Problem, selection: Selection) -> list[tuple[Step, Posterior]]:
    """All sets of the search, and those that may look the same, weighed; each with the step that it is of."""
    seen: set[frozenset[Key]] = set()
    return [(step, posterior) for step in selection.steps[1:] for posterior in _posteriors(problem, step, seen)]


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


def _judge_settled(problem: Problem, chosen: Step, false_alarms: float) -> Judgement:
    """Of causes that leave only noise."""
    fit = fit_causes(problem, chosen.fit.causes, chosen.fit)
    needless, instead = _departures_instead(problem, chosen, fit, false_alarms)
    likelier = [posterior for posterior in instead if posterior.settled and posterior.likelier]
    if likelier:
        return _believed(chosen, likelier[0], likelier)
    departing = _settled_with_departures(problem, chosen, fit, false_alarms)
    if departing:
        _, best = _likeliest([(chosen, posterior) for posterior in departing])
        return _believed(chosen, best, departing)
    # What is alarming, but no more than the twin itself leaves, tells of nothing unknown.
    unknown = probability_of_unknown([f for f in chosen.findings if f.log_p_value >= chosen.log_alarm])
    return Judgement(Verdict.EXPLAINED, chosen, chosen.fit, (), unknown, needless=needless)


def _passed_by(problem: Problem, null: Step) -> list[Posterior]:
    """Single causes with their departures that the search may have passed by, the likeliest first.

    Uncertain parameters of the twin, if it has any, may have taken the textbook form of a cause, so that only its
    departure shows, which others then seem to explain better; and beside them an effect that is far from linear is told
    from others by its own fit only.
    """
    if not len(null.fit.nuisance_values):
        return []
    table, best = null.table, dict[str, Hypothesis]()
    for hypothesis in sorted(table.singles(), key=lambda hypothesis: -hypothesis.log_evidence):
        if hypothesis.log_evidence > 0:
            best.setdefault(table.candidates[hypothesis.members[0]].effect.name, hypothesis)
    alone = list(best.values())[:MOST_ALONE]
    found = [posterior for hypothesis in alone for posterior in _alone(problem, null, hypothesis)]
    scatter = min((dispersion(posterior.fit) for posterior in found), default=1.0)
    return sorted(found, key=lambda posterior: -_log_weight(null, posterior, scatter))


def _alone(problem: Problem, null: Step, hypothesis: Hypothesis) -> Iterator[Posterior]:
    """A cause with its departures, unless the twin cannot predict it."""
    with suppress(UnpredictableError):
        fit = with_departures(problem, fit_causes(problem, null.table.causes(hypothesis)))
        yield replace(_weighed(problem, null, fit), fit=fit.without_data())


def _likeliest(tried: Sequence[tuple[Step, Posterior]]) -> tuple[Step, Posterior]:
    """Of the sets of which each cause is likelier than something unknown that with the highest log odds; of those as
    large the likeliest. Where there is no such set, that with the highest log odds of all.

    Odds against something unknown hardly tell one good fit from another.
    """
    believable = [pair for pair in tried if pair[1].likelier] or tried
    best = max(believable, key=lambda pair: pair[1].total)
    alike = [pair for pair in believable if len(pair[1].fit.causes) == len(best[1].fit.causes)]
    if not best[1].likelier:
        return best
    scatter = min(dispersion(posterior.fit) for _, posterior in alike)
    return max(alike, key=lambda pair: _log_weight(pair[0], pair[1], scatter))


def _log_weight(step: Step, posterior: Posterior, scatter: float) -> float:
    """Log evidence of a set with its departures and the places and orders of its causes.

    What something unknown is likelier than is so much less likely beside other sets. Squares are divided by `scatter`,
    how many times those of noise the best set leaves: what no set describes is noise to the choice among them.
    """
    members = (step.table.position(cause.key) for cause in posterior.fit.causes)
    prior = sum(step.table.log_prior(i) for i in members if i is not None)
    undescribed = 0.5 * posterior.fit.squares * (1 - 1 / scatter)
    return marginal_likelihood(posterior.fit) + undescribed + prior + min(posterior.total, 0.0)


def _settled_with_departures(problem: Problem, step: Step, fit: Fit, false_alarms: float) -> list[Posterior]:
    """Causes that leave only noise, with the departures that show nonetheless, and others that depart less.

    Empty where none shows, and where something unknown is likelier than causes that depart as far.
    """
    departing = with_departures(problem, fit, false_alarms)
    if departing is fit:
        return []
    own = weigh_against_unknown(problem, departing, (), step.log_alarm, step.table.effects)
    seen = {frozenset(cause.key for cause in step.fit.causes)}
    rivals = [other for causes in _rivals(step) for other in _pruned(problem, step, causes, seen, false_alarms)]
    found = [replace(own, fit=departing.without_data()), *(other for other in rivals if other.settled)]
    return [posterior for posterior in found if posterior.likelier]


def _believed(step: Step, best: Posterior, others: list[Posterior]) -> Judgement:
    keys, scatter = {cause.key for cause in best.fit.causes}, dispersion(best.fit)
    credits = {
        key: _log_weight(step, posterior, scatter) - _log_weight(step, best, scatter)
        for posterior in others
        for key in {cause.key for cause in posterior.fit.causes} - keys
        if len(posterior.fit.causes) == len(best.fit.causes)
    }
    return Judgement(
        Verdict.EXPLAINED if best.settled else Verdict.PARTLY_EXPLAINED,
        step,
        best.fit,
        () if best.settled else _alarming(best.findings, step),
        1 - best.probability,
        dispersion(step.fit),
        credits,
        best.needless,
    )


def _alarming(findings: tuple[Finding, ...], step: Step) -> tuple[Finding, ...]:
    return tuple(f for f in findings if f.log_p_value < step.log_alarm)


def _posteriors(problem: Problem, step: Step, seen: set[frozenset[Key]]) -> Iterator[Posterior]:
    """The causes of a step and those that may look the same, with departures and without, and what is left of them.

    Sets that were weighed before are `seen`, which is added to.
    """
    found = list(_pruned(problem, step, step.fit.causes, seen))
    yield from found
    for causes in _rivals(step) if any(posterior.near for posterior in found) else ():
        yield from _pruned(problem, step, causes, seen)


def _pruned(
    problem: Problem, step: Step, causes: tuple[Cause, ...], seen: set[frozenset[Key]], false_alarms: float = 1.0
) -> Iterator[Posterior]:
    """Causes weighed; without those that something unknown is likelier than, weighed again; none a second time."""
    while causes and (keys := frozenset(cause.key for cause in causes)) not in seen:
        seen.add(keys)
        try:
            posterior = _posterior(problem, step, causes, false_alarms)
        except UnpredictableError:
            return
        if cancelled_in(problem, posterior.fit):
            return
        yield posterior
        fewer = tuple(c for c, odds in zip(posterior.fit.causes, posterior.log_odds, strict=True) if odds > 0)
        if len(fewer) == len(causes):
            return
        causes = fewer


def _posterior(problem: Problem, step: Step, causes: tuple[Cause, ...], false_alarms: float) -> Posterior:
    """Causes with departures or without: where nothing is left of either form the likelier, else that with better odds.

    Sets that leave nothing are compared by evidence, for which each has to stand in its likeliest form.
    """
    fit = fit_causes(problem, causes)
    best = _weighed(problem, step, fit)
    if best.near:
        departing = with_departures(problem, fit, false_alarms)
        if departing is not fit and _predicts(problem, weighed := _weighed(problem, step, departing)):
            both = best.settled and weighed.settled and weighed.likelier
            best = max(best, weighed, key=lambda form: marginal_likelihood(form.fit) if both else form.total)
    needless, instead = _departures_instead(problem, step, best.fit)
    return instead[0] if instead else replace(best, fit=best.fit.without_data(), needless=needless)


def _departures_instead(
    problem: Problem, step: Step, fit: Fit, false_alarms: float = 1.0
) -> tuple[dict[Key, float], list[Posterior]]:
    """Log odds that a cause is a departure of the others, and the others where that is likelier, the best first.

    That is looked at where a cause is no larger beside the others than a departure can be (`LARGEST_POWER`).
    """
    powers = [sum(power.values()) for power in powers_of(problem, fit)]
    odds: dict[Key, float] = {}
    likelier: list[tuple[float, Posterior]] = []
    for k, cause in enumerate(fit.causes):
        member = step.table.position(cause.key)
        if powers[k] > LARGEST_POWER * max(powers) or member is None:
            continue
        others = fit_causes(problem, (*fit.causes[:k], *fit.causes[k + 1 :]))
        departing = with_departures(problem, others, false_alarms)
        odds[cause.key] = marginal_likelihood(departing) - marginal_likelihood(fit) - step.table.log_prior(member)
        if odds[cause.key] > 0 and _predicts(problem, posterior := _weighed(problem, step, departing)):
            likelier.append((odds[cause.key], replace(posterior, fit=departing.without_data())))
    return odds, [posterior for _, posterior in sorted(likelier, key=lambda row: -row[0])]


def _predicts(problem: Problem, departing: Posterior) -> bool:
    """Whether causes as they depart predict conditions that were left out better than no cause does.

    Beside something unknown two departures that look nearly the same may cancel, each larger than the cause: what they
    describe is this recording, and nothing that stays.
    """
    if departing.settled:
        return True
    gap = measure_gap(departing.fit, problem.conditions)
    return gap.after < gap.before


def _weighed(problem: Problem, step: Step, fit: Fit) -> Posterior:
    left = sorted([*find_left(problem, fit), *_entering(problem, step, fit)], key=lambda f: f.log_p_value)
    return weigh_against_unknown(problem, fit, left, step.log_alarm, step.table.effects)


def _entering(problem: Problem, step: Step, fit: Fit) -> list[Finding]:
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
    log_p_value = log_chi_square_tail(sum(reductions.values()), dof) - table.log_prior(member)
    log_p_value += step.log_alarm - step.log_alarm_entering
    words = " at ".join(filter(None, candidate.key))
    return [
        Finding(channel, "known effect", log_p_value, reduction, f"as by {words}")
        for channel, reduction in reductions.items()
    ]


def _rivals(step: Step) -> Iterator[tuple[Cause, ...]]:
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


def _judge_open(problem: Problem, selection: Selection, false_alarms: float) -> Judgement:
    """Where something unknown is always there beside the causes: causes stand that predict what was left out.

    Departures of many kinds would take up the unknown as well. They are believed where nothing is left beside them and
    each cause is likelier than something unknown in its place, as on a machine; and, the smallest set first, where a
    set with them predicts better than one without: by more than chance if it has as many causes, in sum if it has
    fewer, since each further cause must be needed.
    """
    best = _standing(problem, selection)
    if not best.fit.causes or not isinstance(problem, Departing):
        return best
    # Fitted anew: the noise may have been learnt since.
    squares = held_out_squares(fit_causes(problem, best.fit.causes), problem.conditions)
    for step in selection.steps[1:]:
        fit = standing_departures(problem, step.fit.causes, false_alarms)
        if fit is None:
            continue
        weighed, others = _weighed(problem, step, fit), held_out_squares(fit, problem.conditions)
        if not (weighed.settled and weighed.likelier):
            continue
        by_chance = chance_of_no_better(others, squares) > UNNEEDED
        fewer = len(fit.causes) < len(best.fit.causes) and float(others.sum()) <= float(squares.sum())
        if fewer or not by_chance:
            doubts = (f"{_named(best.fit)} in their textbook forms predict what was left out as well",)
            best = _open(step, fit.without_data(), weighed.findings, True, doubts if by_chance else ())
            squares = others
    return best


def _standing(problem: Problem, selection: Selection) -> Judgement:
    """The largest set of causes that stands in its textbook forms."""
    chosen, null = selection.chosen, selection.null
    if chosen.settled:
        return _open(chosen, chosen.fit, chosen.findings, True)
    for step in selection.steps[:0:-1]:
        if predicts(problem, step.fit):
            return _open(step, step.fit, step.findings, False)
    unknown = probability_of_unknown(null.findings)
    return Judgement(Verdict.UNKNOWN, null, null.fit, _alarming(null.findings, null), unknown)


def _open(
    step: Step, fit: Fit, findings: tuple[Finding, ...], settled: bool, doubts: tuple[str, ...] = ()
) -> Judgement:
    if settled:
        return Judgement(Verdict.EXPLAINED, step, fit, (), probability_of_unknown(findings), doubts=doubts)
    # Something unknown is there beside the causes, not in their place: it is noise to the choice among them.
    left = _alarming(findings, step)
    return Judgement(Verdict.PARTLY_EXPLAINED, step, fit, left, 0.0, dispersion(step.fit))


def _doubts(problem: Problem, step: Step) -> tuple[str, ...]:
    """Why causes are not believed however well they fit."""
    channel = cancelled_in(problem, step.fit)
    if not channel:
        return ()
    words = "something that is not seen there is the likelier cause"
    return (f"{_named(step.fit)} fit, but cancel one another on {channel}: {words}",)


def _named(fit: Fit) -> str:
    return " and ".join(" at ".join(filter(None, cause.key)) for cause in fit.causes)
