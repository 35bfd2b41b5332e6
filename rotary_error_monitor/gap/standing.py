"""Where something unknown is always there, causes stand, and depart, if they predict what was left out.

What decides is what decides on causes without departures (`held_out.py`): each kind of departure, and each cause beside
the others as they depart, must be needed to predict patches that were left out, by more than chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.departure_selection import with_departures
from rotary_error_monitor.gap.departures import Departing
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.held_out import UNNEEDED, chance_of_no_better, dispersion, held_out_squares, predicts
from rotary_error_monitor.gap.problem import Problem, StructureTest
from rotary_error_monitor.gap.steps import Selection, Step
from rotary_error_monitor.gap.verdict import Judgement, Verdict, alarming, names_of, probability_of_unknown
from rotary_error_monitor.gap.weighing import weigh_fit
from rotary_error_monitor.twin.finite import UnpredictableError


def judge_open(problem: Problem, selection: Selection, false_alarms: float) -> Judgement:
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
        weighed, others = weigh_fit(problem, step, fit), held_out_squares(fit, problem.conditions)
        if not (weighed.settled and weighed.likelier):
            continue
        by_chance = chance_of_no_better(others, squares) > UNNEEDED
        fewer = len(fit.causes) < len(best.fit.causes) and float(others.sum()) <= float(squares.sum())
        if fewer or not by_chance:
            doubts = (f"{names_of(best.fit.causes)} in their textbook forms predict what was left out as well",)
            best = _open(step, fit.without_data(), weighed.findings, True, doubts if by_chance else ())
            squares = others
    return best


def standing_departures(problem: Problem, causes: Sequence[Cause], false_alarms: float) -> Fit | None:
    """The causes with those departures that are needed, without the causes that are not needed beside them.

    Selected on textbook forms, further causes may stand for nothing but how the first one departs.

    Args:
        problem: recording beside twin.
        causes: as fitted in their textbook forms.
        false_alarms: as `with_departures`.

    Returns:
        None where no departure is needed.
    """
    while causes:
        try:
            fit = needed_departures(problem, fit_causes(problem, causes), false_alarms)
            if not fit.departures:
                return None
            chances = _chances_without(problem, fit, false_alarms)
        except UnpredictableError:
            return None
        if max(chances) <= UNNEEDED:
            return fit
        causes = _without(fit.causes, int(np.argmax(chances)))
    return None


def needed_departures(problem: Problem, fit: Fit, false_alarms: float) -> Fit:
    """A fit with the departures that the recording asks for, as far as each kind predicts what was left out."""
    found = with_departures(problem, fit, false_alarms)
    while found.departures:
        owners = [(d.cause, kind) for d in found.departures for kind in d.kinds]
        squares = held_out_squares(found, problem.conditions)
        kinds = list(dict.fromkeys(owners))
        chances = [
            chance_of_no_better(
                squares, held_out_squares(found, problem.conditions, np.array([owner != kind for owner in owners]))
            )
            for kind in kinds
        ]
        if max(chances) <= UNNEEDED:
            break
        unneeded = kinds[int(np.argmax(chances))]
        kept = [
            d.chosen([i for i, kind in enumerate(d.kinds) if (d.cause, kind) != unneeded]) for d in found.departures
        ]
        found = fit_causes(problem, found.causes, departures=[d for d in kept if d.kinds])
    return found


def _chances_without(problem: Problem, fit: Fit, false_alarms: float) -> list[float]:
    """For each cause, part of the resamplings in which the others, departing as they may, predict no worse."""
    squares = held_out_squares(fit, problem.conditions)
    fewer = (fit_causes(problem, _without(fit.causes, i)) for i in range(len(fit.causes)))
    others = (needed_departures(problem, alone, false_alarms) for alone in fewer)
    return [chance_of_no_better(squares, held_out_squares(other, problem.conditions)) for other in others]


def _without(causes: Sequence[Cause], place: int) -> tuple[Cause, ...]:
    return (*causes[:place], *causes[place + 1 :])


def _standing(problem: Problem, selection: Selection) -> Judgement:
    """The largest set of causes that stands in its textbook forms."""
    chosen, null = selection.chosen, selection.null
    if chosen.settled:
        return _open(chosen, chosen.fit, chosen.findings, True)
    for step in selection.steps[:0:-1]:
        if predicts(problem, step.fit):
            return _open(step, step.fit, step.findings, False)
    unknown = probability_of_unknown(null.findings)
    return Judgement(Verdict.UNKNOWN, null, null.fit, alarming(null.findings, null), unknown)


def _open(
    step: Step, fit: Fit, findings: tuple[StructureTest, ...], settled: bool, doubts: tuple[str, ...] = ()
) -> Judgement:
    if settled:
        return Judgement(Verdict.EXPLAINED, step, fit, (), probability_of_unknown(findings), doubts=doubts)
    # Something unknown is there beside the causes, not in their place: it is noise to the choice among them.
    left = alarming(findings, step)
    return Judgement(Verdict.PARTLY_EXPLAINED, step, fit, left, 0.0, dispersion(step.fit))
