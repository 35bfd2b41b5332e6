"""What the readings of one run of an ISO 230-2 test have in common, told from what scatters at each target alone.

A run drifts as a whole: the machine or the instrument warms between runs, and the scale grows. So a cycle adds the same
to all its readings, or what rises along the travel, alike both ways or opposite (a drift within the cycle). Such
effects are patterns p over targets and directions, of unit length:

    reading = mean + sum_p p score_p(cycle) + own,    score_p ~ N(0, λ_p)

They make the standard deviation at each target larger, but all targets together: differences between targets and
directions, of which E, M and B are made, are off by what the patterns change in them, and not by the whole scatter. The
sum of squares of the scores of a pattern is one of n - 1 degrees of freedom, of the variance λ_p and what own scatter
adds (JCGM 100:2008, H.5: analysis of variance). Whether λ_p is 0 is told by its posterior probability, beside a λ_p of
which the share in the variance of a score may be anything (uniform shrinkage prior: Daniels 1999, DOI 10.2307/3316152).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rotary_error_monitor.arrays import Array

FEWEST_TARGETS = 4
"""Targets of which a pattern that rises along them leaves something to tell own scatter by."""

PRESENT = 0.5
"""Probability from which an effect is taken off the readings before their own scatter is told."""

ROUNDS = 20
"""Of means and effects in turn, where targets were left out; without gaps one is exact."""

LARGEST_RATIO = 1e6
"""Of mean squares: what is larger is certain, and its likelihood need not overflow."""

_SHARES = (np.arange(200) + 0.5) / 200


@dataclass(frozen=True)
class RunEffects:
    """Effects of runs beside the readings' own scatter.

    Attributes:
        patterns: (p, w, m) by direction and target, of unit length.
        present: (p,) probability that there is such an effect.
        square: (p,) mean square of its scores over the cycles, m² or rad².
        base: (p,) what own scatter has in it.
        cycles: (p,) cycles that tell it.
        means: (w, m) of readings without the effects that are present; where no target was left out of the readings.
        variance: (w, m) of a reading about them, own scatter alone.
        freedom: (w, m) its degrees of freedom.
    """

    patterns: Array
    present: Array
    square: Array
    base: Array
    cycles: Array
    means: Array
    variance: Array
    freedom: Array

    def draw(self, draws: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Probable errors of the means, and variances of a reading, by what runs have in common: (w, draws, m) each."""
        size, freedom = (draws, len(self.present)), np.maximum(self.cycles - 1, 1)
        there = rng.random(size) < self.present
        variance = np.where(
            there, np.maximum(self.square * freedom / rng.chisquare(freedom, size) - self.base, 0.0), 0.0
        )
        scores = rng.normal(size=size) * np.sqrt(variance / np.maximum(self.cycles, 1))
        errors = np.einsum("dp,pwm->wdm", scores, self.patterns)
        # own scatter has in it what was not taken off
        taken = np.where(self.present >= PRESENT, variance, 0.0)
        return errors, np.einsum("dp,pwm->wdm", taken, np.square(self.patterns))


def find_run_effects(targets: Array, blocks: Sequence[Array], least: float = PRESENT) -> RunEffects:
    """Effects of runs over targets (m,) in readings (m, n) of each direction; NaN marks a reading that is not there.

    Effects are taken off the readings that are as probable as `least`; where that is more than one half, none is held
    possible that is less so. Of fewer than four targets, or readings without any scatter, there are none.
    """
    readings = np.stack(blocks)
    patterns = _patterns(targets, len(blocks)) if len(targets) >= FEWEST_TARGETS else np.zeros((0, *readings.shape[:2]))
    nothing = np.zeros(len(patterns))
    found = _with(readings, patterns, nothing, nothing)
    if not found.variance.any() or not len(patterns):
        return _with(readings, patterns[:0], nothing[:0], nothing[:0])
    taken = np.ones(len(patterns), dtype=bool)
    scores = _scores(readings - found.means[..., None], patterns)
    for _ in range(2):  # by the scatter that all of them leave at most, then by what those that are there leave
        known = _with(readings, patterns, nothing, taken)
        base = np.einsum("pwm,wm->p", np.square(patterns), known.variance)
        square, cycles = _mean_squares(scores)
        present = _probability(square, base, cycles - 1)
        taken = present >= least
    found = _with(readings, patterns, nothing, taken)
    present = np.where(taken | (least <= PRESENT), present, 0.0)
    return RunEffects(patterns, present, square, base, cycles, found.means, found.variance, found.freedom)


def _patterns(targets: Array, ways: int) -> Array:
    """(p, w, m): the same at all targets and rising along them; of two directions alike and opposite."""
    rising = targets - targets.mean()
    along = np.stack([np.full(len(targets), len(targets) ** -0.5), rising / np.linalg.norm(rising)])
    signs = np.array([[1.0]]) if ways == 1 else np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)
    return np.asarray(np.einsum("sw,am->sawm", signs, along).reshape(-1, ways, len(targets)))


def _scores(residual: Array, patterns: Array) -> Array:
    """(p, n) least squares by cycle; NaN where a cycle has too few readings to tell all patterns."""
    scores = np.full((len(patterns), residual.shape[2]), np.nan)
    for cycle in range(residual.shape[2]):
        there = np.isfinite(residual[..., cycle])
        columns = patterns[:, there].T
        if len(patterns) and np.linalg.matrix_rank(columns) == len(patterns):
            scores[:, cycle] = np.linalg.lstsq(columns, residual[there, cycle], rcond=None)[0]
    return scores


def _mean_squares(scores: Array) -> tuple[Array, Array]:
    """(p,) variance of scores (p, n) over the cycles, and how many these are."""
    cycles = np.isfinite(scores).sum(axis=1).astype(np.float64)
    centred = scores - np.nanmean(scores, axis=1, keepdims=True) if cycles.min() > 1 else np.zeros_like(scores)
    return np.nansum(np.square(centred), axis=1) / np.maximum(cycles - 1, 1), cycles


def _probability(square: Array, base: Array, freedom: Array) -> Array:
    """(p,) that scores of this mean square have more in them than own scatter; beforehand one half."""
    ratio = np.minimum(square / np.maximum(base, np.finfo(float).tiny), LARGEST_RATIO)
    half = freedom[:, None] / 2
    log = half * np.log(_SHARES) + half * ratio[:, None] * (1 - _SHARES)
    more = logsumexp(log, axis=1) - np.log(len(_SHARES))
    return np.asarray(np.where(freedom > 0, 1 / (1 + np.exp(-np.clip(more, -50, 50))), 0.0))


def _with(readings: Array, patterns: Array, nothing: Array, taken: Array) -> RunEffects:
    """Means and own scatter, with the patterns that are taken off."""
    used = patterns[taken.astype(bool)]
    counts = np.isfinite(readings).sum(axis=2).astype(np.float64)
    left = readings
    for _ in range(ROUNDS if len(used) and np.isnan(readings).any() else 1):
        scores = np.nan_to_num(_scores(readings - np.nanmean(left, axis=2, keepdims=True), used))
        scores -= scores.mean(axis=1, keepdims=True)
        left = readings - np.einsum("pn,pwm->wmn", scores, used)
    means = np.nanmean(left, axis=2)
    square = np.nansum(np.square(left - means[..., None]), axis=2)
    freedom = (counts - 1) * (1 - np.square(used).sum(axis=0))
    return RunEffects(patterns, nothing, nothing, nothing, nothing, means, square / freedom, freedom)
