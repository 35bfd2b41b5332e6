"""Whether the uncertain parameters of a twin had to be moved further than their uncertainty allows."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.p_values import log_chi_square_tail, log_normal_tail
from rotary_error_monitor.gap.problem import Finding, Problem


def find_prior_conflict(fit: Fit) -> list[Finding]:
    """Tests of the twin's uncertain parameters: moved further than their uncertainty allows, together or one alone.

    A strong effect that resembles a parameter is taken up by it and leaves nothing in the rows; here it shows. Fitted
    values scatter less than their prior, so the tests hold their level.
    """
    moved = fit.nuisance_values
    if len(moved) == 0:
        return []
    together = float(np.sum(np.square(moved)))
    furthest = float(np.max(np.abs(moved)))
    alone = min(0.0, log_normal_tail(furthest) + float(np.log(2 * len(moved))))
    words = "twin: parameters beyond their uncertainty"
    return [
        Finding(
            "twin", "parameters", log_chi_square_tail(together, len(moved)), max(0.0, together - len(moved)), words
        ),
        Finding("twin", "parameter", alone, max(0.0, furthest**2 - 1), words),
    ]


def find_left(problem: Problem, fit: Fit) -> list[Finding]:
    """All that a fit leaves, the least likely first."""
    return sorted([*problem.structure(fit.rest), *find_prior_conflict(fit)], key=lambda finding: finding.log_p_value)
