"""The streams of a recording as they came, and what each is like: rate, noise, scatter of its stamps, losses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans

Array = NDArray[np.float64]
Times = NDArray[np.int64]

WINDOW = 6
"""Samples through which a parabola is laid: what is left is noise, for at the slowest rates of heads, some 200 Hz, a
rotor that trembles at 20 Hz hardly bends within so few."""

PARABOLA = 3
"""Unknowns of a parabola."""

STEADY = 0.02
"""Part of the usual speed by which an angle's may change over a window: a ramp that begins there is no parabola."""

ALIKE = 0.5
"""Part of the high squares of speed from which the low ones are like them, and tell no line over the square."""

RAGGED = 8.0
"""Times the usual variance of a window from which it holds a ramp: noise exceeds that once in 3,000 windows."""

MOVING = 0.2
"""Part of the usual speed from which an angle moves: one that rests shows the same step all the time, and no noise."""


@dataclass(frozen=True)
class Stream:
    """Samples of one instrument as they came: `times_ns` (n,) ns, increasing, and `values` (n, k).

    Attributes:
        lost: samples that are missing between others.
        disordered: samples left out because they were not after the one before, or not finite.
    """

    times_ns: Times
    values: Array
    lost: int = 0
    disordered: int = 0


def join_blocks(blocks: Sequence[SampleBlock], fields: Sequence[str]) -> Stream:
    """Stream of the blocks of one topic.

    Raises:
        InputError: a block lacks one of the fields.
    """
    spans = MessageSpans()
    for block in blocks:
        spans.add_block(block)
    coverage = spans.coverage()
    if coverage is None:
        return Stream(np.empty(0, np.int64), np.empty((0, len(fields))))
    times = np.concatenate([block.times_ns for block in blocks])
    values = np.concatenate([block.columns(fields) for block in blocks])
    before = np.concatenate([[np.iinfo(np.int64).min], np.maximum.accumulate(times)[:-1]])
    good = (times > before) & np.isfinite(values).all(axis=1)
    return Stream(times[good], values[good], coverage.lost, int((~good).sum()))


@dataclass(frozen=True)
class StreamFigures:
    """What a stream is like.

    Attributes:
        samples: how many.
        rate: of samples, Hz.
        noise: (k,) standard deviation of a reading by itself, in the stream's unit; nothing where too few samples.
        noise_std: (k,) its standard uncertainty.
        jitter: standard deviation of a stamp, by the distances of samples that are evenly spaced, s.
        lost: samples missing between others.
        disordered: samples out of order or not finite.
    """

    samples: int
    rate: float
    noise: tuple[float, ...]
    noise_std: tuple[float, ...]
    jitter: float
    lost: int
    disordered: int


def describe_stream(stream: Stream, *, is_angle: bool) -> StreamFigures:
    """Figures of a stream; one that `is_angle` goes on and on, others swing about a value."""
    steps = np.diff(stream.times_ns) * 1e-9
    period = float(np.median(steps)) if len(steps) else 0.0
    regular = steps[np.abs(steps - period) < 0.5 * period] if len(steps) else steps
    scatter = float(regular.std()) / np.sqrt(2) if len(regular) else 0.0  # a distance has two stamps
    found = [_noise(stream.times_ns, column, period, scatter, is_angle) for column in stream.values.T]
    told = [each for each in found if each is not None]
    return StreamFigures(
        samples=len(stream.times_ns),
        rate=1 / float(regular.mean()) if len(regular) else 0.0,
        noise=tuple(each[0] for each in told),
        noise_std=tuple(each[1] for each in told),
        jitter=scatter,
        lost=stream.lost,
        disordered=stream.disordered,
    )


def _noise(times: Times, values: Array, period: float, scatter: float, is_angle: bool) -> tuple[float, float] | None:
    """Noise of a reading at rest and its standard uncertainty.

    Stamps that scatter put a moving stage elsewhere by speed times scatter: the variance is a line over the square of
    the speed, and the noise is its value at rest. Where the stage knows one speed only, the distances of the stamps
    tell their scatter.
    """
    count = len(times) // WINDOW
    if count < 2 * PARABOLA:
        return None
    used = count * WINDOW
    at = (times[:used] - times[0]).reshape(count, WINDOW) * 1e-9
    rows = values[:used].reshape(count, WINDOW)
    whole = np.ptp(at, axis=1) < 1.5 * WINDOW * period
    at, rows = at[whole], rows[whole]
    if len(at) < 2 * PARABOLA:
        return None
    u = (at - at.mean(axis=1, keepdims=True)) / (WINDOW * period)
    design = np.stack([np.ones_like(u), u, u * u], axis=2)
    fitted = np.linalg.pinv(design) @ (rows - rows[:, :1])[:, :, None]
    left = rows - rows[:, :1] - (design @ fitted)[:, :, 0]
    variance = (left**2).sum(axis=1) / (WINDOW - PARABOLA)
    speed = fitted[:, 1, 0] / (WINDOW * period)
    if is_angle:
        usual = float(np.quantile(np.abs(speed), 0.9))
        change = 2 * np.abs(fitted[:, 2, 0]) / (WINDOW * period)
        chosen = (np.abs(speed) > MOVING * usual) & (change < STEADY * usual)
        if not chosen.any():
            return None
        variance, speed = variance[chosen], speed[chosen]
        kept = variance < RAGGED * np.median(variance)
        variance, speed = variance[kept], speed[kept]
    if len(speed) < 2 * PARABOLA:
        return None
    square = speed**2
    low, high = np.quantile(square, (0.1, 0.9))
    if low > ALIKE * high:
        found = float(variance.mean() - scatter**2 * square.mean())
        return _root(found, float(variance.std()) / math.sqrt(len(variance)))
    return _root(*_at_rest(variance, square))


def _root(square: float, std: float) -> tuple[float, float]:
    """Root of a variance and its standard uncertainty, which is that of the variance itself where it is hardly any."""
    noise = math.sqrt(max(square, 0.0))
    return noise, std / max(2 * noise, math.sqrt(std), np.finfo(np.float64).tiny)


def _at_rest(variance: Array, square: Array) -> tuple[float, float]:
    """The variance (n,) at speed 0 by weighted least squares over squares of the speed (n,), and its uncertainty."""
    design = np.stack([np.ones(len(square)), square / max(float(square.max()), np.finfo(np.float64).tiny)], axis=1)
    mean = float(variance.mean())
    if mean == 0.0:
        return 0.0, 0.0
    # a variance by so few samples scatters in proportion to itself
    expected = np.full(len(variance), mean)
    for _ in range(3):
        found = np.linalg.lstsq(design / expected[:, None], variance / expected, rcond=None)[0]
        expected = np.maximum(design @ found, 0.05 * mean)
    spread = np.linalg.pinv((design / expected[:, None]).T @ (design / expected[:, None])) * 2 / (WINDOW - PARABOLA)
    return float(found[0]), float(np.sqrt(spread[0, 0]))


@dataclass(frozen=True)
class Recorded:
    """All that commissioning takes from a bag.

    Attributes:
        streams: by their names, such as `head_a`, `command`, `force`.
        missing: names of streams of described instruments that have no samples.
        remarks: what of the bag could not be read.
    """

    streams: Mapping[str, Stream]
    missing: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
