"""Sizing of chosen causes: Gauss-Newton steps on all their free values and the twin's uncertain parameters together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.bounded import solve_within
from rotary_error_monitor.gap.departures import Departures, WithSlowNoise
from rotary_error_monitor.gap.normal import (
    BlockNormal,
    Normal,
    acting_on,
    combine,
    grams_by_channel,
    own_products,
    solve_scaled,
    stack,
    subtract,
    width_of,
)
from rotary_error_monitor.gap.problem import Columns, LateRows, Problem, Rows, SparseRows
from rotary_error_monitor.twin.finite import UnpredictableError

MOST_STEPS = 6
_SETTLED = 1e-2
"""A step that takes less than this off the sum of squares changes nothing that anyone could see."""

_NEARLY_SETTLED = 1.0
"""The same for a fit that another one starts from."""

MOST_HALVINGS = 10
"""Halvings of a step to sizes that the twin cannot predict: what is left of it then changes nothing."""


@dataclass(frozen=True)
class Fit:
    """Causes as fitted, beside the twin's parameters within their uncertainty.

    Attributes:
        causes: with their values.
        covariances: of the values of each cause.
        data: white rows of measured minus predicted, with the causes and the twin's parameters as stated; empty once
            they are not needed any more.
        nuisance: white columns of the uncertain parameters, at these causes.
        nuisance_values: how far each is moved, in standard uncertainties.
        columns: white columns of the causes' free values, at these values.
        rest: white rows when the fitted nuisances are taken out as well.
        blocks: normal equations with `data`, columns nuisances, then causes, then departures.
        departures: ways in which the causes depart from their textbook form.
        departure_values: how far each departs, in standard deviations of its prior.
        log_prior: logarithm of the prior of the kinds of departure that were chosen.
        sizes: products of the columns of causes and departures with one another as they would be without slow noise;
            None where those in `blocks` are.
        proportional: log odds of what is proportional to a quantity in the place of each cause that departs
            (`proportion.py`); empty where none does.
    """

    causes: tuple[Cause, ...]
    covariances: tuple[Array, ...]
    data: Rows
    nuisance: Columns
    nuisance_values: Array
    columns: tuple[Columns, ...]
    rest: Rows
    blocks: BlockNormal
    departures: tuple[Departures, ...] = ()
    departure_values: Array = field(default_factory=lambda: np.zeros(0))
    log_prior: float = 0.0
    sizes: Array | None = None
    proportional: tuple[float, ...] = ()

    @property
    def squares(self) -> float:
        """Sum of squares of what is left, with the price of moving the nuisances and of departing."""
        left = sum(float(np.sum(np.square(rows))) for rows in self.rest.values())
        return left + float(np.sum(self.nuisance_values**2) + np.sum(self.departure_values**2))

    def without_data(self) -> Fit:
        """The same without `data`: those of several fits of a long recording would fill the memory."""
        return replace(self, data={})


@dataclass(frozen=True)
class KnownProducts:
    """What is known of normal equations before a fit.

    Attributes:
        nuisance: columns of the uncertain parameters.
        gram: (b, q, q) products in each block of those, and of the columns of departures, with one another.
    """

    nuisance: Columns
    gram: Array

    def beside(self, nuisance: Columns, problem: Problem) -> Array | None:
        """The products, where they are of these columns and of the problem's own blocks."""
        fits = nuisance is self.nuisance and len(self.gram) == len(problem.conditions.labels)
        return self.gram if fits else None


