"""Streams of read heads and an autocollimator, brought to common times: what assembly errors are taken from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.encoder_heads import LEAST_SEEN, seen_part
from rotary_error_monitor.metrology.error_motion import bend_variance, head_variance, tilt_variance
from rotary_error_monitor.metrology.rotation_fit import highest_order
from rotary_error_monitor.metrology.tilt import check_saturation
from rotary_error_monitor.signals.resampling import FEWEST_TO_FIT, GUARD, resample_all, tick_times

Stream = tuple[NDArray[np.int64], Array]
"""Times (n,) ns and values (n, k)."""

SHORTEST_PERIOD_NS = 10_000_000
"""Time between common times where streams are sampled at least as often: what happens within is averaged."""

GAP = 3
"""Samples that are missing in a row, one more than this less one, leave a gap that is not bridged."""

SMALLEST_TURN = 2 * np.pi
"""Rotation that a recording must cover, rad."""

STILL = np.pi / 1024
"""Rotation over which samples are one observation, rad: less than a wave of the highest order, and a shaft that stands
still tells no more about a coarse resolution however long it is looked at."""

FEWEST_TICKS = 100
"""Common times of a recording: three heads, autocollimator and a dozen orders have some fifty unknowns."""


@dataclass(frozen=True)
class ShaftRecording:
    """Simultaneous samples of the shaft between centres, at m times.

    Attributes:
        heads: letters of the heads that were read.
        times: (m,) s.
        readings: (m, h) of the heads, rad; whole turns between heads have no meaning.
        reading_variances: (m, h) rad².
        speed: (m,) of rotation, rad/s.
        reach: how far in time a value draws on samples, s.
        tilt: (m, 2) of the autocollimator, rad; None without one.
        tilt_variances: (m, 2) rad².
        tilt_valid: (m,) whether the autocollimator was within its range; None where it always was.
    """

    heads: tuple[str, ...]
    times: Array
    readings: Array
    reading_variances: Array
    speed: Array
    reach: float = 0.0
    tilt: Array | None = None
    tilt_variances: Array | None = None
    tilt_valid: Mask | None = None


def record_shaft(stage: StageDescription, heads: Mapping[str, Stream], tilt: Stream | None) -> ShaftRecording:
    """Streams of the heads by their letters and of the autocollimator, corrected before, brought to common times.

    Raises:
        InputError: the streams hardly overlap.
    """
    streams = [*heads.values()] + ([] if tilt is None else [tilt])
    intervals = [float(np.median(np.diff(times))) if len(times) > 1 else np.inf for times, _ in streams]
    if not np.isfinite(max(intervals)):
        raise InputError("a stream of a single sample; record at least a whole turn")
    period = max(SHORTEST_PERIOD_NS, round(max(intervals)))
    first = max(int(times[0]) for times, _ in streams) // period + 1
    last = min(int(times[-1]) for times, _ in streams) // period - 1
    count = max(0, last - first)
    if count < FEWEST_TICKS:
        raise InputError(f"the streams overlap for {count * period * 1e-9:.3g} s only")
    ticks = tick_times(first, count, period)
    sampled = resample_all(streams, ticks, period, round(GAP * max(intervals)))
    readings = np.concatenate([one.values for one in sampled[: len(heads)]], axis=1)
    # The speed at a tick needs its neighbours as well.
    valid = np.all([one.valid for one in sampled], axis=0)
    # Where the speed changes so briskly that interpolation misses by more than the noise, heads seem to disagree.
    noise = np.sqrt(stage.ring.noise**2 + stage.ring.resolution**2 / 12)
    valid &= np.all(
        [bend_variance(np.repeat(one.bend, 2, axis=1)) <= 2 * noise**2 for one in sampled[: len(heads)]], axis=0
    )
    valid &= np.roll(valid, 1) & np.roll(valid, -1)
    valid[[0, -1]] = False
    if valid.sum() < FEWEST_TICKS:
        raise InputError(f"the streams have {int(valid.sum())} times in common without a gap; record more of them")
    speed = np.gradient(readings.mean(axis=1)) / (period * 1e-9)
    variances = [head_variance(stage.ring, one.gain, one.travel[:, 0]) for one in sampled[: len(heads)]]
    # a fit over a cell draws on its half, an interpolation on the samples around
    dense = [interval * FEWEST_TO_FIT <= (1 - GUARD) * period for interval in intervals]
    reach = max(0.5 * period if fits else interval for fits, interval in zip(dense, intervals, strict=True)) * 1e-9
    shaft = ShaftRecording(
        heads=tuple(heads),
        times=(ticks[valid] - ticks[0]) * 1e-9,
        readings=readings[valid],
        reading_variances=np.stack(variances, axis=1)[valid],
        speed=speed[valid],
        reach=reach,
    )
    if tilt is None:
        return shaft
    instrument, mirror = stage.tilt_instrument, sampled[-1]
    saturated = check_saturation(tilt[1], instrument, stage.response("autocollimator"))
    spread = [tilt_variance(instrument, mirror.gain, mirror.travel[:, k], mirror.bend[:, k])[valid] for k in range(2)]
    usable = ~_near_saturated(tilt, ticks[valid], period, saturated)
    return replace(shaft, tilt=mirror.values[valid], tilt_variances=np.stack(spread, axis=1), tilt_valid=usable)


def _near_saturated(stream: Stream, ticks: NDArray[np.int64], period: int, saturated: Mask) -> Mask:
    """(m,) whether a sample within a period of a tick stood at the end of the measuring range."""
    at = stream[0][saturated]
    before = np.searchsorted(at, ticks - period)
    return np.asarray(before < np.searchsorted(at, ticks + period))


def check_heads(stage: StageDescription, recording: ShaftRecording) -> Array:
    """(m, h) readings without whole turns between heads.

    Raises:
        InputError: less than two heads, less than a whole turn, or heads that stand at one place.
    """
    if len(recording.heads) < 2:
        raise InputError(
            f"{len(recording.heads)} read head in the recording; the eccentricity of the ring needs at least 2, opposed"
        )
    azimuths = np.array([stage.azimuths[name] for name in recording.heads])
    if seen_part(azimuths, 1) < LEAST_SEEN:
        raise InputError(
            f"heads at azimuths {azimuths.tolist()} rad stand at one place; opposed heads see eccentricity"
        )
    relative = recording.readings - recording.readings[:, :1]
    relative = relative - 2 * np.pi * np.rint(np.median(relative, axis=0) / (2 * np.pi))
    readings = recording.readings[:, :1] + relative
    covered = float(np.ptp(readings.mean(axis=1)))
    if covered < SMALLEST_TURN:
        raise InputError(
            f"the recording covers {np.degrees(covered):.1f}° of rotation; a whole turn (360°) tells the orders apart"
        )
    return np.asarray(readings)


def told_orders(theta: Array, recording: ShaftRecording, highest: int | None) -> int:
    """Highest order that the recording tells at rotations (n,), at most `highest`.

    Raises:
        InputError: the rotations leave so much of the turn out that not even order 1 is told.
    """
    told = highest_order(theta, _fast(recording.speed) * recording.reach)
    if told < 1:
        raise InputError("the rotations leave too much of the turn out; sample all round, standing still or not")
    return told if highest is None else min(told, highest)


@dataclass(frozen=True)
class Observed:
    """Samples of one rotation each: those over which the shaft hardly moved are one.

    Attributes:
        theta, values, variances, speed, times: (n,), (n, c), (n,), (n,), (n,).
    """

    theta: Array
    values: Array
    variances: Array
    speed: Array
    times: Array


def observe(theta: Array, values: Array, variances: Array, speed: Array, times: Array) -> Observed:
    """Values (m, c) with variances (m, k) at rotations, speeds and times (m,), one for each rotation."""
    starts = [0]
    if np.abs(np.diff(theta)).min(initial=np.inf) < STILL:
        begun = theta[0]
        for k, angle in enumerate(theta):
            if abs(angle - begun) > STILL:
                starts.append(k)
                begun = angle
    else:
        starts = list(range(len(theta)))
    edges = np.array(starts)
    counts = np.diff(edges, append=len(theta))

    def mean(rows: Array) -> Array:
        return np.asarray((np.add.reduceat(rows, edges, axis=0).T / counts).T)

    # noise of a shaft that stands still is averaged, what the resolution hides is not: the whole is the bound
    moving = np.abs(mean(speed)) * np.add.reduceat(np.gradient(times), edges) > STILL / 2
    described = mean(variances.mean(axis=1)) / np.where(moving, counts, 1)
    return Observed(mean(theta), mean(values), described, mean(speed), mean(times))


def _fast(speed: Array) -> float:
    """A speed that is hardly exceeded, rad/s."""
    return float(np.quantile(np.abs(speed), 0.9))
