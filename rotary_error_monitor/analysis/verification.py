"""The monitor held against a reference: radial error motion at a height, by direction of turning, over angle and time.

The reference's zero, by direction and speed, and the eccentricity of its target are found and taken off: neither is
error motion (ISO 230-7:2015, 3.5). What they take with them, once-per-turn motion that turns with the rotor, no
reference on a target tells, so it leaves the bounds as well and goes into the uncertainty of the eccentricity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.comparison import Stand
from rotary_error_monitor.analysis.reference_effects import stated_effects
from rotary_error_monitor.analysis.reference_judgement import CHANCE, Variances, judge
from rotary_error_monitor.analysis.rotation import speeds_in
from rotary_error_monitor.analysis.runs import Segment, find_segments
from rotary_error_monitor.analysis.signals import RADIAL, Estimates, Signal, radial_at, signals_of, survey
from rotary_error_monitor.analysis.verification_result import AxisFigures, ReferenceComparison, TurningComparison
from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import reading_variance, rotate
from rotary_error_monitor.metrology.radial_comparison import BOUND, MAX_GAP_NS, RadialComparison
from rotary_error_monitor.metrology.reference_fit import ReferenceFit, fit_reference
from rotary_error_monitor.metrology.spindle_figures import COVERAGE
from rotary_error_monitor.metrology.turns import MOST_WAVES, SAMPLES_A_WAVE, TurnProfiles, cut_turns
from rotary_error_monitor.pipeline.publication import AssemblyVariance
from rotary_error_monitor.pipeline.reference_readings import Reference
from rotary_error_monitor.signals.resampling import resample
from rotary_error_monitor.units import TURN

FEWEST = 8
"""Stretches in which the scatter of a direction is seen, at least: fewer turns are cut."""

BENT = 9 / 384
"""Part of the third difference of a reference's samples that a cubic through them misses at most."""


@dataclass(frozen=True)
class _Pairs:
    """Estimate and reference at n ticks where both are known, and the variance of what is between them.

    Attributes:
        motion: (n, 2) radial error motion at the height, m.
        turning: (n,) variance of what turns with the rotor and is not told from eccentricity.
        lever: (n, 2) growth of the radial error motion with the height, rad.
    """

    stamp_ns: NDArray[np.int64]
    theta: Array
    estimate: Array
    reference: Array
    variances: tuple[Variances, ...]
    motion: Array
    turning: Array
    lever: Array


@dataclass(frozen=True)
class _Part:
    """One direction at one speed of what is compared.

    Attributes:
        segment: with its runs among the n ticks.
        turns: profiles of its whole turns, p of the estimate, p of the reference, and two of the lever.
        rows: (m,) its ticks.
        cluster: (m,) number of the stretch of each, other ones than any other part has.
    """

    segment: Segment
    turns: TurnProfiles
    rows: NDArray[np.intp]
    cluster: NDArray[np.intp]


def compare_reference(
    estimates: Estimates, stage: StageDescription, reference: Reference, stand: Stand, origin: str
) -> ReferenceComparison:
    """Compare the estimates with what a reference shows while it stood at one height.

    Args:
        estimates: of a replay that does not use the reference.
        stage: as described.
        reference: with all its samples.
        stand: where it stood, from when until when.
        origin: of the recording, for messages.

    Raises:
        InputError: tilt or radial motion is not observable, nothing is common to both, or no whole turn is.
    """
    reference = reference.within(stand.begin_ns, stand.end_ns)
    chosen = np.flatnonzero((estimates.stamp_ns >= stand.begin_ns) & (estimates.stamp_ns < stand.end_ns))
    period = int(np.diff(estimates.stamp_ns).min())
    where = f"{origin}: {reference.name} at {stand.height * 1e3:g} mm"
    pairs, remarks = _pairs(estimates, stage, reference, stand.height, chosen, period, where)
    parts, more = _parts(pairs, reference, where)
    every = np.concatenate([part.rows for part in parts])
    fit = fit_reference(
        pairs.theta[every],
        pairs.reference[every] - pairs.estimate[every],
        np.concatenate([_lever(part, pairs) for part in parts]),
        reference.directions,
        np.repeat(np.arange(len(parts)), [len(part.rows) for part in parts]),
        np.concatenate([part.cluster for part in parts]),
    )
    left = np.split(fit.left, np.cumsum([len(part.rows) for part in parts])[:-1])
    chance = CHANCE / (len(parts) * len(reference.axes))
    turnings = [
        _turning(part, pairs, reference, fit.eccentricity, zero, own, chance)
        for part, zero, own in zip(parts, fit.zeros, left, strict=True)
    ]
    eccentric, higher = _stds(fit, stage, reference, stand.height, pairs, every)
    return ReferenceComparison(
        reference.name,
        reference.axes,
        stand.height,
        stand.stated,
        reference.eccentricity,
        fit.eccentricity,
        COVERAGE * eccentric,
        fit.higher,
        COVERAGE * higher,
        *_lean(fit, higher, pairs, every),
        tuple(turnings),
        (*remarks, *more),
    )


