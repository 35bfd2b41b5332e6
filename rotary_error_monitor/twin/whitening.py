"""Filters that turn coloured noise of a known spectrum into white noise of standard deviation one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

Array = NDArray[np.float64]


def whitening_taps(density: Callable[[Array], Array], period: float, taps: int = 256) -> Array:
    """Causal minimum-phase filter (taps,) whose output is white with variance 1 for noise of that spectrum.

    The cepstrum of `1 / sqrt(density)` folded to positive times gives the minimum-phase filter (Oppenheim and Schafer,
    Discrete-Time Signal Processing, homomorphic spectral factorisation). It is the one-step predictor of the noise, so
    its gain is that of the innovations.

    Args:
        density: one-sided power density of the sampled noise at frequencies in Hz, positive, unit^2/Hz.
        period: time between samples, s.
        taps: length of the filter.
    """
    length = 16 * taps
    frequency = np.fft.rfftfreq(length, period)
    variance_per_sample = density(frequency) / (2 * period)
    cepstrum = np.fft.irfft(-0.5 * np.log(variance_per_sample), length)
    cepstrum[1 : length // 2] *= 2
    cepstrum[length // 2 + 1 :] = 0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstrum)), length)[:taps]


def warm_up(taps: Array) -> int:
    """Samples after which a filter started from nothing has all but 1 % of its memory."""
    energy = np.cumsum(taps[::-1] ** 2)[::-1] / np.sum(taps**2)
    return int(np.argmax(energy < 1e-4)) if (energy < 1e-4).any() else len(taps)


def filtered(rows: Array, taps: Array, segments: list[slice]) -> Array:
    """Rows (n, …) filtered along the first axis, each segment on its own; the filter's start-up is set to zero.

    The start-up is left out because a filter that has not seen the noise before cannot predict it.
    """
    result = np.zeros_like(rows)
    skip = warm_up(taps)
    shape = (-1, *(1,) * (rows.ndim - 1))
    for segment in segments:
        part = rows[segment]
        if len(part) > skip:
            result[segment] = oaconvolve(part, taps.reshape(shape), axes=0)[: len(part)]
            result[segment][:skip] = 0.0
    return result


def segments_of(present: NDArray[np.bool_]) -> list[slice]:
    """Runs of consecutive samples that are present."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], present.astype(np.int8), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
