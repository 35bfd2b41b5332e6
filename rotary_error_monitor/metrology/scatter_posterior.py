"""What the standard deviations of an ISO 230-2 test probably are, told from the readings of all targets together.

Readings scatter normally about the mean of their target and direction. There are three models: one variance for all,
one for each direction, or, the most general, one for each target and direction from a scaled inverse chi-square
distribution whose degrees of freedom are unknown (Smyth 2004, DOI 10.2202/1544-6115.1027). Of what
share the prior takes of an estimate, all values are as probable beforehand (uniform shrinkage prior: Daniels 1999,
DOI 10.2307/3316152); scales are log-uniform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import betaln, gammaln, logsumexp

from rotary_error_monitor.arrays import Array

REFUTED = 0.01
"""Probability, beside the most general model, below which a simpler one is refuted. If it is true that happens in no
more than 1 of 100 tests, whatever the axis (Royall 2000, DOI 10.1080/01621459.2000.10474264)."""

_EDGES = np.concatenate([[0.0], np.geomspace(1e-7, 0.1, 5), np.linspace(0.25, 1.0, 6)])
SHARES, PROBABLE = (_EDGES[1:] + _EDGES[:-1]) / 2, np.diff(_EDGES)
"""Shares that are tried, and how probable each is beforehand."""

SCALES = 53
"""Values that are tried for a common variance, 8 % apart: half the standard error of one of 90 degrees of freedom."""

LEAST_VARIANCE = 1e-4
"""Part of the mean variance below which that of a target is rounding of its readings."""


@dataclass(frozen=True)
class ScatterDraws:
    """Probable variances of a reading, by direction each (d, m).

    Attributes:
        probable: of the most general model.
        simpler: of each model that has equal variances and is not refuted.
    """

    probable: list[Array]
    simpler: list[list[Array]]


def draw_scatter(found: list[Array], freedoms: list[Array], draws: int, rng: np.random.Generator) -> ScatterDraws:
    """Draws for variances (m,) that were found with so many degrees of freedom (m,), by direction."""
    targets = len(found[0])
    freedom = np.concatenate(freedoms)
    variance = np.concatenate(found)
    middle = float(freedom @ variance) / float(freedom.sum())
    if middle == 0:
        return ScatterDraws([np.zeros((draws, targets))] * len(found), [])
    variance = np.maximum(variance, LEAST_VARIANCE * middle)
    # log-spaced round the mean variance: single targets far out may hold most of it
    scales = middle * np.exp(np.linspace(-2.5, 1.5, SCALES))
    half = freedom / 2
    ratio = variance / scales[:, None]
    same = half * np.log(half * ratio) - half * ratio - gammaln(half)
    own = _own_likelihood(ratio, freedom)
    ways = [slice(k * targets, (k + 1) * targets) for k in range(len(found))]
    pools = [[slice(None)], ways][: len(ways)]
    evidence = [sum(_log_mean(same[:, way].sum(axis=1)) for way in pool) for pool in pools]
    evidence.append(float(logsumexp(own)) - np.log(SCALES))
    drawn = [_pooled(variance, freedom, pool, draws, rng) for pool in pools]
    drawn.append(_own(variance, freedom, own, scales, draws, rng))
    weight = np.exp(np.array(evidence) - logsumexp(evidence))
    simpler = [each for each, w in zip(drawn[:-1], weight, strict=False) if w >= REFUTED * (w + weight[-1])]
    return ScatterDraws([drawn[-1][:, way] for way in ways], [[each[:, way] for way in ways] for each in simpler])


def _log_mean(log: Array) -> float:
    return float(logsumexp(log)) - float(np.log(len(log)))


def _own_likelihood(ratio: Array, freedom: Array) -> Array:
    """(shares, scales) log likelihood of found over common variances (scales, g), with the prior of the shares."""
    prior = (freedom.mean() * (1 - SHARES) / SHARES)[:, None, None]
    half = freedom / 2
    each = (
        half * np.log(freedom / prior * ratio)
        - betaln(half, prior / 2)
        - (freedom + prior) / 2 * np.log1p(freedom * ratio / prior)
    )
    return np.asarray(each.sum(axis=2) + np.log(PROBABLE)[:, None], dtype=np.float64)


def _pooled(variance: Array, freedom: Array, pool: list[slice], draws: int, rng: np.random.Generator) -> Array:
    """(draws, g) where all of a pool are equal."""
    result = np.empty((draws, len(variance)))
    for part in pool:
        total = freedom[part].sum()
        result[:, part] = (freedom[part] @ variance[part] / rng.chisquare(total, size=draws))[:, None]
    return result


def _own(variance: Array, freedom: Array, log: Array, scales: Array, draws: int, rng: np.random.Generator) -> Array:
    """(draws, g) where each has its own."""
    weight = np.exp(log - logsumexp(log)).ravel()
    which, scale = np.unravel_index(rng.choice(weight.size, size=draws, p=weight / weight.sum()), log.shape)
    prior = (freedom.mean() * (1 - SHARES) / SHARES)[which]
    above = (prior * scales[scale])[:, None] + freedom * variance
    return np.asarray(above / rng.chisquare(prior[:, None] + freedom), dtype=np.float64)
