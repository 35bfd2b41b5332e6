"""How far the gap shrinks when the causes are added to the twin, on data that had no part in sizing them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Role
from rotary_error_monitor.gap.bounded import solve_within
from rotary_error_monitor.gap.fitting import Fit
from rotary_error_monitor.gap.normal import BlockNormal, Normal
from rotary_error_monitor.gap.problem import Conditions

RESAMPLES = 1000

_WIDE = 100.0
"""Width of the prior of an amplitude in usual sizes: it only keeps an effect that a fold does not show at zero."""


@dataclass(frozen=True)
class Gap:
    """Root mean square of white rows: 1 is noise as the twin states it.

    Attributes:
        before: without the causes, the twin's uncertain parameters as the recording has them within their uncertainty.
        after: with the causes, fitted on the other conditions.
        noise_floor: what noise alone leaves.
        shrink: `(before - after) / (before - noise_floor)`; 0 where nothing was to shrink, and -1 where the causes make
            it worse by as much as was to shrink, or by more.
        interval: its 95 % interval, from resampled blocks.
        textbook: after, with the textbook forms of the causes alone; None where none of them departs.
    """

    before: float
    after: float
    noise_floor: float
    shrink: float
    interval: tuple[float, float]
    textbook: float | None = None

    @property
    def textbook_shrink(self) -> float | None:
        """Shrink by the textbook forms alone; None where no cause departs from its own."""
        return None if self.textbook is None else _shrink(self.before, self.textbook, self.noise_floor)


def measure_gap(fit: Fit, conditions: Conditions, floor: float | None = None) -> Gap:
    """Gap before and after the causes of a fit, each condition predicted from all the others.

    Args:
        fit: causes fitted; its blocks hold nuisances, then causes.
        conditions: blocks of one label are held out together.
        floor: root mean square of noise alone; by default what the fit leaves, which is noise if the causes are right.
    """
    amplitudes, widths = _amplitudes(fit)
    bounds = _bounds(fit)
    own = np.arange(len(amplitudes) - len(fit.departure_values))
    put_back = np.concatenate([amplitudes[own], np.zeros(len(fit.departure_values))])
    blocks = _calibrated(fit.blocks, fit.nuisance_values, put_back)
    before, after = blocks.power, _left(blocks, conditions, widths, bounds)
    expected = float(blocks.count.sum())
    dof = len(amplitudes)
    textbook = None
    if len(own) < dof:
        left = _left(blocks.reordered(own), conditions, widths[own], (bounds[0][own], bounds[1][own]))
        textbook = float(np.sqrt(left.sum() / expected))
    fitted = float(blocks.squares(np.arange(dof), amplitudes).sum())
    noise = fitted / max(expected - dof, 1.0) if floor is None else floor**2
    noise = min(noise, float(after.sum()) / expected)
    interval = _interval(before, after, noise * expected / max(float(after.sum()), 1e-300))
    rms = (np.sqrt(before.sum() / expected), np.sqrt(after.sum() / expected), np.sqrt(noise))
    shrink = _shrink(*map(float, rms)) if dof else 0.0
    return Gap(float(rms[0]), float(rms[1]), float(rms[2]), shrink, interval if dof else (0.0, 0.0), textbook)


def _left(blocks: BlockNormal, conditions: Conditions, widths: Array, bounds: tuple[Array, Array]) -> Array:
    """(b,) squares that all columns leave in each block, fitted on the blocks of the other conditions."""
    left = blocks.power.copy()
    for label in np.unique(conditions.labels):
        test = conditions.labels == label
        solved = _solve(blocks.total(~test), widths, bounds)
        left[test] = blocks.squares(np.arange(len(widths)), solved)[test]
    return left


class HeldOut:
    """Predictions of each condition from all the others, for many sets of columns."""

    def __init__(self, blocks: BlockNormal, conditions: Conditions) -> None:
        self._whole = blocks.total()
        self._parts = [blocks.total(conditions.labels == label) for label in np.unique(conditions.labels)]

    def rms(self, columns: NDArray[np.intp], prior: Array, bounds: tuple[Array, Array]) -> float:
        """Root mean square of held-out rows, the columns fitted on the other conditions.

        Args:
            columns: (p,) which of them.
            prior: (p,) prior precision of each.
            bounds: (p,) least and largest amplitude of each.
        """
        total, whole = 0.0, self._whole
        inner = np.ix_(columns, columns)
        for part in self._parts:
            gram = whole.gram[inner] - part.gram[inner] + np.diag(prior)
            scale = 1 / np.sqrt(np.diag(gram))
            moment = whole.moment[columns] - part.moment[columns]
            solved = scale * np.linalg.solve(gram * np.outer(scale, scale), scale * moment)
            solved = solve_within(gram, moment, *bounds, solved)
            fitted = float(solved @ part.gram[inner] @ solved)
            total += part.power - 2 * float(part.moment[columns] @ solved) + fitted
        return float(np.sqrt(max(total, 0.0) / whole.count))


def _shrink(before: float, after: float, floor: float) -> float:
    return max((before - after) / (before - floor), -1.0) if before > floor else 0.0


def _amplitudes(fit: Fit) -> tuple[Array, Array]:
    """Values of the columns of causes and departures, zero for shapes, and the widths of their priors."""
    values: list[float] = []
    widths: list[float] = []
    for cause in fit.causes:
        shapes = set(cause.effect.indices(Role.SHAPE))
        scales = cause.effect.scales()
        for index in cause.effect.indices(Role.LINEAR, Role.SHAPE):
            # A shape is known by a search over all data: it may not be moved far by the blocks that are left.
            values.append(0.0 if index in shapes else float(cause.values[index]))
            widths.append(
                float(np.sqrt(fit_variance(fit, cause.key, index))) if index in shapes else _WIDE * float(scales[index])
            )
    departing = fit.departure_values
    return np.concatenate([values, departing]), np.concatenate([widths, np.ones(len(departing))])


def _bounds(fit: Fit) -> tuple[Array, Array]:
    """Least and largest value of each column's amplitude; shapes are told by how far they are moved."""
    low, high = [np.zeros(0)], [np.zeros(0)]
    for cause in fit.causes:
        own, (least, largest) = cause.effect.indices(Role.LINEAR, Role.SHAPE), cause.effect.bounds()
        base = cause.values.copy()
        base[cause.effect.indices(Role.LINEAR)] = 0.0
        low.append(least[own] - base[own])
        high.append(largest[own] - base[own])
    free = np.full(len(fit.departure_values), np.inf)
    return np.concatenate([*low, -free]), np.concatenate([*high, free])


