"""Causes with departures where something unknown is always there: they stand if they predict what was left out.

What decides is what decides on causes without departures (`held_out.py`): each kind of departure, and each cause beside
the others as they depart, must be needed to predict patches that were left out, by more than chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import Fit, fit_causes
from rotary_error_monitor.gap.held_out import UNNEEDED, chance_of_no_better, held_out_squares
from rotary_error_monitor.gap.posterior import with_departures
from rotary_error_monitor.gap.problem import Problem
from rotary_error_monitor.twin.finite import UnpredictableError


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
