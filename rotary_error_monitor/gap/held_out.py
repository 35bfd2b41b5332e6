"""Whether causes predict conditions that had no part in sizing them, where more than they is at work.

On a stage or a machine tool a cause that leaves much behind is taken for a mere resemblance. There are M-open problems
(Bernardo and Smith, Bayesian Theory, 1994, section 6.1) in which no known effects explain everything: there a cause
is believed if conditions that were left out are predicted better with it than without it, by more than chance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.bounded import solve_within
from rotary_error_monitor.gap.fitting import Fit, change_bounds, fit_causes
from rotary_error_monitor.gap.problem import Conditions, Problem

RESAMPLES = 2000

UNNEEDED = 0.05
"""A cause is not believed if this part of the resampled blocks is predicted as well without it."""

_RIDGE = 1e-9


def held_out_squares(fit: Fit, conditions: Conditions, departing: NDArray[np.bool_] | None = None) -> Array:
    """(b,) squares of each block's rows, all that is fitted sized on the blocks of other conditions.

    Args:
        fit: causes with their departures.
        conditions: blocks of one label are held out together.
        departing: (q,) columns of departures that take part; by default all.
    """
    blocks, count, extra = fit.blocks, len(fit.nuisance_values), len(fit.departure_values)
    last = blocks.moment.shape[1] - extra
    prior = np.repeat([1.0, 0.0, 1.0], [count, last - count, extra])
    used = np.append(np.ones(last, bool), np.ones(extra, bool) if departing is None else departing)
    columns = np.flatnonzero(used)
    low, high = (bound[used] for bound in change_bounds(fit.causes, count, extra))
    left = np.empty(len(blocks.power))
    for label in np.unique(conditions.labels):
        test = conditions.labels == label
        train = blocks.total(~test)
        gram, moment = (train.gram + np.diag(prior))[np.ix_(columns, columns)], train.moment[columns]
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        inner = gram * np.outer(scale, scale) + _RIDGE * np.eye(len(gram))
        solved = scale * np.linalg.solve(inner, scale * moment)
        solved = solve_within(gram, moment, low, high, solved)
        left[test] = blocks.squares(columns, solved)[test]
    return left


def chance_of_no_better(squares: Array, others: Array) -> float:
    """Part of the resamplings of blocks (bootstrap) in which `squares` are in sum no smaller than `others`."""
    draws = np.random.default_rng(0).integers(0, len(squares), (RESAMPLES, len(squares)))
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
