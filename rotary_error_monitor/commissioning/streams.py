"""The streams of a recording as they came, and what each is like: rate, noise, scatter of its stamps, losses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.metrology.reading_steps import rounding_variance
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans

WINDOW = 6
"""Samples through which a parabola is laid: what is left is noise, for at the slowest rates of heads, some 200 Hz, a
rotor that trembles at 20 Hz hardly bends within so few."""

APART = WINDOW + (math.sqrt(5) - 1) / 2
"""Samples from one window to the next, in the mean: no rhythm of counts and samples has every window begin alike."""

PARABOLA = 3
"""Unknowns of a parabola."""

STEADY = 0.02
"""Part of the usual speed by which an angle's may change over a window: a ramp that begins there is no parabola."""

AROUND = 3
"""Windows before and after one, by which its speed is told to a hundredth of a step a sample."""

BENT = 4.0
"""Standard deviations that noise may bend a window by."""

ALIKE = 0.5
"""Part of the high squares of speed from which the low ones are like them, and tell no line over the square."""

RAGGED = 8.0
"""Times the usual variance of a window from which it holds a ramp: noise exceeds that once in 3,000 windows."""

ONE_PLACE = 0.09
"""Standard deviation over all places between two steps, in squares of a step, of the variance of readings that stand
at one: noise of a tenth to a fifth of a step has them jump from step to step, or not at all."""

MOVING = 0.2
"""Part of the usual speed from which an angle moves: one that rests shows the same step all the time, and no noise."""


@dataclass(frozen=True)
class RawStream:
    """Samples of one instrument as they came: `times_ns` (n,) ns, increasing, and `values` (n, k).

    Attributes:
        lost: samples that are missing between others.
        disordered: samples left out because they were not after the one before, or not finite.
    """

    times_ns: Times
    values: Array
    lost: int = 0
    disordered: int = 0


def join_blocks(blocks: Sequence[SampleBlock], fields: Sequence[str]) -> RawStream:
    """Stream of its blocks.

    Raises:
        InputError: a block lacks one of the fields.
    """
    spans = MessageSpans()
    for block in blocks:
        spans.add_block(block)
    coverage = spans.coverage()
    if coverage is None:
        return RawStream(np.empty(0, np.int64), np.empty((0, len(fields))))
    times = np.concatenate([block.times_ns for block in blocks])
    values = np.concatenate([block.columns(fields) for block in blocks])
    before = np.concatenate([[np.iinfo(np.int64).min], np.maximum.accumulate(times)[:-1]])
    good = (times > before) & np.isfinite(values).all(axis=1)
    return RawStream(times[good], values[good], coverage.lost, int((~good).sum()))


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


def describe_stream(stream: RawStream, *, is_angle: bool, noise: float = 0.0, step: float = 0.0) -> StreamFigures:
    """Figures of a stream; one that `is_angle` goes on and on, others swing about a value.

    Args:
        stream: as it came.
        is_angle: whether it is the angle of a rotation.
        noise: standard deviation of a reading before it is rounded, as described, in the stream's unit.
        step: to which a reading is rounded, likewise.
    """
    steps = np.diff(stream.times_ns) * 1e-9
    period = float(np.median(steps)) if len(steps) else 0.0
    regular = steps[np.abs(steps - period) < 0.5 * period] if len(steps) else steps
    scatter = float(regular.std()) / np.sqrt(2) if len(regular) else 0.0  # a distance has two stamps
    reading = _Reading(period, scatter, noise, step, is_angle)
    found = [reading.measure_noise(stream.times_ns, column) for column in stream.values.T]
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