def fit_causes(
    problem: Problem,
    causes: Sequence[Cause],
    near: Fit | None = None,
    departures: Sequence[Departures] = (),
    known: KnownProducts | None = None,
) -> Fit:
    """Size the causes from where they start, within the bounds of their parameters.

    Args:
        problem: recording beside twin.
        causes: effects with first values; those beyond their bounds are put at them.
        near: a fit whose columns of the uncertain parameters are near enough for a start; they hardly depend on the
            causes.
        departures: ways in which the causes may depart from their textbook form.
        known: products that need not be summed again.

    Raises:
        UnpredictableError: the twin gives numbers that are not finite, of whatever size the causes are.
    """
    at_zero = tuple(_without_size(cause) for cause in causes)
    fitted, data = _predictable(problem, at_zero, tuple(c.with_values(c.effect.held(c.values)) for c in causes))
    uncertain = problem.nuisance(fitted) if near is None else near.nuisance
    count = width_of(uncertain)
    departing = [d.columns for d in departures]
    extra = sum(map(width_of, departing))
    # Columns that stay as they are from step to step come first: their products with one another are summed once.
    fixed = [uncertain, *departing]
    leading = _leading(problem, uncertain, near, known)
    settled = _SETTLED if near is None else _NEARLY_SETTLED
    for step in range(MOST_STEPS + 1):
        columns = tuple(_columns(problem, fitted))
        stacked = stack(problem, data, [*fixed, *columns], leading)
        leading = stacked.gram[:, : count + extra, : count + extra]
        last = len(stacked.moment[0]) - extra
        order = np.r_[:count, count + extra : last + extra, count : count + extra]
        total, gram, change, covariance = _solved(stacked.total().reordered(order), fitted, count, extra)
        if step == MOST_STEPS or not fitted or _gain(change[count:last], covariance[count:last, count:last]) < settled:
            break
        fitted, data = _predictable(problem, fitted, _moved(fitted, change[count:last]))
    spread = _spread(fitted, covariance[count:last, count:last])
    # Beside the causes as they are, not as the last step, which was not taken, would have them.
    beside = np.r_[:count, last : len(gram)]
    moved = np.split(solve_scaled(gram[np.ix_(beside, beside)], total.moment[beside]), [count])
    rest = _left(problem, data, fixed, [moved[0], *_split(moved[1], departing)])
    blocks = stacked.reordered(order) if extra else stacked
    sizes = _sizes(problem, columns, departing) if departing else None
    return Fit(
        fitted, spread, data, uncertain, moved[0], columns, rest, blocks, tuple(departures), moved[1], sizes=sizes
    )


def _leading(problem: Problem, uncertain: Columns, near: Fit | None, known: KnownProducts | None) -> Array | None:
    """Products of the columns of the uncertain parameters with one another, summed where nothing has them.

    None as `own_products`.
    """
    found = None if known is None else known.beside(uncertain, problem)
    if found is not None:
        return found
    count = width_of(uncertain)
    return own_products(problem, uncertain) if near is None else near.blocks.gram[:, :count, :count]


def _solved(total: Normal, fitted: Sequence[Cause], count: int, extra: int) -> tuple[Normal, Array, Array, Array]:
    """The normal equations, their matrix with the priors, the change that solves them, and its covariance.

    Those of `count` uncertain parameters come first, then the values of the causes, then `extra` departures.
    """
    gram = total.gram + np.diag(np.repeat([1.0, 1e-12, 1.0], [count, len(total.gram) - count - extra, extra]))
    solved = solve_scaled(gram, np.column_stack([total.moment, np.eye(len(gram))]))
    return total, gram, _held(fitted, count, gram, total.moment, solved[:, 0]), solved[:, 1:]


def _left(problem: Problem, data: Rows, columns: Sequence[Columns], sizes: Sequence[Array]) -> Rows:
    """Data without what columns of these sizes take of it."""
    return subtract(data, combine(problem, columns, sizes)) if any(map(width_of, columns)) else data


def stacked_beside(problem: Problem, fit: Fit, columns: Sequence[Columns]) -> BlockNormal:
    """Normal equations of all that is fitted, and then of columns; of a long recording as one block."""
    fitted = [fit.nuisance, *fit.columns, *(d.columns for d in fit.departures)]
    if isinstance(fit.nuisance, LateRows):  # those of all blocks would fill the memory
        known = fit.blocks.gram.sum(axis=0)[None]
        return stack(problem, fit.data, [*fitted, *columns], known, problem.conditions.as_one())
    return stack(problem, fit.data, [*fitted, *columns], fit.blocks.gram)


