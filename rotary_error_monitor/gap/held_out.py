"""Whether causes predict conditions that had no part in sizing them, where more than they is at work.

On a stage or a machine tool a cause that leaves much behind is taken for a mere resemblance. There are M-open problems
(Bernardo and Smith, Bayesian Theory, 1994, section 6.1), such as a telescope mount against the sky, in which no known
effects ever explain everything: there a cause is believed if conditions that were left out are predicted better with
it than without it, by more than chance.
"""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.gap.bounded import solve_within
from rotary_error_monitor.gap.fitting import Fit, change_bounds, fit_causes
from rotary_error_monitor.gap.problem import Array, Conditions, Problem

RESAMPLES = 2000

UNNEEDED = 0.05
"""A cause is not believed if this part of the resampled blocks is predicted as well without it."""

_RIDGE = 1e-9


def held_out_squares(fit: Fit, conditions: Conditions) -> Array:
    """(b,) squares of each block's rows, nuisances and causes fitted on the blocks of other conditions."""
    blocks, count = fit.blocks, len(fit.nuisance_values)
    columns = np.arange(blocks.moment.shape[1], dtype=np.intp)
    prior = np.where(columns < count, 1.0, 0.0)
    bounds = change_bounds(fit.causes, count)
    left = np.empty(len(blocks.power))
    for label in np.unique(conditions.labels):
        test = conditions.labels == label
        train = blocks.total(~test)
        gram = train.gram + np.diag(prior)
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        inner = gram * np.outer(scale, scale) + _RIDGE * np.eye(len(gram))
        solved = scale * np.linalg.solve(inner, scale * train.moment)
        solved = solve_within(gram, train.moment, *bounds, solved)
        left[test] = blocks.squares(columns, solved)[test]
    return left


def chance_of_no_better(squares: Array, others: Array, seed: int = 0) -> float:
    """Part of the resamplings of blocks (bootstrap) in which `squares` are in sum no smaller than `others`."""
    draws = np.random.default_rng(seed).integers(0, len(squares), (RESAMPLES, len(squares)))
    return float(np.mean((others - squares)[draws].sum(axis=1) <= 0))


def predicts(problem: Problem, fit: Fit) -> bool:
    """Whether every cause of a fit is needed to predict what was left out."""
    squares = held_out_squares(fit, problem.conditions)
    for i in range(len(fit.causes)):
        fewer = fit_causes(problem, (*fit.causes[:i], *fit.causes[i + 1 :]))
        if chance_of_no_better(squares, held_out_squares(fewer, problem.conditions)) > UNNEEDED:
            return False
    return bool(fit.causes)


def dispersion(fit: Fit) -> float:
    """How many times the squares that a fit leaves are those of noise; at least 1.

    Evidence that weighs all of that as noise is divided by it (quasi-likelihood: McCullagh and Nelder 1989, chapter 9).
    """
    dof = max(float(fit.blocks.count.sum()) - fit.blocks.moment.shape[1], 1.0)
    return float(max(1.0, fit.squares / dof))