def _pairs(
    estimates: Estimates,
    stage: StageDescription,
    reference: Reference,
    height: float,
    chosen: NDArray[np.intp],
    period: int,
    where: str,
) -> tuple[_Pairs, list[str]]:
    """Both where they are known; estimates from before the description was proven are left out where there are others.

    Raises:
        InputError: there is no such time.
    """
    signal = _radial_signal(estimates, stage, height, chosen)
    if signal is None:
        lacking, remedy = "radial error motion", "record what shows it beside the references, or name fewer of them"
        if height:
            lacking, remedy = "radial or tilt error motion", "record heads and autocollimator, or compare at 0 mm"
        raise InputError(
            f"{where}: {lacking} is not observable without the references: a sensor is missing, not believed, or its "
            f"samples are more than {MAX_GAP_NS * 1e-6:g} ms apart; {remedy}"
        )
    moved, spread = radial_at(estimates.error_motion[chosen], estimates.covariance[chosen], height)
    stamps = estimates.stamp_ns[chosen]
    seen = resample(reference.times_ns, reference.readings, stamps, period, MAX_GAP_NS)
    both = seen.valid & np.isfinite(moved).all(axis=1)
    if not both.any():
        raise InputError(
            f"{where}: at no time there is an estimate as well; record both at once, and samples at most "
            f"{MAX_GAP_NS * 1e-6:g} ms apart"
        )
    both, remarks = _proven(both, estimates.proven[chosen], period)
    rows = chosen[both]
    theta, motion = estimates.theta[rows], moved[both]
    tilt = np.nan_to_num(estimates.error_motion[rows, 3:5])
    lever = np.stack([np.tan(tilt[:, 1]), -np.tan(tilt[:, 0])], axis=1)
    slow = _slow(stage, tilt, height) + signal.shape
    stamps_apart = _part_by_stamps(estimates, stage, rows, signal.still[both])
    variances = []
    for axis, along in enumerate(reference.directions):
        own = _along(spread[both], along) - signal.turning[both] - slow
        apart = stamps_apart * _by_heads(estimates, stage, rows, along)
        noise = reading_variance(reference.noise, reference.resolution, seen.gain[both], seen.travel[both, axis])
        noise = noise + (BENT * seen.bend[both, axis]) ** 2
        stated = _stated(reference, along, motion, lever)
        variances.append(Variances(np.maximum(own - apart, 0.0), apart, noise, slow + stated))
    reading = seen.values[both] - reference.form_at(theta)
    estimate = motion @ reference.directions.T
    return _Pairs(
        stamps[both], theta, estimate, reading, tuple(variances), motion, signal.turning[both], lever
    ), remarks


def _proven(both: Mask, proven: Mask, period: int) -> tuple[Mask, list[str]]:
    """Which ticks count: those with a proven description, if there are some; and that others are left out."""
    if not (both & proven).any():
        return both, []
    early = int((both & ~proven).sum()) * period * 1e-9
    told = [f"{early:.2g} s are left out: the description was not yet held against a whole turn"] if early else []
    return both & proven, told


def _stated(reference: Reference, along: Array, motion: Array, lever: Array) -> Array:
    """(n,) variance along a unit vector by what is stated of gain, directions, height and form of the reference."""
    across = motion @ np.array([-along[1], along[0]])
    stated = (reference.gain * (motion @ along)) ** 2 + (reference.roll * across) ** 2
    return np.asarray(stated + (reference.place * (lever @ along)) ** 2 + reference.lasting, np.float64)