def _sizes(problem: Problem, columns: Sequence[Columns], departing: Sequence[Columns]) -> Array | None:
    """Products of columns as they would be without slow noise: that weighs what is slow of a cause down, and so would
    make of a departure that comes and goes a larger part of it than it is.
    """
    if not isinstance(problem, WithSlowNoise):
        return None
    both = [*columns, *departing]
    plain = [problem.without_slow_noise(rows) for rows in both]
    if all(rows is None for rows in plain):
        return None
    shown = [rows if own is None else own for own, rows in zip(plain, both, strict=True)]
    channels = {channel for rows in shown for channel in acting_on(rows)}
    return np.asarray(sum(grams_by_channel(problem, shown, channels).values()), np.float64)


def _split(values: Array, columns: Sequence[Columns]) -> list[Array]:
    return np.split(values, np.cumsum([width_of(rows) for rows in columns])[:-1].astype(np.intp)) if columns else []


def _gain(step: Array, covariance: Array) -> float:
    """What a step takes off the sum of squares, to second order: its square in standard deviations."""
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    return float(step / scale @ np.linalg.lstsq(correlation, step / scale, rcond=1e-10)[0])


def _free(cause: Cause) -> list[int]:
    return cause.effect.indices(Role.LINEAR, Role.SHAPE)


def _columns(problem: Problem, causes: Sequence[Cause]) -> list[Columns]:
    found = [problem.signature(cause, _free(cause), causes) for cause in causes]
    # What shows nowhere has no rows, but its place.
    empty = [SparseRows(len(_free(cause)), {}, {}) for cause in causes]
    return [rows if width_of(rows) else none for rows, none in zip(found, empty, strict=True)]


def _without_size(cause: Cause) -> Cause:
    values = cause.effect.held(cause.values)
    values[cause.effect.indices(Role.LINEAR)] = 0.0
    return cause.with_values(values)


def _predictable(
    problem: Problem, before: tuple[Cause, ...], after: tuple[Cause, ...]
) -> tuple[tuple[Cause, ...], Rows]:
    """The causes after a step, which is halved until the twin can predict them, and the rows that they leave."""
    for _ in range(MOST_HALVINGS):
        try:
            return after, problem.residual(after)
        except UnpredictableError:
            halves = (0.5 * (old.values + new.values) for old, new in zip(before, after, strict=True))
            after = tuple(cause.with_values(cause.effect.held(v)) for cause, v in zip(after, halves, strict=True))
    return before, problem.residual(before)


def change_bounds(causes: Sequence[Cause], nuisances: int, departures: int) -> tuple[Array, Array]:
    """Least and largest change (nuisances + k + departures,) of each column; causes' free values alone have bounds."""
    low, high = [np.full(nuisances, -np.inf)], [np.full(nuisances, np.inf)]
    for cause in causes:
        free, (least, largest) = _free(cause), cause.effect.bounds(cause.values)
        low.append(np.minimum(least[free] - cause.values[free], 0.0))
        high.append(np.maximum(largest[free] - cause.values[free], 0.0))
    free_of_bounds = np.full(departures, np.inf)
    return np.concatenate([*low, -free_of_bounds]), np.concatenate([*high, free_of_bounds])


def _held(causes: Sequence[Cause], nuisances: int, gram: Array, moment: Array, change: Array) -> Array:
    """The change that keeps the causes within their bounds; the others make up for what is held."""
    departures = len(change) - nuisances - sum(len(_free(cause)) for cause in causes)
    return solve_within(gram, moment, *change_bounds(causes, nuisances, departures), change)


def _moved(causes: Sequence[Cause], change: Array) -> tuple[Cause, ...]:
    place, moved = 0, []
    for cause in causes:
        free = _free(cause)
        values = cause.values.copy()
        values[free] += change[place : place + len(free)]
        place += len(free)
        moved.append(cause.with_values(cause.effect.held(values)))
    return tuple(moved)


def _spread(causes: Sequence[Cause], covariance: Array) -> tuple[Array, ...]:
    place, spreads = 0, []
    for cause in causes:
        free = _free(cause)
        spread = np.zeros((len(cause.values), len(cause.values)))
        part = slice(place, place + len(free))
        spread[np.ix_(free, free)] = covariance[part, part]
        place += len(free)
        spreads.append(spread)
    return tuple(spreads)
