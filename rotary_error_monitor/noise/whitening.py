"""Filters that turn coloured noise of a known spectrum into white noise of standard deviation one."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.twin.recording import SignalStream

AT_ONCE = 2**15
"""Numbers of a column or of several that are worked on together: these fit into a processor's cache."""

_TAPS = 1024
"""Length of a filter: a second of the fastest heads, after which a jitter far above the floor is forgotten."""

_START_UP, _KEPT = 1e-2, 1e-4
"""Part of the variance that a filter may leave out at its start, and ever after."""


def whitening_taps(density: Callable[[Array], Array], period: float) -> Array:
    """Causal minimum-phase filter (1024,) whose output is white with variance 1 for noise of that spectrum.

    The cepstrum of `1 / sqrt(density)` folded to positive times gives the minimum-phase filter (Oppenheim and Schafer,
    Discrete-Time Signal Processing, homomorphic spectral factorisation). It is the one-step predictor of the noise, so
    its gain is that of the innovations.

    Args:
        density: one-sided power density of the sampled noise at frequencies in Hz, positive, unit^2/Hz.
        period: time between samples, s.
    """
    length = 16 * _TAPS
    frequency = np.fft.rfftfreq(length, period)
    variance_per_sample = density(np.asarray(frequency, np.float64)) / (2 * period)
    cepstrum = np.fft.irfft(-0.5 * np.log(variance_per_sample), length)
    cepstrum[1 : length // 2] *= 2
    cepstrum[length // 2 + 1 :] = 0
    return np.asarray(np.fft.irfft(np.exp(np.fft.rfft(cepstrum)), length)[:_TAPS], np.float64)


@dataclass(frozen=True)
class Whitener:
    """A causal filter.

    Attributes:
        taps: (k,) its response to a single sample.
        start_up: samples after which a filter started from nothing leaves out next to nothing of the noise.
    """

    taps: Array
    start_up: int

    def apply(self, rows: Array, segments: list[slice]) -> Array:
        """Rows (n, p) filtered along the first axis, each segment on its own; the filter's start-up is set to zero.

        The start-up is left out because a filter that has not seen the noise before cannot predict it.
        """
        result, done = np.empty_like(rows), 0
        for segment in segments:
            part = rows[segment]
            if len(part) > self.start_up:
                result[done : segment.start + self.start_up] = 0.0
                done = segment.stop
                convolve(part, self.taps, result[segment.start + self.start_up : done])
        result[done:] = 0.0
        return result


def convolve(rows: Array, taps: Array, last: Array | None = None) -> Array:
    """Rows (n, p) filtered along the first axis by `taps` (k,), as many rows as before, or the last ones of them.

    Overlap-add, the transform some times longer than the filter: the work grows with the rows, not with their square.
    (scipy.signal does the same, but to load it takes as long as half a diagnosis.) A few columns at a time.

    Args:
        rows: to be filtered.
        taps: of the filter.
        last: (m, p) where the last m filtered rows go; by default all go to a new array.
    """
    length = int(2 ** np.ceil(np.log2(8 * len(taps))))
    step, response = length - len(taps) + 1, np.fft.rfft(taps, length)
    count = -(-len(rows) // step)
    last = np.empty(rows.shape[::-1]).T if last is None else last
    for places in few_at_once(rows.shape[1], count * step):
        blocks = np.zeros((places.stop - places.start, count, step))
        padded = blocks.reshape(len(blocks), -1)
        padded[:, : len(rows)] = rows[:, places].T
        spectrum = np.fft.rfft(blocks, length)
        spectrum *= response
        filtered = np.fft.irfft(spectrum, length)
        filtered[:, 1:, : length - step] += filtered[:, :-1, step:]
        blocks[...] = filtered[..., :step]
        last[:, places] = padded[:, len(rows) - len(last) : len(rows)].T
    return last


def few_at_once(columns: int, length: int) -> Iterator[slice]:
    """All of so many columns in groups that a processor's cache holds, each of at least one."""
    each = max(1, AT_ONCE // max(length, 1))
    for first in range(0, columns, each):
        yield slice(first, min(first + each, columns))


def side_by_side(parts: Sequence[Array]) -> Array:
    """Columns (n, k, p) of `p` arrays (n, k), each of them contiguous in time: filters and sums run along it."""
    return np.moveaxis(np.stack([part.T for part in parts]), (0, 1, 2), (2, 1, 0))


def predictor(density: Callable[[Array], Array], period: float) -> Whitener:
    """Whitener of noise with any smooth spectrum."""
    taps = whitening_taps(density, period)
    power = density(np.asarray(np.fft.rfftfreq(2 * _TAPS, period), np.float64)) / (2 * period)
    start_up = _memory(taps, power, _START_UP)
    return Whitener(taps[: max(_memory(taps, power, _KEPT), 8)], start_up)


def _memory(taps: Array, power: Array, part: float) -> int:
    """Taps after which the others make less than a part of the variance of the noise that they whiten.

    Of noise far louder at some frequencies than at others small taps may make much.

    Args:
        taps: of the filter.
        power: (k,) variance of a sample of the noise, at evenly spaced frequencies from 0 to the highest.
        part: of variance 1.
    """
    low, high = 0, len(taps)
    while high - low > 1:
        middle = (low + high) // 2
        left_out = np.square(np.abs(np.fft.rfft(taps[middle:], 2 * (len(power) - 1)))) * power
        low, high = (low, middle) if np.mean(left_out) < part else (middle, high)
    return high


def drift_predictor(std: float, correlation_time: float, white: float, period: float) -> Whitener:
    """Whitener of an Ornstein-Uhlenbeck process of that size and correlation time plus white noise of size `white`.

    As sampled the sum is an ARMA(1, 1) process `x_t = m x_(t-1) + e_t - c e_(t-1)`: its innovations follow from
    matching variance and first covariance of `x_t - m x_(t-1)` (Box and Jenkins, Time Series Analysis, chapter 3.4).
    """
    memory = float(np.exp(-period / correlation_time))
    variance = std**2 * (1 - memory**2) + white**2 * (1 + memory**2)
    half = variance / (2 * memory * white**2)
    forget = half - np.sqrt(half**2 - 1)
    innovation = np.sqrt(memory * white**2 / forget)
    start_up = int(np.ceil(np.log(1e-2) / np.log(forget)))
    # The response of (1 - m z) / (1 - c z), until it has faded to one part in 10^6.
    response = (forget - memory) * forget ** np.arange(3 * start_up)
    return Whitener(np.concatenate([[1.0], response]) / innovation, start_up)


def segments_of(present: NDArray[np.bool_]) -> list[slice]:
    """Runs of consecutive samples that are present."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(np.int8), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def runs_of(stream: SignalStream, kept: NDArray[np.bool_]) -> list[slice]:
    """Runs of the samples `kept` (n,) of a stream between which none was lost."""
    breaks = np.flatnonzero(np.diff(stream.time) > 1.5 * stream.period) + 1
    found = []
    for start, stop in itertools.pairwise([0, *breaks.tolist(), len(stream.time)]):
        found += [slice(start + run.start, start + run.stop) for run in segments_of(kept[start:stop])]
    return found
