"""How far the figures of an ISO 230-2 test may be from those of infinitely many runs of the same axis.

Readings at a target scatter normally about their mean. What the figures of infinitely many runs probably are is drawn
from the posterior of means and standard deviations, and each draw goes through the formulas of the figures themselves.
Most figures are extremes over the targets, and an extreme of noisy estimates lies too far out. Readings of all targets
together therefore tell how much targets differ at all: standard deviations are equal, or drawn from a scaled inverse
chi-square distribution (Smyth 2004, DOI 10.2202/1544-6115.1027, with its degrees of freedom unknown); means and
reversal errors are equal, or as found. Of what share of its variance an estimate keeps, all values are as
probable beforehand (uniform shrinkage prior: Daniels 1999, DOI 10.2307/3316152). The bias that is left is simulated.

The instrument's own error (its calibration, alignment, temperature) is alike in all runs, so readings do not show it.
It changes with the position alone: it moves E, M and A, and leaves R and B (ISO 230-2:2014, Annex A, ISO/TR 230-9).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import betaln, gammaln

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.positioning import COVERAGE, PositioningRuns

Interval = tuple[float, float]

DRAWS = 1000
"""Probable axes that are drawn: 20 lie above the upper bound, give or take 4."""

PART = 200
"""Draws that are made at once, so that a thousand targets need no more than some 50 MB."""

TAILS = 0.025, 0.98
"""Parts of the draws below either bound. The upper one is further out than 0.975, for targets that lie as far out as
their scatter hides are drawn in too far where their like is rare among the others."""

TAILS_OF_MEANS = 0.018, 0.988
"""The same of E and M, whose bias depends on how many targets come near their extremes, which noise hides."""

ABOVE_OF_MEAN = 0.98
"""Part of the draws below the upper bound of a mean over the targets, and above its lower one: scatter that differs
between targets is taken for equal where it hardly shows."""

BELOW_EQUAL = 0.04
"""Part of the draws below the lower bound if all targets are taken as equal. The lower bound is no higher than this,
else chance that looks like a difference between targets would raise it; the upper bound then hardly ever fails."""

RANGES = ("systematic_deviation", "mean_deviation_range", "accuracy")
"""Figures that are ranges along the travel, by the ends of their names; the first two are ranges of means."""

REFUTED = 0.01
"""Probability below which targets are not equal: equal ones seem so in no more than 1 of 100 tests."""

_EDGES = np.concatenate([[0.0], np.geomspace(1e-7, 0.1, 5), np.linspace(0.25, 1.0, 6)])
SHARES, PROBABLE = (_EDGES[1:] + _EDGES[:-1]) / 2, np.diff(_EDGES)
"""Shares of its variance that shrinkage takes from an estimate, which are tried, and how probable each is beforehand.
The least are for axes whose errors are thousands of times their scatter."""

SCALES = 53
"""Values that are tried for the common standard deviation."""

LEAST_VARIANCE = 1e-4
"""Part of the mean variance below which that of a target is rounding of its readings."""


@dataclass(frozen=True)
class DirectionBounds:
    """95 % intervals of unidirectional figures, m or rad."""

    repeatability: Interval
    systematic_deviation: Interval
    accuracy: Interval


@dataclass(frozen=True)
class BidirectionalBounds:
    """95 % intervals of bidirectional figures, m or rad."""

    reversal_error: Interval
    mean_reversal_error: Interval
    repeatability: Interval
    systematic_deviation: Interval
    mean_deviation_range: Interval
    accuracy: Interval


@dataclass(frozen=True)
class PositioningBounds:
    """95 % intervals of what ISO 230-2 says of an axis; a unidirectional test has `forward` alone."""

    forward: DirectionBounds
    backward: DirectionBounds | None
    bidirectional: BidirectionalBounds | None


@dataclass(frozen=True)
class _Way:
    """Means, variances of a reading and counts (m,) of one direction."""

    mean: Array
    variance: Array
    count: Array


def bound_positioning(runs: PositioningRuns, instrument: float = 0.0) -> PositioningBounds:
    """95 % intervals for the figures that infinitely many runs would give; the same for the same readings.

    `instrument` is the standard uncertainty of the instrument's difference between two positions of the travel, m or
    rad. Some 93 of 100 intervals or more hold the truth where the scatter of targets comes from one
    distribution. Of a single target with three times the scatter of all others five runs tell too little: there the
    upper bounds of R hold it less often.
    """
    blocks = [runs.forward] if runs.backward is None else [runs.forward, runs.backward]
    ways = [
        _Way(np.nanmean(v, axis=1), np.nanvar(v, axis=1, ddof=1), np.isfinite(v).sum(axis=1).astype(np.float64))
        for v in blocks
    ]
    drawn, equal = (_figures(_drawn(ways, equal=equal), instrument) for equal in (False, True))
    found = {
        name: (
            float(min(np.quantile(values, _tails(name)[0]), np.quantile(equal[name], BELOW_EQUAL))),
            float(np.quantile(values, _tails(name)[1])),
        )
        for name, values in drawn.items()
    }
    if len(ways) == 1:
        return PositioningBounds(_direction(found, "forward"), None, None)
    low, high = np.quantile(drawn["mean_reversal_error"], [1 - ABOVE_OF_MEAN, ABOVE_OF_MEAN])
    found["mean_reversal_error"] = float(low), float(high)
    # the largest reversal error is no smaller than that of targets that are alike, whatever they are
    found["reversal_error"] = (
        float(np.quantile(equal["reversal_error"], BELOW_EQUAL)),
        found["reversal_error"][1],
    )
    names = BidirectionalBounds.__dataclass_fields__
    return PositioningBounds(
        _direction(found, "forward"),
        _direction(found, "backward"),
        BidirectionalBounds(**{name: found[name] for name in names}),
    )


def _tails(name: str) -> Interval:
    return TAILS_OF_MEANS if name.endswith(RANGES[:2]) else TAILS


def _direction(found: dict[str, Interval], way: str) -> DirectionBounds:
    return DirectionBounds(**{name: found[f"{way}_{name}"] for name in DirectionBounds.__dataclass_fields__})


@dataclass(frozen=True)
class _Draws:
    """Probable standard deviations (d, m) by direction, and means (d, m): of both ways together, and of each by itself.

    `still` and `still_alone` are such means without the noise of readings at single targets, `mean_reversal` (d,) the
    mean reversal error; 0 of one way.
    """

    spread: list[Array]
    means: list[Array]
    still: list[Array]
    alone: list[Array]
    still_alone: list[Array]
    mean_reversal: Array


def _drawn(ways: list[_Way], *, equal: bool) -> Iterator[_Draws]:
    """The draws, part by part; with `equal` of targets that are alike unless that is refuted."""
    rng = np.random.default_rng(0)
    targets = len(ways[0].mean)
    variances = _draw_variances(ways, equal, rng)
    for start in range(0, DRAWS, PART):
        part = variances[start : start + PART]
        noise = [part[:, k * targets : (k + 1) * targets] / way.count for k, way in enumerate(ways)]
        spread = [np.sqrt(square * way.count) for square, way in zip(noise, ways, strict=True)]
        each = [_draw_profiles(way.mean, square, rng) for way, square in zip(ways, noise, strict=True)]
        alone, still_alone = [one[0] for one in each], [one[1] for one in each]
        means, still, mean_reversal = alone, still_alone, np.zeros(len(part))
        if len(ways) == 2:
            there, back = ways[0].mean, ways[1].mean
            total = noise[0] + noise[1]
            reversal, plain = _draw_profiles(there - back, total, rng, equal=equal)
            # errors of the mean of both ways go with those of their difference where one way scatters more
            along = (noise[0] - noise[1]) / (2 * total) if noise[0].any() else np.zeros_like(total)
            middle = (there + back) / 2 - along * (there - back - reversal)
            mean, rest = _draw_profiles(middle, total / 4 - along**2 * total, rng)
            means = [mean + reversal / 2, mean - reversal / 2]
            still = [rest + plain / 2, rest - plain / 2]
            mean_reversal = (there - back).mean() + np.sqrt(total.sum(axis=1)) / targets * rng.normal(size=len(part))
        yield _Draws(spread, means, still, alone, still_alone, mean_reversal)


def _draw_variances(ways: list[_Way], equal: bool, rng: np.random.Generator) -> Array:
    """(DRAWS, groups) probable variances of a reading, of all targets and directions."""
    freedom = np.concatenate([way.count for way in ways]) - 1
    found = np.concatenate([way.variance for way in ways])
    middle = float(freedom @ found) / float(freedom.sum())
    if middle == 0:
        return np.zeros((DRAWS, found.size))
    found = np.maximum(found, LEAST_VARIANCE * middle)
    # log-spaced round the mean variance: single targets far out may hold most of it
    scales = middle * np.exp(np.linspace(-2.5, 1.5, SCALES))
    prior = freedom.mean() * (1 - SHARES) / SHARES
    ratio = found / scales[:, None]
    half = freedom / 2
    same = (half * np.log(half * ratio) - half * ratio - gammaln(half)).sum(axis=1)
    own = prior[:, None, None]
    differing = (
        half * np.log(freedom / own * ratio)
        - betaln(half, own / 2)
        - (freedom + own) / 2 * np.log1p(freedom * ratio / own)
    ).sum(axis=2)
    # equal or not: both as probable beforehand
    log = np.concatenate([same, (differing + np.log(PROBABLE)[:, None]).ravel()])
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    if equal and weight[: scales.size].sum() >= REFUTED:
        together = middle * freedom.sum() / rng.chisquare(freedom.sum(), size=(DRAWS, 1))
        return np.asarray(np.broadcast_to(together, (DRAWS, found.size)))
    chosen = rng.choice(log.size, size=DRAWS, p=weight)
    result = np.empty((DRAWS, found.size))
    alike = chosen < scales.size
    result[alike] = scales[chosen[alike], None]
    which, scale = np.unravel_index(chosen[~alike] - scales.size, differing.shape)
    above = (prior[which] * scales[scale])[:, None] + freedom * found
    result[~alike] = above / rng.chisquare(prior[which][:, None] + freedom)
    return result


def _draw_profiles(found: Array, noise: Array, rng: np.random.Generator, *, equal: bool = False) -> tuple[Array, Array]:
    """(d, m) probable means with the noise of the readings, and the same without; `found` is (m,) or (d, m).

    They are equal, or as found: errors of an axis follow curves whose extremes no distribution of all targets knows.
    With `equal` they are equal unless that is refuted.
    """
    values = np.broadcast_to(found, noise.shape)
    if not noise.any():
        return values, values
    probable, middle, deviation = _weigh_equality(values, noise)
    alike = rng.uniform(size=(len(noise), 1)) < probable[:, None]
    if equal and probable.mean() >= REFUTED:
        alike[:] = True
    common = (middle + deviation * rng.normal(size=len(noise)))[:, None]
    drawn = values + np.sqrt(noise) * rng.normal(size=noise.shape)
    return np.where(alike, common, drawn), np.where(alike, common, values)


def _weigh_equality(values: Array, noise: Array) -> tuple[Array, Array, Array]:
    """How probable it is that values (d, m) with variances `noise` are equal and do not scatter normally.

    Gives that probability, and of the value that they have in common the mean and standard deviation, each (d,).
    """
    usual = 1 / np.mean(1 / noise, axis=1, keepdims=True)
    scatter = np.concatenate([np.zeros_like(usual), usual * (1 - SHARES) / SHARES], axis=1)
    variance = scatter[:, :, None] + noise[:, None]
    weight = 1 / variance
    total = weight.sum(axis=-1)
    common = (weight * values[:, None]).sum(axis=-1) / total
    square = (weight * np.square(values[:, None] - common[:, :, None])).sum(axis=-1)
    # equal or not: both as probable beforehand
    log = -0.5 * (np.log(variance).sum(axis=-1) + square + np.log(total)) + np.log(np.append(1.0, PROBABLE))
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return share[:, 0] / share.sum(axis=1), common[:, 0], np.sqrt(1 / total[:, 0])


def _figures(drawn: Iterator[_Draws], instrument: float) -> dict[str, Array]:
    """(DRAWS,) of each figure, by name.

    Noise that is drawn beside that of the readings makes a range larger once more. By how much, the same draws tell
    without it; the noise of the readings has done as much (Davison and Hinkley, Bootstrap Methods and their
    Application, 1997, Section 5.2.1), so it is taken off twice.
    """
    parts, reversals = [], []
    for part in drawn:
        both = ((part.means, part.alone), (part.still, part.still_alone))
        parts.append([_figures_of(part.spread, *each) for each in both])
        reversals.append(part.mean_reversal)
    moved = instrument * np.random.default_rng(1).normal(size=DRAWS)
    result = {"mean_reversal_error": np.concatenate(reversals)}
    for name in parts[0][0]:
        values = np.concatenate([part[0][name] for part in parts])
        without = np.concatenate([part[1][name] for part in parts])
        values = values - 2 * (values - without).mean()
        if name.endswith(RANGES):
            values = values + moved
        result[name] = np.maximum(values, 0.0)
    return result


def _figures_of(spread: list[Array], means: list[Array], alone: list[Array]) -> dict[str, Array]:
    """Figures of draws, as `positioning` has them of readings; `alone` are means by the readings of their way alone."""
    found = {}
    for name, mean, one in zip(("forward", "backward"), alone, spread, strict=False):
        margin = COVERAGE * one
        found[f"{name}_repeatability"] = 2 * margin.max(axis=1)
        found[f"{name}_systematic_deviation"] = np.ptp(mean, axis=1)
        found[f"{name}_accuracy"] = (mean + margin).max(axis=1) - (mean - margin).min(axis=1)
    if len(means) == 1:
        return found
    both, margins = np.stack(means), COVERAGE * np.stack(spread)
    reversal = both[0] - both[1]
    across = np.maximum(margins.sum(axis=0) + np.abs(reversal), 2 * margins.max(axis=0))
    return found | {
        "reversal_error": np.abs(reversal).max(axis=1),
        "repeatability": across.max(axis=1),
        "systematic_deviation": np.max(both, axis=(0, 2)) - both.min(axis=(0, 2)),
        "mean_deviation_range": np.ptp(both.mean(axis=0), axis=1),
        "accuracy": (both + margins).max(axis=(0, 2)) - (both - margins).min(axis=(0, 2)),
    }
