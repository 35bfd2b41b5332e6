"""The rotor's jitter about the command, told apart from what drives it: its spectrum and its resonances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import minimize

from rotary_error_monitor.gap.orders import order_spectrum
from rotary_error_monitor.gap.stage.search import LINES
from rotary_error_monitor.twin.stage_noise import Jitter

Array = NDArray[np.float64]

LINE = 40.0
"""A line is this many times the power of the spectrum around it: one in 10^17 by chance."""

HIGHEST = 25.0
"""Frequency, Hz, up to which lines are the rotor's own; above it inertia lets nothing through."""

MOST_LINES = 24

STRETCH = 2000
"""Samples of one stretch of the averaged periodogram."""


@dataclass(frozen=True)
class SharedMotion:
    """What the heads share against the command.

    Attributes:
        time: (n,) s, evenly spaced.
        command: (n,) commanded rotation, rad.
        values: (n,) shared residual, rad.
        known: (n,) where enough heads were present.
        smooth: (n, p) slow functions of the commanded motion, which drive effects resemble.
        floor: one-sided density of the readings' noise, rad^2/Hz.
    """

    time: Array
    command: Array
    values: Array
    known: NDArray[np.bool_]
    smooth: Array
    floor: float


def estimate_jitter(motion: SharedMotion) -> tuple[Jitter, Array]:
    """Spectrum of the jitter, and frequencies (k,) in Hz of lines in it.

    What goes with the motion (slow functions of it, waves of an order) is taken out first, so that an effect of the
    drive does not pass for jitter.
    """
    frequencies, left = _separated(motion)
    period = float(np.ptp(motion.time)) / (len(motion.time) - 1)
    frequency, power = periodogram(left, period)
    # The mean of many periodograms scatters little, so its median is nearly its mean.
    return fit_spectrum(frequency, power * np.log(2.0), motion.floor, Jitter()), frequencies


def periodogram(values: Array, period: float) -> tuple[Array, Array]:
    """Frequencies in Hz above zero and one-sided power density there, averaged over stretches that overlap by half.

    Welch 1967, with a Hann window. (scipy.signal does the same, but takes long to load.)
    """
    length = min(STRETCH, len(values))
    stretches = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    spectra = np.fft.rfft((stretches - stretches.mean(axis=1, keepdims=True)) * window)
    power = 2 * period / np.sum(window**2) * np.mean(np.square(np.abs(spectra)), axis=0)
    last = (length + 1) // 2  # at the highest frequency of an even length both sides are one
    return np.asarray(np.fft.rfftfreq(length, period)[1:last], np.float64), np.asarray(power[1:last], np.float64)


def _separated(motion: SharedMotion) -> tuple[Array, Array]:
    """Frequencies of lines, and the shared motion without them, without orders and without slow functions.

    Lines in frequency and in order are taken in turn, the strongest first: where the speed is constant each looks like
    the other, but only one of them fits the whole recording.
    """
    frequencies: Array = np.zeros(0)
    orders: list[int] = []
    left = _without(motion, frequencies, orders)
    for _ in range(MOST_LINES):
        frequency, by_frequency, stands_out = _strongest_line(motion, left)
        power = order_spectrum(motion.command[motion.known], left[motion.known], LINES)
        order = int(np.argmax(power)) + 1
        if max(by_frequency, float(power[order - 1])) < LINE * stands_out:
            break
        if by_frequency >= power[order - 1]:
            frequencies = _refined(motion, np.append(frequencies, frequency), orders)
        else:
            orders.append(order)
        left = _without(motion, frequencies, orders)
    return frequencies, left


def _strongest_line(motion: SharedMotion, left: Array) -> tuple[float, float, float]:
    """Frequency and power of the line that stands out most, and the power around it."""
    count = 4 * len(left)
    period = float(np.ptp(motion.time)) / (len(left) - 1)
    power = 2 * np.abs(np.fft.rfft(left, count)) ** 2 / np.count_nonzero(motion.known)
    frequency = np.fft.rfftfreq(count, period)
    band = (frequency > 3 / np.ptp(motion.time)) & (frequency < 2 * HIGHEST)
    power, frequency = power[band], frequency[band]
    # Every eighth value keeps the median affordable; it is wide enough to pass over a line and its side lobes.
    around = np.repeat(median_filter(power[::8], 65, mode="nearest") / np.log(2.0), 8)[: len(power)]
    ratio = np.where(frequency < HIGHEST, power / np.maximum(around, 1e-300), 0.0)
    best = int(np.argmax(ratio))
    return float(frequency[best]), float(power[best]), float(around[best])


def _table(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    phase = 2 * np.pi * np.outer(motion.time - motion.time.mean(), frequencies)
    turns = np.outer(motion.command, np.asarray(orders, np.float64))
    return np.concatenate([np.cos(phase), np.sin(phase), np.cos(turns), np.sin(turns), motion.smooth], axis=1)


def _without(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    table = _table(motion, frequencies, orders)[motion.known]
    fitted, *_ = np.linalg.lstsq(table, motion.values[motion.known], rcond=None)
    left = np.zeros(len(motion.values))
    left[motion.known] = motion.values[motion.known] - table @ fitted
    return left


def _refined(motion: SharedMotion, frequencies: Array, orders: list[int]) -> Array:
    """Frequencies after Gauss-Newton steps with everything else in the model."""
    middle = (motion.time - motion.time.mean())[motion.known]
    count = len(frequencies)
    for _ in range(3):
        table = _table(motion, frequencies, orders)[motion.known]
        slopes = middle[:, None] * table[:, : 2 * count]
        fitted, *_ = np.linalg.lstsq(np.concatenate([table, slopes], axis=1), motion.values[motion.known], rcond=None)
        a, b = fitted[:count], fitted[count : 2 * count]
        da, db = fitted[-2 * count : -count], fitted[-count:]
        # a cos + b sin with the frequency off by d: the slopes are 2 pi d (b, -a).
        step = (da * b - db * a) / (2 * np.pi * np.maximum(a**2 + b**2, 1e-300))
        frequencies = frequencies + np.clip(step, -0.5 / np.ptp(middle), 0.5 / np.ptp(middle))
    return frequencies


def fit_spectrum(frequency: Array, power: Array, floor: float, start: Jitter) -> Jitter:
    """Jitter whose spectrum, above a white floor, fits a periodogram (one-sided, rad^2/Hz).

    The logarithm of a periodogram scatters about that of the density by the same law at all frequencies and sizes; its
    median is used (an absolute deviation), so that the lines of a cyclic effect do not count as jitter.
    """
    levels = np.log(power[1:]) - np.log(np.log(2.0))

    def misfit(values: Array) -> float:
        jitter = Jitter(float(np.exp(values[0])), float(np.exp(values[1])), float(np.exp(values[2])))
        return float(np.mean(np.abs(levels - np.log(jitter.density(frequency[1:]) + floor))))

    first = np.log([start.std, start.bandwidth, start.shape])
    found = minimize(misfit, first, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-5, "maxiter": 400})
    std, bandwidth, shape = np.exp(found.x)
    return Jitter(float(std), float(np.clip(bandwidth, 0.1, 100.0)), float(np.clip(shape, 0.5, 4.0)))
