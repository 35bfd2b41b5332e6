"""Which effects explain a recording: grown one by one, all pairs weighed, stopped when only noise is left.

At each size the set with the most evidence is fitted exactly and what remains is tested twice: against every known
effect (does another one stand out?) and against every kind of structure (does anything stand out, known or not?).
The false-alarm rate of one run is shared by both families of tests and, within each, by Bonferroni.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.hypotheses import Hypothesis, HypothesisTable
from rotary_error_monitor.gap.normal import acting_on, combine
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES
from rotary_error_monitor.gap.posterior import Powers, powers_of, summed
from rotary_error_monitor.gap.prior_conflict import find_left
from rotary_error_monitor.gap.problem import FIRST_ORDER, Candidate, Columns, Problem
from rotary_error_monitor.gap.steps import Selection, Step
from rotary_error_monitor.twin.finite import UnpredictableError

NOTICEABLE = 1.0
"""Sum of squares by which predictions must differ for the order in which causes act to be looked at."""

DISTORTED = 5e-3
"""Part of a signature that may be another beside the causes: what is missed of a reduction of chi-square is the square
of that part."""

BADLY_DISTORTED = 3e-2
"""The same for candidates that were not among the best so far."""

SHORTLIST = 12
"""Candidates from which every pair is weighed with every other candidate."""


def select_causes(
    problem: Problem,
    false_alarms: float = FALSE_ALARMS,
    most: int = MOST_CAUSES,
    progress: Callable[[str], None] = lambda step: None,
) -> Selection:
    """Grow the set of causes until only noise is left or `most` are in it.

    Args:
        problem: recording beside twin.
        false_alarms: largest chance that anything at all is found in a recording without a gap.
        most: largest number of effects combined.
        progress: called with a few words at the beginning of each step.

    Raises:
        UnpredictableError: the twin gives numbers that are not finite without any effect.
    """
    search = _Search(problem, false_alarms)
    progress("residual")
    steps = [search.assess(fit_causes(problem, ()))]
    while not steps[-1].settled and len(steps) <= most and search.can_grow(steps[-1]):
        progress(f"{len(steps)} effect{'s' if len(steps) > 1 else ''}")
        grown = search.grow(steps[-1], len(steps))
        if grown is None:
            break
        steps.append(search.eliminate(grown))
    return Selection(tuple(steps), tuple(search.dropped))


class _Search:
    """Keeps candidates and their signatures between steps."""

    def __init__(self, problem: Problem, false_alarms: float) -> None:
        self._problem = problem
        self._level = false_alarms / 2  # one half for structure, one for known effects
        self._known: dict[tuple[str, str, bytes], Candidate] = {}
        self._columns: dict[tuple[str, str, bytes], Columns] = {}
        self._promising: list[tuple[str, str, bytes]] = []
        self.dropped: dict[tuple[str, str], None] = {}

    def assess(self, fit: Fit) -> Step:
        """Test what a fit leaves."""
        # What was learnt beside fewer causes may have been one of these.
        if self._problem.learn_noise(fit.causes):
            self._columns.clear()
            fit = fit_causes(self._problem, fit.causes)
        findings = find_left(self._problem, fit)
        table, included = self._table(fit)
        larger = table.singles(included)
        self._keep_promising(table, larger)
        base = table.evaluate(included)
        powers = {**dict.fromkeys(fit.rest, 0.0), **summed(powers_of(self._problem, fit))}
        best, chance = self._entering(table, larger, base, powers)
        return Step(
            fit.without_data(),
            table,
            tuple(findings),
            float(np.log(self._level / max(len(findings), 1))),
            best,
            chance,
            float(np.log(self._level)),
            powers,
        )

    def can_grow(self, step: Step) -> bool:
        """Whether there is an effect left that could join the set."""
        return bool(step.table.singles(self._members(step)))

    def grow(self, step: Step, size: int) -> Step | None:
        """The best set of one more effect; None where there is none that the twin can predict."""
        while self.can_grow(step):
            best = self._best(step, size)
            fit = self._fit_or_drop(step, best)
            if fit is not None:
                # A late sensor turns the signature of every uncertain parameter: they are looked at again beside the
                # causes.
                return self.assess(fit)
        return None

    def _fit_or_drop(self, step: Step, hypothesis: Hypothesis) -> Fit | None:
        """A set fitted, from the fit of a step; where the twin cannot predict it, its new members are dropped."""
        table, members = step.table, self._members(step)
        try:
            return self._fit_in_order(fit_causes(self._problem, table.causes(hypothesis), step.fit).causes)
        except UnpredictableError:
            for member in set(hypothesis.members) - set(members) or hypothesis.members:
                table.drop(member)
                self.dropped[table.candidates[member].key] = None
            return None

    def _best(self, step: Step, size: int) -> Hypothesis:
        table = step.table
        included = self._members(step)
        singles = sorted(table.singles(included), key=lambda w: -w.log_evidence)
        best = singles[0]
        if size == 2:
            alone = sorted(table.singles(), key=lambda w: -w.log_evidence)[:SHORTLIST]
            beside = [w.members[-1] for w in singles[:SHORTLIST]]
            pair = table.best_pair(sorted({*(w.members[0] for w in alone), *beside}))
            best = max((w for w in (best, pair) if w is not None), key=lambda w: w.log_evidence)
        entering = step.entering if step.entering and step.entering.members[-1] in table.free(()) else None
        if entering is not None and best.log_evidence <= table.evaluate(included).log_evidence:
            # So small for its kind that its size alone speaks against it: it stands out nonetheless.
            return entering
        return table.exchange(best)

    def _fit_in_order(self, causes: Sequence[Cause]) -> Fit:
        """The causes fitted, neighbours swapped where that explains more: what one adds the next one may distort."""
        fit = fit_causes(self._problem, causes)
        for k in range(len(causes) - 1):
            given = fit.causes
            swapped = (*given[:k], given[k + 1], given[k], *given[k + 2 :])
            now, other = self._problem.residual(given), self._problem.residual(swapped)
            if sum(float(np.sum(np.square(other[channel] - rows))) for channel, rows in now.items()) > NOTICEABLE:
                fit = min(fit, fit_causes(self._problem, swapped), key=lambda fit: fit.squares)
        return fit

    def _keep_promising(self, table: HypothesisTable, larger: Sequence[Hypothesis]) -> None:
        """Remember the best candidates: the next table holds them whatever the next search proposes."""
        best = sorted(larger, key=lambda hypothesis: -hypothesis.log_evidence)[:SHORTLIST]
        found = [table.candidates[hypothesis.members[-1]] for hypothesis in best]
        self._promising = list(dict.fromkeys([*self._promising, *((*c.key, c.start.tobytes()) for c in found)]))

    def _members(self, step: Step) -> tuple[int, ...]:
        found = (step.table.position(cause.key) for cause in step.fit.causes)
        return tuple(i for i in found if i is not None)

    def eliminate(self, step: Step) -> Step:
        """The step without causes that are not needed after all, now that the noise is known better."""
        table, members = step.table, self._members(step)
        full = table.evaluate(members)
        for k in range(len(members)):
            fewer = table.evaluate((*members[:k], *members[k + 1 :]))
            reduction, dof = full.reduction - fewer.reduction, max(full.dof - fewer.dof, 1)
            lost = dataclasses.replace(full, reduction=reduction, dof=dof)
            if lost.log_p_value - table.log_prior(members[k]) > step.log_alarm_entering:
                fit = fit_causes(self._problem, table.causes(fewer))
                return self.assess(fit)
        return step

    def _entering(
        self, table: HypothesisTable, larger: Sequence[Hypothesis], base: Hypothesis, powers: Powers
    ) -> tuple[Hypothesis | None, float]:
        """The candidate that stands out most: its chance over its share of the false-alarm rate.

        Each candidate has the part of the rate that its prior chance is (a weighted Bonferroni bound: the parts add up
        to the whole), so a place among hundreds must show more than an effect that can sit in one place only. What
        the twin may leave of the causes on the channels that the candidate acts on is taken off its reduction.
        """
        best, lowest = None, 0.0
        for hypothesis in larger:
            if base.members and hypothesis.log_evidence <= base.log_evidence:
                # Beside a cause that is found, chance alone is no reason: the pair must be likelier than the one.
                continue
            added = dataclasses.replace(
                hypothesis,
                reduction=max(hypothesis.reduction - base.reduction, 0.0),
                dof=max(hypothesis.dof - base.dof, 1),
            )
            prior = table.log_prior(hypothesis.members[-1])
            if added.log_p_value - prior >= lowest:
                continue
            allowance = self._allowance(table.candidates[hypothesis.members[-1]], powers)
            chance = dataclasses.replace(added, reduction=max(added.reduction - allowance, 0.0)).log_p_value - prior
            if chance < lowest:
                best, lowest = hypothesis, chance
        return best, lowest

    def _allowance(self, candidate: Candidate, powers: Powers) -> float:
        """Squares that the twin may leave of the causes where a candidate acts."""
        columns = self._columns.get((*candidate.key, candidate.start.tobytes()))
        channels = set(powers) if columns is None else acting_on(columns)
        return FIRST_ORDER**2 * sum(powers.get(channel, 0.0) for channel in channels)

    def _table(self, fit: Fit) -> tuple[HypothesisTable, tuple[int, ...]]:
        """All candidates so far and those that the remainder proposes, weighed on data with the causes put back."""
        proposed = [(*c.key, c.start.tobytes()) for c in self._remember(self._problem.candidates(fit.rest, fit.causes))]
        included = {cause.key for cause in fit.causes}
        left_out = included | set(self.dropped)
        wanted = [key for key in dict.fromkeys([*proposed, *self._promising]) if self._known[key].key not in left_out]
        candidates = [self._known[key] for key in wanted]
        distortions = self._problem.distortions(candidates, fit.causes)
        others = []
        for key, candidate, distortion in zip(wanted, candidates, distortions, strict=True):
            distorted = distortion > (DISTORTED if key in self._promising else BADLY_DISTORTED)
            try:
                others.append((candidate, self._columns_of(key, fit.causes if distorted else ())))
            except UnpredictableError:
                self.dropped[candidate.key] = None
        return self._weigh(fit, others)

    def _columns_of(self, key: tuple[str, str, bytes], beside: Sequence[Cause]) -> Columns:
        """Signature of a candidate, kept if it is that of it alone."""
        if not beside and key in self._columns:
            return self._columns[key]
        candidate = self._known[key]
        at_zero = candidate.cause(np.zeros(len(candidate.linear)))
        columns = self._problem.signature(at_zero, candidate.linear, beside)
        if not beside:
            self._columns[key] = columns
        return columns

    def _remember(self, candidates: Sequence[Candidate]) -> Sequence[Candidate]:
        for candidate in candidates:
            self._known[(*candidate.key, candidate.start.tobytes())] = candidate
        return candidates

    def _weigh(self, fit: Fit, others: Sequence[tuple[Candidate, Columns]]) -> tuple[HypothesisTable, tuple[int, ...]]:
        own = [self._fitted(fit, i) for i in range(len(fit.causes))]
        candidates = [c for c, _, _ in own] + [c for c, _ in others]
        columns = [rows for _, rows, _ in own] + [rows for _, rows in others]
        put_back = combine(self._problem, [rows for _, rows, _ in own], [amplitudes for _, _, amplitudes in own])
        data = {
            channel: rows + put_back[channel] if channel in put_back else rows for channel, rows in fit.data.items()
        }
        table = HypothesisTable(self._problem, data, fit.nuisance, candidates, columns)
        return table, tuple(range(len(own)))

    def _fitted(self, fit: Fit, index: int) -> tuple[Candidate, Columns, Array]:
        """A cause of the fit as a candidate: its signature at its own values, and its amplitudes."""
        cause = fit.causes[index]
        known = next(candidate for candidate in self._known.values() if candidate.key == cause.key)
        candidate = dataclasses.replace(known, start=cause.values)
        columns = self._problem.signature(cause, candidate.linear, fit.causes)
        return candidate, columns, cause.values[candidate.linear]
