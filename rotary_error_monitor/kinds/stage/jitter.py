"""The rotor's jitter about the command, told apart from what drives it: its spectrum and its resonances."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.optimize import Bounds, brentq, minimize, minimize_scalar

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.noise_level import NOISIER
from rotary_error_monitor.gap.orders import order_spectrum
from rotary_error_monitor.gap.p_values import NORMAL_QUARTILE, chi_square_median
from rotary_error_monitor.kinds.stage.search import LINES
from rotary_error_monitor.noise.jitter import Jitter, JitterFilter, holds
from rotary_error_monitor.noise.lost_samples import bridge
from rotary_error_monitor.noise.whitening import predictor

LINE = 40.0
"""A line is this many times the power of the spectrum around it: one in 10^17 by chance."""

UNTOLD = 15.0
"""An order is told from a frequency if it explains this many times the power around more: one in 2000 by chance."""

JUMP = 8.0
"""Neighbouring samples further apart than this many standard deviations of such differences hold a step, which inertia
does not let a rotor's jitter make: one in 10^15 by chance."""

HIGHEST = 25.0
"""Frequency, Hz, up to which lines are the rotor's own; above it inertia lets nothing through."""

HIGHEST_ORDER = 100
"""Of a turn, that an effect may have."""

MOST_LINES = 24

SAME = 1e-10
"""Part of the squares of columns of length one below which a sum of them is rounding."""

SETTLED = 1e-3
"""Turns, over the whole recording, by which a line's phase may still be off."""

_BOUNDS = ((1e-12, 1.0), (0.1, 100.0), (0.5, 8.0))
"""Of the standard deviation (rad), the bandwidth (Hz) and the shape of a jitter: up to the fall of a steep low pass."""

_STARTS = (0.5, 5.0, 25.0)
"""Bandwidths, Hz, from which the fit of a spectrum starts."""

_SHAPE = 2.0
"""Shape, a Gaussian's, from which it does: steeper and flatter spectra are reached from it."""

STRETCH = 2000
"""Samples of one stretch of the averaged periodogram."""

PARTS = 20
"""Parts of a recording between which sizes of a jitter scatter."""

LEAST_ROWS = 10 * PARTS
"""Rows of full weight from which the size of a jitter is told: each part of them to a third."""