def _radial_signal(
    estimates: Estimates, stage: StageDescription, height: float, chosen: NDArray[np.intp]
) -> Signal | None:
    """Radial error motion at a height, at ticks one after another; None where it is not observable."""
    if not len(chosen):
        return None
    first, last = int(chosen[0]), int(chosen[-1]) + 1
    known = survey(estimates, [(first, last)], stage)
    speed = speeds_in(estimates, first, last).speed
    signals = signals_of(estimates.part(first, last), speed, known, stage, (height,))
    return next((signal for signal in signals if signal.quantity == RADIAL), None)


def _along(covariance: Array, along: Array) -> Array:
    """(n,) variance along a unit vector by covariances (n, 2, 2)."""
    return np.asarray(np.einsum("i,nij,j->n", along, covariance, along))


def _by_heads(estimates: Estimates, stage: StageDescription, rows: NDArray[np.intp], along: Array) -> Array:
    """(n,) variance at the ring along a unit vector by the readings of the heads, m²."""
    assembly = AssemblyVariance.of(stage).radial + 0.5 * estimates.unresolved[rows, 0] ** 2
    return np.asarray(np.maximum(_along(estimates.covariance[rows, :2, :2], along) - assembly, 0.0))


def _part_by_stamps(estimates: Estimates, stage: StageDescription, rows: NDArray[np.intp], still: Array) -> Array:
    """(n,) part of that variance which stands still at one speed: of a difference of large numbers little is left, so
    that it must be the same part along all directions.
    """
    whole = _by_heads(estimates, stage, rows, np.array([1.0, 0.0]))
    return np.asarray(np.minimum(still / np.maximum(whole, np.finfo(float).tiny), 1.0))


def _slow(stage: StageDescription, tilt: Array, height: float) -> Array:
    """(n,) variance of the estimate that lasts: air before the autocollimator, and what its answer is off by."""
    air = None if stage.autocollimator is None else stage.autocollimator.turbulence
    assembly = AssemblyVariance.of(stage)
    read = np.maximum(
        assembly.tilt_by_reading(tilt[:, 0], tilt[:, 1]), assembly.tilt_by_reading(tilt[:, 1], tilt[:, 0])
    )
    return np.asarray(height**2 * ((0.0 if air is None else air.std**2) + read))


def _parts(pairs: _Pairs, reference: Reference, where: str) -> tuple[list[_Part], list[str]]:
    """Each direction and speed that has a whole turn, and what is left out.

    Raises:
        InputError: none has one.
    """
    rate = 1e9 / float(np.median(np.diff(reference.times_ns)))
    signals = np.hstack([pairs.estimate, pairs.reference, pairs.lever])
    found, remarks, begin = [], list[str](), 0
    for segment in find_segments(pairs.stamp_ns, pairs.theta):
        waves = min(MOST_WAVES, int(rate * TURN / abs(segment.speed) / SAMPLES_A_WAVE))
        turns = cut_turns(pairs.theta, signals, segment.runs, waves)
        if turns is None or not len(turns.profiles):
            remarks.append(f"{segment.name}: no whole turn, left out")
            continue
        cluster = _clusters(pairs.theta, segment, turns.whole, begin)
        begin = int(cluster.max()) + 1
        rows = np.concatenate([np.arange(*run) for run in segment.runs])
        found.append(_Part(segment, turns, rows, cluster))
    if not found:
        turned = float(np.ptp(pairs.theta)) / TURN
        raise InputError(
            f"{where}: {turned:.2g} turns in common with the estimate, none of them whole at one speed or in one "
            "direction; record a whole turn at least"
        )
    senses = {part.segment.speed > 0 for part in found}
    if len(senses) == 1:
        way = "forward" if True in senses else "backward"
        remarks.append(f"it turned {way} alone: what differs by the direction of turning is not told")
    return found, remarks


def _lever(part: _Part, pairs: _Pairs) -> Array:
    """(m, 2) growth of the radial error motion with the height, as it is alike in all turns, at the ticks of a part.

    The noise of the tilt is in the estimate as well: a height that is fitted by single readings comes out too small.
    """
    mean = part.turns.profiles[:, :, -2:].mean(axis=0)
    angles = part.turns.angles
    theta = pairs.theta[part.rows]
    return np.stack([np.interp(theta, angles, column, period=TURN) for column in mean.T], axis=1)