@dataclass(frozen=True)
class _Reading:
    """How a stream is sampled, and how its readings scatter and are rounded, as described."""

    period: float
    scatter: float
    noise: float
    step: float
    is_angle: bool

    def measure_noise(self, times: Times, values: Array) -> tuple[float, float] | None:
        """Noise of a reading at rest and its standard uncertainty, with its rounding as if its errors were independent.

        Stamps that scatter put a moving stage elsewhere by speed times scatter: the variance is a line over the square
        of the speed, and the noise is its value at rest. Where the stage knows one speed only, the distances of the
        stamps tell their scatter.
        """
        windows = self._windows(times, values)
        if windows is None:
            return None
        variance, speed, place, number = windows
        if len(speed) < 2 * PARABOLA:
            return None
        phases = 0.0
        if self.step > 0.0:
            moved = np.hypot(self.noise, speed * self.scatter)
            expected = rounding_variance(speed * self.period, moved, self.step, _KEPT)
            variance = variance - expected + self.step**2 / 12
            phases = self.step**2 * ONE_PLACE / math.sqrt(self._phases(place, speed, number))
        square = speed**2
        low, high = np.quantile(square, (0.1, 0.9))
        if low > ALIKE * high:
            found = float(variance.mean() - self.scatter**2 * square.mean())
            std = float(variance.std()) / math.sqrt(len(variance))
        else:
            found, std = _at_rest(variance, square)
        return _root(found, math.hypot(std, phases))

    def _phases(self, place: Array, speed: Array, number: Array) -> float:
        """How many phases between two steps the readings show, as if all were as frequent.

        Those at one place share theirs, and so do all that are whole steps apart from sample to sample.
        """
        alias = place / self.step - np.rint(speed * self.period / self.step) * number
        shared = np.unique(np.floor(alias), return_counts=True)[1].astype(np.float64)
        return float(np.sum(shared) ** 2 / np.sum(shared**2))

    def _windows(self, times: Times, values: Array) -> tuple[Array, Array, Array, Array] | None:
        """Variance about a parabola, speed, mean and first sample of each window that tells noise; None of too few."""
        starts = np.floor(np.arange(0.0, len(times) - WINDOW + 1, APART)).astype(np.int64)
        chosen = starts[:, None] + np.arange(WINDOW)
        at, rows = (times[chosen] - times[:1]) * 1e-9, values[chosen]
        whole = np.ptp(at, axis=1) < 1.5 * WINDOW * self.period
        at, rows, number = at[whole], rows[whole], starts[whole].astype(np.float64)
        if len(at) < 2 * PARABOLA:
            return None
        middle, place = at.mean(axis=1), rows.mean(axis=1)
        u = (at - middle[:, None]) / (WINDOW * self.period)
        design = np.stack([np.ones_like(u), u, u * u], axis=2)
        fitted = np.linalg.pinv(design) @ (rows - rows[:, :1])[:, :, None]
        left = rows - rows[:, :1] - (design @ fitted)[:, :, 0]
        variance = (left**2).sum(axis=1) / (WINDOW - PARABOLA)
        # within a window it has an error of rounding that the variance shares
        speed = _slope(place, middle)
        if not self.is_angle:
            return variance, speed, place, number
        usual = float(np.quantile(np.abs(speed), 0.9))
        change = 2 * np.abs(fitted[:, 2, 0]) / (WINDOW * self.period)
        moving = np.abs(speed) > MOVING * usual
        if not moving.any():
            return None
        # of counts that are seldom passed most windows show no noise
        level = max(float(np.median(variance[moving])), self.noise**2 + self.step**2 / 12)
        # what noise makes of the change is no ramp: windows without it would be those whose noise is small by chance
        by_noise = 2 * _BENDING * math.sqrt(level) / (WINDOW * self.period)
        chosen = moving & (change < STEADY * usual + BENT * by_noise) & (variance < RAGGED * level)
        return variance[chosen], speed[chosen], place[chosen], number[chosen]


def _slope(values: Array, times: Array) -> Array:
    """(n,) slope by the values `AROUND` before and after each, as far as there are some."""
    before = np.maximum(np.arange(len(values)) - AROUND, 0)
    after = np.minimum(np.arange(len(values)) + AROUND, len(values) - 1)
    return np.asarray((values[after] - values[before]) / (times[after] - times[before]), np.float64)


_PARABOLA = np.vander((np.arange(WINDOW) - (WINDOW - 1) / 2) / WINDOW, PARABOLA)

_KEPT = np.eye(WINDOW) - _PARABOLA @ np.linalg.pinv(_PARABOLA)
"""(WINDOW, WINDOW) what is left of evenly spaced readings about a parabola."""

_BENDING = float(np.linalg.norm(np.linalg.pinv(_PARABOLA)[0]))
"""Standard deviation of the parabola's square, in those of a reading."""


def _root(square: float, std: float) -> tuple[float, float]:
    """Root of a variance and its standard uncertainty, which is that of the variance itself where it is hardly any."""
    noise = math.sqrt(max(square, 0.0))
    return noise, std / max(2 * noise, math.sqrt(std), np.finfo(np.float64).tiny)


def _at_rest(variance: Array, square: Array) -> tuple[float, float]:
    """The variance (n,) at speed 0 by weighted least squares over squares of the speed (n,), and its uncertainty.

    It does not fall with the speed: its slope is the variance of stamps.
    """
    design = np.stack([np.ones(len(square)), square / max(float(square.max()), np.finfo(np.float64).tiny)], axis=1)
    mean = float(variance.mean())
    if mean <= 0.0:  # less than the rounding that is described
        return 0.0, 0.0
    # a variance by so few samples scatters in proportion to itself
    expected = np.full(len(variance), mean)
    for _ in range(3):
        found = np.linalg.lstsq(design / expected[:, None], variance / expected, rcond=None)[0]
        expected = np.maximum(design @ found, 0.05 * mean)
    if found[1] < 0.0:
        return mean, float(variance.std()) / math.sqrt(len(variance))
    spread = np.linalg.pinv((design / expected[:, None]).T @ (design / expected[:, None])) * 2 / (WINDOW - PARABOLA)
    return float(found[0]), float(np.sqrt(spread[0, 0]))


@dataclass(frozen=True)
class CommissioningRecording:
    """All that commissioning takes from a bag.

    Attributes:
        streams: by their names, such as `head_a`, `command`, `force`.
        missing: names of streams of described instruments that have no samples.
        remarks: what of the bag could not be read.
    """

    streams: Mapping[str, RawStream]
    missing: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