def fit_variance(fit: Fit, key: tuple[str, str], index: int) -> float:
    """Variance of one value of a cause of a fit."""
    for cause, covariance in zip(fit.causes, fit.covariances, strict=True):
        if cause.key == key:
            return float(max(covariance[index, index], 1e-300))
    raise KeyError(key)


def _calibrated(blocks: BlockNormal, nuisance_values: Array, put_back: Array) -> BlockNormal:
    """Equations of the columns of causes and departures for the data with the causes put back in, `put_back` of each
    column (departures were never taken out), and the twin's parameters as fitted.
    """
    count = len(nuisance_values)
    shift = np.concatenate([-nuisance_values, put_back])
    added = blocks.gram @ shift
    power = blocks.power + 2 * blocks.moment @ shift + added @ shift
    own = slice(count, count + len(put_back))
    return BlockNormal(blocks.gram[:, own, own], (blocks.moment + added)[:, own], power, blocks.count)


def _solve(train: Normal, widths: Array, bounds: tuple[Array, Array]) -> Array:
    gram = train.gram + np.diag(1 / np.square(widths))
    scale = 1 / np.sqrt(np.diag(gram))
    solved = np.asarray(scale * np.linalg.solve(gram * np.outer(scale, scale), scale * train.moment), np.float64)
    return solve_within(gram, train.moment, *bounds, solved)


def _interval(before: Array, after: Array, ratio: float) -> tuple[float, float]:
    """95 % interval of the shrink from blocks drawn with replacement (Efron's percentile bootstrap)."""
    draws = np.random.default_rng(0).integers(0, len(before), (RESAMPLES, len(before)))
    a, b = np.sqrt(before[draws].sum(axis=1)), np.sqrt(np.maximum(after[draws].sum(axis=1), 0.0))
    floor = b * np.sqrt(ratio)
    shrink = np.maximum(np.where(a > floor, (a - b) / np.where(a > floor, a - floor, 1.0), 0.0), -1.0)
    low, high = np.percentile(shrink, [2.5, 97.5])
    return float(low), float(high)