@dataclass(frozen=True)
class SharedMotion:
    """What the heads share against the command.

    Attributes:
        time: (n,) s, evenly spaced.
        command: (n,) commanded rotation, rad.
        values: (n,) shared residual, rad.
        known: (n,) where enough heads were present.
        moving: (n,) where the rotor is commanded to turn.
        weight: (n,) of each value: less where the heads show the same count again and again.
        smooth: (n, p) slow functions of the commanded motion, which drive effects resemble.
        floor: one-sided density of the readings' noise, rad^2/Hz.
    """

    time: Array
    command: Array
    values: Array
    known: NDArray[np.bool_]
    moving: NDArray[np.bool_]
    weight: Array
    smooth: Array
    floor: float
    _waves: dict[tuple[str, float], Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def seen(self) -> Array:
        """(m,) s from the middle of the recording, where enough heads were present."""
        return np.asarray((self.time - self.time.mean())[self.known], np.float64)

    @cached_property
    def turned(self) -> Array:
        """(m,) commanded rotation there, rad."""
        return np.asarray(self.command[self.known], np.float64)

    @cached_property
    def slow(self) -> Array:
        """(p, m) slow functions there, and a step wherever the values jump, each contiguous in time."""
        jump = np.abs(np.diff(self.values[self.known]))
        largest = np.argsort(jump)[::-1][:MOST_LINES]
        found = largest[jump[largest] > JUMP * float(np.median(jump)) / NORMAL_QUARTILE]
        steps = np.arange(len(self.seen)) > found[:, None]
        return np.ascontiguousarray(np.concatenate([self.smooth[self.known].T, steps.astype(np.float64)]))

    @property
    def period(self) -> float:
        """Time between samples, s."""
        return float(np.ptp(self.time)) / (len(self.time) - 1)

    def without(self, explained: Array) -> Array:
        """(n,) values less what is explained of them (m,) where enough heads were present; zero elsewhere."""
        left = np.zeros(len(self.values))
        left[self.known] = self.values[self.known] - explained
        return left

    def line(self, frequency: float) -> Array:
        """(2, m) cosine and sine of a frequency, Hz, there; kept: lines are taken in turn, with all before them."""
        return self._wave(("Hz", frequency), 2 * np.pi * frequency, self.seen)

    def order(self, order: int) -> Array:
        """(2, m) the same of an order of the command."""
        return self._wave(("order", order), order, self.turned)

    def _wave(self, name: tuple[str, float], rate: float, along: Array) -> Array:
        if name not in self._waves:
            angle = rate * along
            self._waves[name] = np.stack([np.cos(angle), np.sin(angle)])
        return self._waves[name]


def estimate_jitter(motion: SharedMotion) -> tuple[Jitter, Array]:
    """Spectrum of the jitter, and frequencies (k,) in Hz of lines in it.

    What goes with the motion (slow functions of it, waves of an order) is taken out first, so that an effect of the
    drive does not pass for jitter.
    """
    frequencies, orders, left = _separated(motion)
    first = _spectrum(motion, left)
    # Least squares that take jitter for white add narrow functions to it, such as of a reversal, by what it chances to
    # be there: spikes, which have power at all frequencies.
    left = _without_coloured(motion, frequencies, orders, first)
    return _with_sizes(motion, left, _spectrum(motion, left)), frequencies


def _with_sizes(motion: SharedMotion, left: Array, jitter: Jitter) -> Jitter:
    """A jitter that is larger in motion, or at rest, where what is left (n,) is more than that of both together."""
    whole = bridge(left[:, None], ~motion.known)
    sizes = [_size(motion, whole, jitter, state & motion.known) for state in (motion.moving, ~motion.moving)]
    sized = replace(jitter, in_motion=sizes[0], at_rest=sizes[1])
    return replace(sized, is_held=_is_held(motion, sized))


def _is_held(motion: SharedMotion, jitter: Jitter) -> bool:
    """Whether the rotor rather stood at each stop than jittered on: its readings scatter no more than their noise does.

    The stop in the middle tells: what happens at a few of them is no jitter. Nothing is taken out of what the heads
    share, for functions of the motion are as many as the stops of a recording.
    """
    white = JitterFilter(jitter, motion.floor, motion.period, motion.moving)
    whole, reading = bridge(motion.values[:, None], ~motion.known), np.sqrt(motion.floor / (2 * motion.period))
    new = white.apply(whole, [slice(0, len(whole))])[:, 0]
    weight = motion.weight * (motion.known & (new != 0.0))
    log_odds = []
    for stop, along, _ in holds(~motion.moving, weight, white.held):
        values, own = whole[stop, 0] / reading, np.square(weight[stop])
        scatter = float(own @ np.square(values)) - float(along @ (weight[stop] * values)) ** 2
        jittering = float(own @ np.square(new[stop])) + 2 * float(own.sum() * np.log(white.unforeseen / reading))
        log_odds.append(0.5 * (jittering - scatter))
    return len(log_odds) > 0 and float(np.median(log_odds)) > 0.0


def _size(motion: SharedMotion, whole: Array, jitter: Jitter, state: NDArray[np.bool_]) -> float:
    """How many times as large a jitter is in one state (n,) as over the whole recording.

    It is at most as large as if there were none in the other. What is looked at are parts of the recording of the same
    weight, and of those the one in the middle, for what happens in a few of them is no jitter.
    """
    weight = np.square(motion.weight) * state
    total = float(weight.sum())
    if total < LEAST_ROWS:
        return 1.0
    parts = np.minimum(np.cumsum(weight) / total * PARTS, PARTS - 1).astype(np.intp)
    each = np.bincount(parts, weight, PARTS)

    def louder(times: float) -> float:
        white = JitterFilter(jitter.times(times), motion.floor, motion.period, motion.moving)
        squares = np.square(white.apply(whole, [slice(0, len(whole))])[:, 0]) * weight
        return float(np.median(np.bincount(parts, squares, PARTS) / each)) - 1.0

    if louder(1.0) < max(NOISIER, 5 / np.sqrt(total)):
        return 1.0
    largest = float(np.sqrt(np.count_nonzero(motion.known) / np.count_nonzero(state)))
    return largest if louder(largest) > 0 else float(brentq(louder, 1.0, largest, rtol=NOISIER / 2))


def _spectrum(motion: SharedMotion, left: Array) -> Jitter:
    """Of what is left (n,) of the shared motion, rad."""
    # Where nothing is known of the motion it did not stand still: that would look like power at all frequencies.
    whole = bridge(left[:, None], ~motion.known)[:, 0]
    frequency, power, freedom = periodogram(whole, motion.period)
    return fit_spectrum(frequency, power * freedom / chi_square_median(freedom), motion.floor)


def periodogram(values: Array, period: float) -> tuple[Array, Array, float]:
    """Frequencies in Hz above zero, one-sided power density there, averaged over stretches that overlap by half, and
    degrees of freedom of the chi-square that it scatters like.

    Welch 1967, with a Hann window: of neighbouring stretches the powers are correlated by 1 / 36. (scipy.signal does
    the same, but takes long to load.)
    """
    length = min(STRETCH, len(values))
    stretches = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    spectra = np.fft.rfft((stretches - stretches.mean(axis=1, keepdims=True)) * window)
    power = 2 * period / np.sum(window**2) * np.mean(np.square(np.abs(spectra)), axis=0)
    last = (length + 1) // 2  # at the highest frequency of an even length both sides are one
    frequency = np.asarray(np.fft.rfftfreq(length, period)[1:last], np.float64)
    count = len(stretches)
    return frequency, np.asarray(power[1:last], np.float64), 2 * count / (1 + (1 - 1 / count) / 18)


def _separated(motion: SharedMotion) -> tuple[Array, list[int], Array]:
    """Frequencies of lines, orders, and the shared motion without either and without slow functions.

    Lines in frequency and in order are taken in turn, the strongest first: where the speed is constant each looks like
    the other, but only one of them fits the whole recording. What was recorded at one speed only fits both: then it is
    the rotor's own, since nothing says that it goes with the command.
    """
    frequencies: Array = np.zeros(0)
    orders: list[int] = []
    left = _without(motion, frequencies, orders)
    for _ in range(MOST_LINES):
        frequency, by_frequency, stands_out = _strongest_line(motion, left)
        power = order_spectrum(motion.command[motion.known], left[motion.known], LINES)
        order = int(np.argmax(power)) + 1
        by_order = float(power[order - 1])
        if max(by_frequency, by_order) < LINE * stands_out:
            break
        if by_frequency < by_order:
            frequency, by_frequency = _like_order(motion, left, order)
        if by_frequency > by_order - UNTOLD * stands_out and _lowest(motion) < frequency < HIGHEST:
            frequencies = _refined(motion, np.append(frequencies, frequency), orders)
        else:
            orders.append(order)
        left = _without(motion, frequencies, orders)
    return frequencies, orders, left


def _strongest_line(motion: SharedMotion, left: Array) -> tuple[float, float, float]:
    """Frequency and power of the line that stands out most, and the power around it."""
    count = next_fast_len(4 * len(left), real=True)
    power = 2 * np.abs(np.fft.rfft(left, count)) ** 2 / np.count_nonzero(motion.known)
    frequency = np.fft.rfftfreq(count, motion.period)
    band = (frequency > _lowest(motion)) & (frequency < 2 * HIGHEST)
    power, frequency = power[band], frequency[band]
    # Every eighth value keeps the median affordable; it is wide enough to pass over a line and its side lobes.
    around = np.repeat(median_filter(power[::8], 65, mode="nearest") / np.log(2.0), 8)[: len(power)]
    # What was taken out already leaves holes; the readings' noise is there nonetheless.
    around = np.maximum(around, motion.floor / motion.period)
    ratio = np.where(frequency < HIGHEST, power / around, 0.0)
    best = int(np.argmax(ratio))
    return float(frequency[best]), float(power[best]), float(around[best])


def _lowest(motion: SharedMotion) -> float:
    """Frequency, Hz, above which a line is told from what drifts."""
    return 3 / float(np.ptp(motion.time))


def orders_at_one_speed(lines: Array, time: Array, command: Array) -> list[tuple[float, int]]:
    """Lines (k,), Hz, that a recording made at one speed cannot tell from an order, with that order.

    Args:
        lines: frequencies.
        time: (n,) s.
        command: (n,) commanded rotation, rad.
    """
    if not len(lines):
        return []
    turns, uneven = even_motion(time, command)
    # Within a part of a turn as well: there the order is the one that is nearest.
    orders = [(float(line), round(line / turns)) for line in lines if 0 < line < HIGHEST_ORDER * turns]
    # Uneven turning by a radian of the order's own phase would smear it.
    return [(f, k) for f, k in orders if k and uneven * k < 1 and abs(f - k * turns) < 0.5 / float(np.ptp(time))]


def even_motion(time: Array, command: Array) -> tuple[float, float]:
    """Turns a second of the even motion nearest to a command (n,), rad at (n,) s, and how far off that is, rad."""
    speed, start = np.polyfit(time, command, 1)
    return abs(float(speed)) / (2 * np.pi), float(np.max(np.abs(command - start - speed * time)))


def _like_order(motion: SharedMotion, left: Array, order: int) -> tuple[float, float]:
    """Frequency at which a line looks most like an order, and its power: as much as the order's at one speed only."""
    duration = float(np.ptp(motion.time))
    like = order * float(np.ptp(motion.command)) / (2 * np.pi * duration)

    def missing(frequency: float) -> float:
        return -2 * float(np.abs(np.dot(np.exp(-2j * np.pi * frequency * motion.time), left)) ** 2)

    reach = 0.5 / duration
    found = minimize_scalar(missing, bounds=(max(like - reach, 0.0), like + reach), method="bounded")
    return float(found.x), -float(found.fun) / np.count_nonzero(motion.known)


def _table(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    """(p, m) cosine and sine of each line, of each order, and slow functions, where enough heads were present."""
    return np.concatenate([*map(motion.line, frequencies.tolist()), *map(motion.order, orders), motion.slow])


def _without(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    table = _table(motion, frequencies, orders)
    return motion.without(_fitted(table, motion.values[motion.known]) @ table)


def _without_coloured(motion: SharedMotion, frequencies: Array, orders: list[int], jitter: Jitter) -> Array:
    """As `_without`, by least squares that know the noise's spectrum (Aitken 1935)."""
    table = _table(motion, frequencies, orders)
    whitener = predictor(lambda frequency: jitter.density(frequency) + motion.floor, motion.period)
    both = np.zeros((len(motion.values), len(table) + 1))
    both[motion.known] = np.vstack([table, motion.values[motion.known]]).T
    white = whitener.apply(bridge(both, ~motion.known), [slice(0, len(both))]).T
    return motion.without(_fitted(white[:-1], white[-1]) @ table)


def _fitted(table: Array, values: Array) -> Array:
    """(p,) least squares of rows (p, m), by their products: four times as fast here as by their singular values.

    At one speed some of the slow functions are the same: what rows share to the last digits counts once.
    """
    products = table @ table.T
    length = np.sqrt(np.diag(products))
    unit = 1 / np.where(length > 0, length, np.inf)
    size, vectors = np.linalg.eigh(products * np.outer(unit, unit))
    seen = size > SAME * size[-1]
    shown = vectors[:, seen].T @ (unit * (table @ values))
    return np.asarray(unit * (vectors[:, seen] @ (shown / size[seen])), np.float64)


def _refined(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    """Frequencies after Gauss-Newton steps with everything else in the model."""
    count, length = 2 * len(frequencies), float(np.ptp(motion.seen))
    for _ in range(3):
        table = _table(motion, frequencies, orders)
        slopes = motion.seen * table[:count]
        fitted = _fitted(np.concatenate([table, slopes]), motion.values[motion.known])
        a, b = fitted[:count].reshape(-1, 2).T
        da, db = fitted[-count:].reshape(-1, 2).T
        # a cos + b sin with the frequency off by d: the slopes are 2 pi d (b, -a).
        step = (da * b - db * a) / (2 * np.pi * np.maximum(a**2 + b**2, 1e-300))
        moving = np.abs(step) * length > SETTLED
        if not moving.any():
            break
        frequencies = frequencies + np.where(moving, np.clip(step, -0.5 / length, 0.5 / length), 0.0)
    return frequencies


def fit_spectrum(frequency: Array, power: Array, floor: float) -> Jitter:
    """Jitter whose spectrum, above a white floor, fits a periodogram (one-sided, rad^2/Hz) best within `_BOUNDS`.

    The logarithm of a periodogram scatters about that of the density by the same law at all frequencies and sizes; its
    median is used (an absolute deviation), so that the lines of a cyclic effect do not count as jitter. Frequencies
    above those of any jitter take no part: many of them, where the floor is a little off, would outweigh the jitter.

    Args:
        frequency: (k,) Hz.
        power: (k,) such that the density is the median of what it scatters about.
        floor: density of the readings' noise.
    """
    frequency, power = frequency[1:], power[1:]
    reached = frequency <= _BOUNDS[1][1]
    frequency, levels = frequency[reached], np.log(power[reached])

    def misfit(values: Array) -> float:
        std, bandwidth, shape = np.exp(values)
        return float(np.mean(np.abs(levels - np.log(Jitter(std, bandwidth, shape).density(frequency) + floor))))

    # A spectrum that falls otherwise (a power law, a low pass) has its best fit at a bound: they hold in the search.
    bounds = Bounds(*np.log(_BOUNDS).T)
    best, lowest = Jitter(), np.inf
    for first in _STARTS:
        # Each from anew: where one ends at a worse fit the next would stay there.
        start = np.log([Jitter().std, first, _SHAPE])
        found = minimize(
            misfit,
            start,
            method="Nelder-Mead",
            bounds=bounds,
            options={"xatol": 1e-3, "fatol": 1e-5, "maxiter": 400},
        )
        if found.fun < lowest:
            best, lowest = Jitter(*np.exp(found.x).tolist()), float(found.fun)
    return best
