"""How far the figures of an ISO 230-2 test may be from those of infinitely many runs of the same axis.

Readings at a target scatter normally about their mean. Most figures are extremes over the targets, and an extreme of
noisy estimates lies too far out. Bounds of ranges of means (E, M) and of the largest reversal error (B) come from tests
of each value, inverted (`extremes`). What the standard deviations are is drawn from their posterior
(`scatter_posterior`), and goes through the formulas of R and, with the means, of A.

How much standard deviations differ between targets and directions, few runs hardly tell. The upper bound is that of the
most general model. The lower one is also no higher than that of any simpler model that is not refuted, else chance that
looks like a difference would raise it (bounds that hold whatever a nuisance parameter within its own bounds is: Berger
and Boos 1994, DOI 10.1080/01621459.1994.10476836). The mean reversal error is a mean, with the degrees of freedom of
Welch and Satterthwaite (JCGM 100:2008, G.4). The largest reversal error is no smaller than it: its lower bound is that
of the mean one unless it is refuted that targets have the same.

A maximum of means that may be equal has no derivative there. No estimate of it is unbiased, nor is any bound right both
where means are equal and where they are not quite (Hirano and Porter 2012, DOI 10.3982/ECTA8681; Andrews 2000,
DOI 10.1111/1468-0262.00114, of the bootstrap): where targets are alike in truth, upper bounds are held more often.

What the readings of a run have in common (drift from run to run, a scale that grows) is told apart (`run_effects`): it
shifts all means of a run and is drawn beside the errors of single targets, with the degrees of freedom of the runs.

The instrument's own error (its calibration, alignment, temperature) is alike in all runs, so readings do not show it.
It changes with the position alone: it moves E, M and A, and leaves R and B (ISO 230-2:2014, Annex A, ISO/TR 230-9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.extremes import draw_largest, draw_ranges
from rotary_error_monitor.metrology.positioning import COVERAGE, PositioningRuns
from rotary_error_monitor.metrology.run_effects import RunEffects, find_run_effects
from rotary_error_monitor.metrology.scatter_posterior import REFUTED, ScatterDraws, draw_scatter

Interval = tuple[float, float]

DRAWS = 1024
"""Probable axes that are drawn, a power of 2 for Sobol' points: they leave 2.5 % beyond a bound within 0.2 %, as six
times so many random ones do."""

PART = 256
"""Draws that are made at once, so that a thousand targets need no more than some 100 MB."""

TAILS = 0.025, 0.975
"""Parts of the draws below either bound."""

RANGES = ("systematic_deviation", "mean_deviation_range", "accuracy")
"""Figures that are ranges along the travel, by the ends of their names."""

OF_SCATTER = ("repeatability", "accuracy")
"""Figures that standard deviations go into, by the ends of their names."""


LEAST_REVERSAL = "least_reversal_error"
"""Draws for the lower bound of the largest reversal error."""


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
    """Means, variances of a reading by its own scatter, their degrees of freedom, and counts (m,) of one direction."""

    mean: Array
    variance: Array
    freedom: Array
    count: Array


@dataclass(frozen=True)
class _Common:
    """What runs have in common, drawn: errors of means and variances of a reading, (DRAWS, m) by direction."""

    errors: Array
    variances: Array


@dataclass(frozen=True)
class _Model:
    """What is drawn: single targets by direction, and what runs have in common."""

    ways: list[_Way]
    scatter: ScatterDraws
    common: _Common


def bound_positioning(runs: PositioningRuns, instrument: float = 0.0) -> PositioningBounds:
    """95 % intervals for the figures that infinitely many runs would give; the same for the same readings.

    `instrument` is the standard uncertainty of the instrument's difference between two positions of the travel, m or
    rad. How many of 100 intervals hold the truth: doc/calibration.md. Of a single target with three times the scatter
    of all others five runs tell too little: there the upper bounds of R hold it less often.
    """
    blocks = [runs.forward] if runs.backward is None else [runs.forward, runs.backward]
    model = _model(blocks, find_run_effects(runs.targets, blocks))
    # without effects of runs that are not certain, as any simpler model that is not refuted
    fewer = _model(blocks, find_run_effects(runs.targets, blocks, 1 - REFUTED))
    ways, scatter, common = model.ways, model.scatter, model.common
    found = _bounds(model, fewer, instrument)
    for name, way in zip(("forward", "backward"), ways, strict=False):
        _reach_of_two(found, f"{name}_systematic_deviation", way.mean, [way], instrument)
    if len(ways) == 1:
        return PositioningBounds(_direction(found, "forward"), None, None)
    both = np.concatenate([way.mean for way in ways])
    _reach_of_two(found, "systematic_deviation", both, ways, instrument)
    _reach_of_two(found, "mean_deviation_range", (ways[0].mean + ways[1].mean) / 2, ways, instrument, 0.5)
    low, high = found["mean_reversal_error"] = _bound_mean_reversal(ways[0], ways[1], common)
    if _alike(ways[0].mean - ways[1].mean, ways, scatter) >= REFUTED:
        found["reversal_error"] = max(0.0, low, -high), found["reversal_error"][1]
    names = BidirectionalBounds.__dataclass_fields__
    return PositioningBounds(
        _direction(found, "forward"),
        _direction(found, "backward"),
        BidirectionalBounds(**{name: found[name] for name in names}),
    )


def _model(blocks: list[Array], effects: RunEffects) -> _Model:
    counts = [np.isfinite(each).sum(axis=1).astype(np.float64) for each in blocks]
    ways = [_Way(*each) for each in zip(effects.means, effects.variance, effects.freedom, counts, strict=True)]
    variances, freedoms = [way.variance for way in ways], [way.freedom for way in ways]
    scatter = draw_scatter(variances, freedoms, DRAWS, np.random.default_rng(0))
    return _Model(ways, scatter, _Common(*effects.draw(DRAWS, np.random.default_rng(2))))


def _reach_of_two(
    found: dict[str, Interval], name: str, means: Array, ways: list[_Way], instrument: float, share: float = 1.0
) -> None:
    """Where a range of means may be noise alone, its upper bound is no lower than that of the outermost two.

    What other targets add to it is then not known: they may be anywhere between. `share` is the part of the variance
    of a mean of one way that the means have.
    """
    variance = share * float(np.mean(np.concatenate([way.variance / way.count for way in ways])))
    freedom = len(means) - 1
    square = float(np.square(means - means.mean()).sum())
    if variance > 0.0 and chdtrc(freedom, square / variance) >= REFUTED:
        reach = float(ndtri(TAILS[1]) * np.sqrt(2 * variance + instrument**2))
        found[name] = found[name][0], max(found[name][1], float(np.ptp(means)) + reach)


def _direction(found: dict[str, Interval], way: str) -> DirectionBounds:
    return DirectionBounds(**{name: found[f"{way}_{name}"] for name in DirectionBounds.__dataclass_fields__})


def _bound_mean_reversal(there: _Way, back: _Way, common: _Common) -> Interval:
    """The t interval of the mean reversal error, with probable errors that runs there have in common or those back."""
    targets = len(there.mean)
    middle = float((there.mean - back.mean).mean())
    parts = np.concatenate([way.variance / way.count for way in (there, back)]) / targets**2
    errors = (common.errors[0] - common.errors[1]).mean(axis=1)
    if not parts.any():
        return middle, middle
    freedom = parts.sum() ** 2 / (parts**2 / np.concatenate([there.freedom, back.freedom])).sum()
    if not errors.any():  # nothing beside the scatter of the runs: the interval of Welch, without draws
        reach = float(stdtrit(freedom, TAILS[1]) * np.sqrt(parts.sum()))
        return middle - reach, middle + reach
    own = stdtrit(freedom, (np.arange(DRAWS) + 0.5) / DRAWS) * np.sqrt(parts.sum())
    reach = float(np.quantile(np.abs(np.random.default_rng(3).permutation(own) + errors), TAILS[1] - TAILS[0]))
    return middle - reach, middle + reach


def _alike(reversal: Array, ways: list[_Way], scatter: ScatterDraws) -> float:
    """P-value of reversal errors (m,) that are equal: of chi-square, the mean over the probable variances.

    Meng 1994, DOI 10.1214/aos/1176325622.
    """
    noise = sum((each / way.count for each, way in zip(scatter.probable, ways, strict=True)), np.zeros(len(reversal)))
    if not noise.any():
        return float(np.ptp(reversal) == 0)
    weight = 1 / noise
    common = (weight @ reversal) / weight.sum(axis=1)
    square = (weight * np.square(reversal - common[:, None])).sum(axis=1)
    return float(chdtrc(len(reversal) - 1, square).mean())


def _bounds(model: _Model, fewer: _Model, instrument: float) -> dict[str, Interval]:
    """Intervals of all figures that are extremes, by name; `fewer` is the model of fewer effects of runs."""
    normal = _normal(sum(len(way.mean) for way in model.ways) + 1)
    moved = instrument * normal[:, -1]
    drawn = _figures(model.ways, model.common, model.scatter.probable, normal, ("",))
    simpler = [_figures(model.ways, model.common, each, normal, OF_SCATTER) for each in model.scatter.simpler]
    if any(np.any(one.freedom != other.freedom) for one, other in zip(model.ways, fewer.ways, strict=True)):
        probable = [fewer.scatter.probable, *fewer.scatter.simpler]
        simpler += [_figures(fewer.ways, fewer.common, each, normal, OF_SCATTER) for each in probable]
    found = {}
    for name, values in drawn.items():
        each = [values, *(model[name] for model in simpler if name in model)]
        if name.endswith(RANGES):
            each = [np.maximum(one + moved, 0.0) for one in each]
        low, high = min(float(np.quantile(one, TAILS[0])) for one in each), float(np.quantile(each[0], TAILS[1]))
        found[name] = low, high
    if LEAST_REVERSAL in found:
        found["reversal_error"] = found.pop(LEAST_REVERSAL)[0], found["reversal_error"][1]
    return found


def _normal(columns: int) -> Array:
    """(DRAWS, columns) standard normal, the same each time."""
    from scipy.stats import qmc  # loads for a second or two

    if columns > qmc.Sobol.MAXDIM:
        return np.random.default_rng(1).normal(size=(DRAWS, columns))
    return np.asarray(ndtri(qmc.Sobol(columns, seed=1).random(DRAWS)))


def _figures(
    ways: list[_Way], common: _Common, variances: list[Array], normal: Array, wanted: tuple[str, ...]
) -> dict[str, Array]:
    """(DRAWS,) of each figure whose name ends as `wanted`, for variances of a reading (DRAWS, m) by direction."""
    parts = []
    for start in range(0, DRAWS, PART):
        now = slice(start, start + PART)
        part = [each[now] for each in variances]
        noise = [each / way.count for each, way in zip(part, ways, strict=True)]
        split = np.split(normal[now, :-1], len(ways), axis=1)
        errors = [np.sqrt(each) * of for each, of in zip(noise, split, strict=True)]
        margins = [COVERAGE * np.sqrt(each + more[now]) for each, more in zip(part, common.variances, strict=True)]
        means = [way.mean - shift[now] for way, shift in zip(ways, common.errors, strict=True)]
        parts.append(_figures_of([way.mean for way in ways], means, noise, errors, margins, wanted))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _figures_of(
    found: list[Array],
    means: list[Array],
    noise: list[Array],
    errors: list[Array],
    margins: list[Array],
    wanted: tuple[str, ...],
) -> dict[str, Array]:
    """The figures as `positioning` has them of readings; of draws, see `extremes`.

    `means` (d, m) are those found (m,) without probable errors that runs have in common.
    """
    still = np.zeros_like(noise[0])
    makers: dict[str, Callable[[], Array]] = {}
    for name, *way in zip(("forward", "backward"), means, noise, errors, margins, strict=False):
        mean, variance, error, margin = way
        makers[f"{name}_repeatability"] = partial(_widest, margin)
        makers[f"{name}_systematic_deviation"] = partial(draw_ranges, mean, variance, error, still)
        makers[f"{name}_accuracy"] = partial(draw_ranges, mean, variance, error, margin)
    if len(means) == 2:
        reversal = means[0] - means[1], noise[0] + noise[1], errors[0] - errors[1]
        middle = (means[0] + means[1]) / 2, (noise[0] + noise[1]) / 4, (errors[0] + errors[1]) / 2
        both = np.concatenate(means, axis=1), np.concatenate(noise, axis=1), np.concatenate(errors, axis=1)
        margin = np.concatenate(margins, axis=1)
        # common errors that may have made all of a reversal error leave none of the other sign
        least = np.where(reversal[0] * (found[0] - found[1]) > 0, reversal[0], 0.0)
        makers[LEAST_REVERSAL] = partial(draw_largest, least, *reversal[1:], still)
        makers["reversal_error"] = partial(draw_largest, *reversal, still)
        makers["repeatability"] = lambda: np.maximum(
            draw_largest(*reversal, margins[0] + margins[1]), _widest(np.maximum(*margins))
        )
        makers["mean_deviation_range"] = partial(draw_ranges, *middle, still)
        makers["systematic_deviation"] = partial(draw_ranges, *both, np.zeros_like(margin))
        makers["accuracy"] = partial(draw_ranges, *both, margin)
    return {name: make() for name, make in makers.items() if name.endswith(wanted)}


def _widest(margin: Array) -> Array:
    return np.asarray(2 * margin.max(axis=1))