def _clusters(theta: Array, segment: Segment, turned: float, begin: int) -> NDArray[np.intp]:
    """Number of the stretch of each sample, from `begin` on: a turn, or a part of one where there are few."""
    parts = max(1, int(np.ceil(FEWEST / turned)))
    found = []
    for first, last in segment.runs:
        passed = np.abs(theta[first:last] - theta[first]) * (parts / TURN)
        found.append(begin + passed.astype(np.intp))
        begin = int(found[-1].max()) + 1
    return np.concatenate(found)


def _turning(
    part: _Part, pairs: _Pairs, reference: Reference, eccentricity: Array, zero: Array, left: Array, chance: float
) -> TurningComparison:
    """Figures of one direction and speed, from what is left (m, p) of reference minus estimate."""
    rows, turns, count = part.rows, part.turns, len(reference.axes)
    profiles = turns.profiles[:, :, : 2 * count].copy()
    once = turns.transmission[1] * rotate((eccentricity[0], eccentricity[1]), turns.angles)
    profiles[:, :, count:] -= zero + once @ reference.directions.T
    apart = profiles[:, :, count:] - profiles[:, :, :count]
    variances = [each.at(rows) for each in pairs.variances]
    std = np.stack([each.std for each in variances], axis=1)
    estimate = pairs.estimate[rows]
    samples = RadialComparison(pairs.stamp_ns[rows], estimate, estimate + left, std)
    bound = BOUND * np.sqrt((std**2).mean(axis=0))
    axes = [
        AxisFigures(
            name,
            samples.along(axis).rms,
            samples.along(axis).maximum,
            int(samples.stamp_ns[np.argmax(np.abs(left[:, axis]))]),
            float(bound[axis]),
            judge(left[:, axis], variances[axis], part.cluster, apart[:, :, axis], chance),
        )
        for axis, name in enumerate(reference.axes)
    ]
    runs = part.segment.runs
    turned = sum(abs(float(pairs.theta[last - 1] - pairs.theta[first])) for first, last in runs) / TURN
    return TurningComparison(
        part.segment.name,
        part.segment.speed,
        turned,
        len(turns.profiles),
        zero,
        samples,
        pairs.theta[rows],
        turns.angles,
        profiles.mean(axis=0),
        bound,
        tuple(axes),
    )


DOUBTED = 4.0
"""Standard uncertainties by which a height that is fitted may be off by chance: of few turns Student's t is wide."""


def _lean(fit: ReferenceFit, higher_std: float, pairs: _Pairs, every: NDArray[np.intp]) -> tuple[float, float]:
    """What the height that fits best makes of the differences, and the largest that nothing speaks against, m."""
    if not np.isfinite(fit.higher_std):
        return 0.0, 0.0
    own = [each.at(every) for each in pairs.variances]
    reading = np.mean([each.reading + BOUND**2 * float(np.mean(each.lasting)) for each in own])
    return abs(fit.higher) * fit.leaning, float(np.sqrt(reading)) + DOUBTED * higher_std * fit.leaning


def _stds(
    fit: ReferenceFit,
    stage: StageDescription,
    reference: Reference,
    height: float,
    pairs: _Pairs,
    every: NDArray[np.intp],
) -> tuple[Array, float]:
    """Standard uncertainties of the eccentricity (2,), and of the height that fits best, m.

    Beside scatter that is what the fit takes for them of all that is the same in all turns: what of the estimate turns
    with the rotor, which is all eccentricity, and what is stated of graduation, flatness, gains and directions. What is
    stated of the reference's height is no uncertainty of the height that is found.
    """
    turning = float(pairs.turning[every].mean())
    squares = np.diag(fit.covariance) + turning
    higher = fit.higher_std**2
    theta, lever, motion = pairs.theta[every], pairs.lever[every], pairs.motion[every]
    for effect in stated_effects(stage, reference, height, theta, motion, lever, fit.eccentricity):
        found, by_height = fit.taken(effect)
        squares, higher = squares + found**2, higher + by_height**2
    squares = squares + fit.taken(reference.place * lever @ reference.directions.T)[0] ** 2
    return np.asarray(np.sqrt(squares)), float(np.sqrt(higher))
