"""Whether the uncertain parameters of a twin had to be moved further than their uncertainty allows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.normal import grams_by_channel, solve_scaled, width_of
from rotary_error_monitor.gap.p_values import log_chi_square_tail, log_normal_tail
from rotary_error_monitor.gap.posterior import powers_of, summed
from rotary_error_monitor.gap.problem import Problem, StructureTest

_PLAIN = float(np.log(1e-2))
"""Logarithm of a p-value above which nothing alarms, whatever the false-alarm rate."""


def find_prior_conflict(problem: Problem, fit: Fit) -> list[StructureTest]:
    """Tests of the twin's uncertain parameters: moved further than their uncertainty allows, together or one alone.

    A strong effect that resembles a parameter is taken up by it and leaves nothing in the rows; here it shows. Fitted
    values scatter less than their prior, so the tests hold their level.
    """
    moved = fit.nuisance_values
    if len(moved) == 0:
        return []
    words = "twin: parameters beyond their uncertainty"
    furthest = int(np.argmax(np.abs(moved)))
    alone = min(0.0, log_normal_tail(abs(float(moved[furthest]))) + float(np.log(2 * len(moved))))
    squares = float(np.sum(np.square(moved)))
    together = log_chi_square_tail(squares, len(moved))
    reach = _reach(problem, fit) if min(alone, together) < _PLAIN else {}
    return [
        StructureTest("twin", "parameters", together, max(0.0, squares - len(moved)), words, _over(reach, slice(None))),
        StructureTest(
            "twin", "parameter", alone, max(0.0, float(moved[furthest]) ** 2 - 1), words, _over(reach, furthest)
        ),
    ]


def find_left(problem: Problem, fit: Fit) -> list[StructureTest]:
    """All that a fit leaves, the least likely first."""
    found = [*problem.structure(fit.rest), *find_prior_conflict(problem, fit)]
    return sorted(found, key=lambda finding: finding.log_p_value)


def _over(reach: Mapping[str, Array], chosen: int | slice) -> dict[str, float]:
    return {channel: float(np.sum(parts[chosen])) for channel, parts in reach.items()}


def _reach(problem: Problem, fit: Fit) -> dict[str, Array]:
    """By channel on which causes act, how far rows of one square there can move each parameter (u,), squared.

    Rows e of a channel move the values K A' e, with K the inverse of the normal matrix and A the channel's columns: at
    most by the root of a diagonal element of K A'A K.
    """
    count = len(fit.nuisance_values)
    columns = [fit.nuisance, *fit.columns, *(departures.columns for departures in fit.departures)]
    widths = [width_of(rows) for rows in columns]
    prior = np.repeat([1.0, 1e-12, 1.0], [count, sum(widths[1 : 1 + len(fit.columns)]), len(fit.departure_values)])
    gram = fit.blocks.total().gram + np.diag(prior)
    inverse = solve_scaled(gram, np.eye(len(gram)))[:count]
    acting = [channel for channel, power in summed(powers_of(problem, fit)).items() if power > 0]
    grams = grams_by_channel(problem, columns, acting)
    # Squares: what is below zero is rounding, of causes that are far larger than what they leave.
    return {channel: np.maximum(np.sum((inverse @ own) * inverse, axis=1), 0.0) for channel, own in grams.items()}
