"""Accuracy and repeatability of positioning of one axis, linear or rotary (ISO 230-2:2014)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.signals.reading_noise import MEDIAN_OF_ABSOLUTE_NORMAL

COVERAGE = 2.0
"""Coverage factor of ISO 230-2: a unidirectional repeatability spans 2 s to either side of the mean."""

SCALE_EFFICIENCY = 0.4
"""Information in the median of absolute differences beside that in a standard deviation, for normal readings."""

EXACT = 13
"""Digits after the point, m or rad, to which readings tell their steps: double precision leaves 1e-14 of 100 m."""

FORWARD, BACKWARD = +1, -1


@dataclass(frozen=True)
class PositioningRuns:
    """Deviations from m targets over up to n cycles; NaN marks a target that a cycle did not visit.

    Attributes:
        targets: (m,) ascending target positions, m or rad.
        forward: (m, n) deviations when approached in positive direction, m or rad.
        backward: (m, n) deviations when approached in negative direction; None for a unidirectional test.
        rotary: True for a rotary axis.
    """

    targets: NDArray[np.float64]
    forward: NDArray[np.float64]
    backward: NDArray[np.float64] | None
    rotary: bool = False

    def __post_init__(self) -> None:
        unit = "rad" if self.rotary else "m"
        if self.targets.ndim != 1 or len(self.targets) < 2:
            raise InputError(f"{self.targets.size} target(s): at least two are needed, each with two readings or more")
        steps = np.diff(self.targets)
        if not np.all(steps > 0):
            at = int(np.argmin(steps > 0))
            pair = f"{self.targets[at]:g} {unit}, then {self.targets[at + 1]:g} {unit}"
            raise InputError(f"targets must ascend, each once; but {pair}")
        for name, values in (("forward", self.forward), ("backward", self.backward)):
            if values is None:
                continue
            if values.ndim != 2 or len(values) != len(self.targets):
                raise InputError(f"{name} deviations of shape {values.shape} do not fit {len(self.targets)} targets")
            counts = np.isfinite(values).sum(axis=1)
            if np.any(counts < 2):
                at = int(np.argmin(counts))
                raise InputError(
                    f"target {self.targets[at]:g} {unit} has {counts[at]} {name} reading(s); "
                    "a standard deviation needs at least two"
                )


@dataclass(frozen=True)
class DirectionFigures:
    """Unidirectional figures, the first four (m,) by target.

    Attributes:
        mean: mean unidirectional positioning deviation (x̄ᵢ↑).
        spread: estimator of the unidirectional repeatability, the standard deviation (sᵢ↑).
        target_repeatability: unidirectional repeatability at a target (Rᵢ↑ = 4 sᵢ↑).
        count: readings at a target.
        repeatability: unidirectional repeatability of the axis (R↑).
        systematic_deviation: unidirectional systematic positioning deviation (E↑).
        accuracy: unidirectional accuracy (A↑).
    """

    mean: NDArray[np.float64]
    spread: NDArray[np.float64]
    target_repeatability: NDArray[np.float64]
    count: NDArray[np.int64]
    repeatability: float
    systematic_deviation: float
    accuracy: float


@dataclass(frozen=True)
class BidirectionalFigures:
    """Bidirectional figures, the first three (m,) by target.

    Attributes:
        mean: mean bidirectional positioning deviation (x̄ᵢ).
        target_reversal_error: reversal error at a target, forward minus backward (Bᵢ).
        target_repeatability: bidirectional repeatability at a target (Rᵢ).
        reversal_error: largest absolute reversal error of the axis (B).
        mean_reversal_error: mean reversal error, with its sign (B̄).
        repeatability: bidirectional repeatability of the axis (R).
        systematic_deviation: bidirectional systematic positioning deviation (E).
        mean_deviation_range: range of the mean bidirectional deviation (M).
        accuracy: bidirectional accuracy (A).
    """

    mean: NDArray[np.float64]
    target_reversal_error: NDArray[np.float64]
    target_repeatability: NDArray[np.float64]
    reversal_error: float
    mean_reversal_error: float
    repeatability: float
    systematic_deviation: float
    mean_deviation_range: float
    accuracy: float


@dataclass(frozen=True)
class PositioningFigures:
    """What ISO 230-2 says of an axis, m or rad; a unidirectional test has no `backward` and `bidirectional`."""

    targets: NDArray[np.float64]
    forward: DirectionFigures
    backward: DirectionFigures | None
    bidirectional: BidirectionalFigures | None


@dataclass(frozen=True)
class Outlier:
    """One reading that stands off from the others at its target and direction.

    Attributes:
        target: index of the target.
        direction: +1 or -1.
        cycle: index of the cycle, 0 the first.
        excess: distance from the median at that target and direction, m or rad.
        ratio: that distance over the robust standard deviation of all readings.
        startup: True in the first cycle, where an axis that has not settled shows.
    """

    target: int
    direction: int
    cycle: int
    excess: float
    ratio: float
    startup: bool


def estimate_deviations(
    targets: NDArray[np.float64], readings: NDArray[np.float64], *, rotary: bool = False
) -> NDArray[np.float64]:
    """Reading minus target; for a rotary axis within half a turn, so that 359.9999° read at 0° is -0.0001°."""
    deviations = np.asarray(readings - targets, dtype=np.float64)
    if rotary:
        deviations = deviations - 2 * math.pi * np.rint(deviations / (2 * math.pi))
    return deviations


def estimate_positioning(runs: PositioningRuns) -> PositioningFigures:
    """ISO 230-2:2014 figures (clauses 3.9 to 3.22) of a test with any number of cycles at each target."""
    forward = _direction(runs.forward)
    if runs.backward is None:
        return PositioningFigures(runs.targets, forward, None, None)
    backward = _direction(runs.backward)
    return PositioningFigures(runs.targets, forward, backward, _bidirectional(forward, backward))


def _direction(deviations: NDArray[np.float64]) -> DirectionFigures:
    mean = np.nanmean(deviations, axis=1)
    spread = np.nanstd(deviations, axis=1, ddof=1)
    repeatability = 2 * COVERAGE * spread
    return DirectionFigures(
        mean=mean,
        spread=spread,
        target_repeatability=repeatability,
        count=np.isfinite(deviations).sum(axis=1),
        repeatability=float(repeatability.max()),
        systematic_deviation=float(np.ptp(mean)),
        accuracy=float((mean + COVERAGE * spread).max() - (mean - COVERAGE * spread).min()),
    )


def _bidirectional(forward: DirectionFigures, backward: DirectionFigures) -> BidirectionalFigures:
    means = np.stack([forward.mean, backward.mean])
    margins = COVERAGE * np.stack([forward.spread, backward.spread])
    reversal = forward.mean - backward.mean
    repeatability = np.max(
        [margins.sum(axis=0) + np.abs(reversal), forward.target_repeatability, backward.target_repeatability], axis=0
    )
    mean = means.mean(axis=0)
    return BidirectionalFigures(
        mean=mean,
        target_reversal_error=reversal,
        target_repeatability=repeatability,
        reversal_error=float(np.abs(reversal).max()),
        mean_reversal_error=float(reversal.mean()),
        repeatability=float(repeatability.max()),
        systematic_deviation=float(np.ptp(means)),
        mean_deviation_range=float(np.ptp(mean)),
        accuracy=float((means + margins).max() - (means - margins).min()),
    )


def find_outliers(runs: PositioningRuns, *, false_alarm: float = 0.01) -> tuple[Outlier, ...]:
    """Readings too far from the median of their target and direction, as `find_outlying`; none is removed here."""
    blocks = [(FORWARD, runs.forward)] + ([] if runs.backward is None else [(BACKWARD, runs.backward)])
    return find_outlying(blocks, false_alarm=false_alarm)


def find_outlying(
    blocks: Sequence[tuple[int, NDArray[np.float64]]], *, false_alarm: float = 0.01, least_scale: float = 0.0
) -> tuple[Outlier, ...]:
    """Readings (m, n) by target and cycle, a block for each direction, that are too far from their target's median.

    The scale is the median distance between two readings at one target: an unbiased, robust measure for any number
    of cycles, which pools all targets and both directions; of an instrument that reads in steps the median of grouped
    distances, for two readings that are equal are so to a step. `false_alarm` bounds the probability that a clean,
    normally distributed test shows any outlier (Bonferroni over all readings). NaN marks a reading that is not there.
    `least_scale` is a standard deviation of a reading that is not fallen below, such as that of rounding.
    """
    scale = _pooled_scale([values for _, values in blocks])
    if scale is None:
        return ()
    scale = max(scale, least_scale)
    readings = sum(int(np.isfinite(values).sum()) for _, values in blocks)
    groups = sum(int((np.isfinite(values).sum(axis=1) > 0).sum()) for _, values in blocks)
    freedom = max(1.0, SCALE_EFFICIENCY * (readings - groups))
    limit = float(stdtrit(freedom, 1 - false_alarm / (2 * readings)))
    found = []
    for direction, values in blocks:
        visited = np.isfinite(values).any(axis=1)
        excess = np.full_like(values, np.nan)
        excess[visited] = values[visited] - np.nanmedian(values[visited], axis=1, keepdims=True)
        ratio = np.abs(excess) / scale if scale > 0 else np.where(excess == 0, 0.0, np.inf)
        far = limit * _reach(np.isfinite(values).sum(axis=1))[:, None]
        for target, cycle in np.argwhere(np.nan_to_num(ratio, nan=0.0) > far):
            found.append(
                Outlier(
                    int(target),
                    direction,
                    int(cycle),
                    float(excess[target, cycle]),
                    float(ratio[target, cycle]),
                    bool(cycle == 0),
                )
            )
    return tuple(sorted(found, key=lambda outlier: -outlier.ratio))


@dataclass(frozen=True)
class CycleJump:
    """A step of the readings within a cycle, as of a beam that was broken.

    Attributes:
        cycle: index of the cycle, 0 the first.
        before, after: (target, direction) of the readings between which it is: index, and +1 or -1.
        size: of the step beside that of other cycles there, m or rad.
        ratio: that over the robust standard deviation of all such steps.
    """

    cycle: int
    before: tuple[int, int]
    after: tuple[int, int]
    size: float
    ratio: float


def find_jumps(runs: PositioningRuns, *, false_alarm: float = 0.01) -> tuple[CycleJump, ...]:
    """Steps from one reading to the next that other cycles do not have there, and that do not go back at once.

    What drifts has small ones and a cycle that begins elsewhere none, so that neither hides a step. At the first and
    the last reading of a cycle a step is a reading that stands off. Largest first; as `find_outlying`.
    """
    order = [(target, FORWARD) for target in range(len(runs.targets))]
    readings = runs.forward
    if runs.backward is not None:
        order += [(target, BACKWARD) for target in reversed(range(len(runs.targets)))]
        readings = np.concatenate([readings, runs.backward[::-1]])
    found = find_outlying([(FORWARD, np.diff(readings, axis=0))], false_alarm=false_alarm)
    steps = {(each.target, each.cycle): each.excess for each in found}

    def stays(each: Outlier) -> bool:
        beside = [steps.get((each.target + k, each.cycle), 0.0) for k in (-1, 1)]
        returns = any(abs(other + each.excess) < abs(each.excess) / 2 for other in beside)
        return 0 < each.target < len(order) - 2 and not returns

    return tuple(
        CycleJump(each.cycle, order[each.target], order[each.target + 1], each.excess, each.ratio)
        for each in found
        if stays(each)
    )


def remove_outliers(runs: PositioningRuns, outliers: tuple[Outlier, ...]) -> PositioningRuns:
    """The same runs without these readings, for a second set of figures beside the first.

    Raises:
        InputError: too few readings are left at a target.
    """
    forward = runs.forward.copy()
    backward = None if runs.backward is None else runs.backward.copy()
    for outlier in outliers:
        values = forward if outlier.direction == FORWARD else backward
        assert values is not None
        values[outlier.target, outlier.cycle] = np.nan
    return PositioningRuns(runs.targets, forward, backward, runs.rotary)


def _reach(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """How far from the median of `counts` (m,) normal readings one of them strays, in that by which one alone does.

    Far out the likeliest way to such a distance is that the half of the readings that holds the median, k of them,
    strays the other way by 1/k of it: as for a normal value of variance 1 + 1/k. Of two readings none is the median.
    """
    return np.asarray(np.where(counts > 2, np.sqrt(1 + 1 / (counts // 2 + 1)), 1.0))


def _pooled_scale(blocks: list[NDArray[np.float64]]) -> float | None:
    """Standard deviation of a reading; None where no target has two."""
    distances = []
    for values in blocks:
        first, second = np.triu_indices(values.shape[1], k=1)
        distances.append(np.abs(values[:, first] - values[:, second]).ravel())
    pooled = np.concatenate(distances)
    pooled = pooled[np.isfinite(pooled)]
    if len(pooled) == 0:
        return None
    # of pairs that share no reading: one that stands off is in one of them
    apart = np.concatenate([np.abs(v[:, 1::2] - v[:, : v.shape[1] // 2 * 2 : 2]).ravel() for v in blocks])
    readings = np.concatenate([values.ravel() for values in blocks])
    step = _step_of_repeated(apart) or _step_of_repeated(readings)
    return _grouped_median(pooled, step) / (math.sqrt(2) * MEDIAN_OF_ABSOLUTE_NORMAL)


def _step_of_repeated(values: NDArray[np.float64]) -> float:
    """Step of which all values that are there more than twice are whole numbers: few that stand off show none."""
    rounded = np.round(values[np.isfinite(values)], EXACT)
    _, index, counts = np.unique(rounded, return_inverse=True, return_counts=True)
    return step_of(rounded[counts[index] > 2])


def _grouped_median(distances: NDArray[np.float64], step: float) -> float:
    """Median of distances (n,) that each stand for all of half a step to either side, evenly."""
    median = float(np.median(distances))
    low, high = max(median - step / 2, 0.0), median + step / 2
    below = float(np.mean(distances < low))
    within = float(np.mean((distances >= low) & (distances < high)))
    return median if within == 0 else low + (high - low) * (0.5 - below) / within


def check_standard_test(runs: PositioningRuns) -> tuple[str, ...]:
    """Departures from the standard test of ISO 230-2:2014, clause 5.3, in words; empty for a test by the book."""
    remarks = []
    span = float(runs.targets[-1] - runs.targets[0])
    if runs.rotary:
        degrees = math.degrees(span)
        least = 3 if degrees <= 90 else 5 if degrees <= 180 else 8
    else:
        # Above 2 m the standard asks for targets about every 250 mm.
        least = max(5, math.ceil(5 * span)) if span <= 2 else math.ceil(span / 0.25)
    if len(runs.targets) < least:
        remarks.append(f"{len(runs.targets)} targets; ISO 230-2 asks for at least {least} over this travel")
    steps = np.diff(runs.targets)
    if len(steps) > 2 and np.ptp(steps) < 1e-3 * steps.mean():
        remarks.append(
            "targets are equally spaced; periodic errors of that spacing stay unseen (ISO 230-2 asks for a random part)"
        )
    blocks = {"forward": runs.forward} | ({} if runs.backward is None else {"backward": runs.backward})
    if runs.backward is None:
        remarks.append("one direction only: no reversal error and no bidirectional figure")
    cycles = 5 if runs.rotary or span <= 2 else 1
    for name, values in blocks.items():
        count = np.isfinite(values).sum(axis=1)
        if count.min() < cycles:
            remarks.append(f"{count.min()} {name} cycles at some targets; ISO 230-2 asks for {cycles}")
        if np.ptp(count):
            remarks.append(f"unequal {name} cycles: {count.min()} to {count.max()} readings at a target")
    return tuple(remarks)
