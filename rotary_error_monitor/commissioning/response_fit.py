"""What signals show over a rotation: a constant, what goes with rotation and speed, and whole orders of the rotation.

Least squares with the covariance of the noise as the residual shows it (Newey and West 1987): what a rotor does beside
its orders is no white noise. Signals are turned into channels that are independent of one another, each with noise of
its own colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from rotary_error_monitor.arrays import Array

STRAIGHT = 3
"""Columns before the orders: constant, rotation, speed."""

REACH = 4
"""The noise's correlation is looked at over a quarter of the recording: over more there is nothing to average."""

FEW = 1.4
"""Factor of standard uncertainties for a correlation that is known by four stretches of the recording alone: the
quantiles of Kiefer and Vogelsang (2005, Table 1, Bartlett, b = 1/4) over those of the normal distribution."""


@dataclass(frozen=True)
class FittedCoefficients:
    """Coefficients of signals: D (n, p) for n signals and p columns of `basis`.

    Attributes:
        coefficients: (n, p).
        channels: (n, c) unit vectors: coefficients of channel j are `channels[:, j] @ coefficients`.
        covariances: (c, p, p) of the coefficients of each channel.
        residual: (m, n) what is left.
    """

    coefficients: Array
    channels: Array
    covariances: Array
    residual: Array


def basis(theta: Array, speed: Array, highest: int) -> Array:
    """(m, 3 + 2 highest) columns: 1, rotation about its middle, speed, then cosine and sine of each order."""
    columns = [np.ones(len(theta)), theta - theta.mean(), speed]
    for order in range(1, highest + 1):
        columns += [np.cos(order * theta), np.sin(order * theta)]
    return np.stack(columns, axis=1)


def fit_response(design: Array, values: Array, contrasts: Array, wander: float = 0.0) -> FittedCoefficients:
    """Fit signals (m, n) by the columns of `design` (m, p).

    Args:
        design: as `basis` gives it.
        values: (m, n) signals.
        contrasts: (c, n) orthonormal combinations of the signals that are taken; the others have no meaning.
        wander: standard deviation by which a signal may be off along any column for the whole recording, in its unit
            at the column's root mean square: what too few turns do not average.
    """
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ coefficients
    own = residual @ contrasts.T
    _, vectors = np.linalg.eigh(own.T @ own)
    channels = np.asarray(contrasts.T @ vectors, np.float64)
    inverse = np.asarray(np.linalg.inv(design.T @ design), np.float64)
    common = np.diag(wander**2 / (design**2).mean(axis=0))
    covariances = [common + _covariance(design, inverse, residual @ channel) for channel in channels.T]
    return FittedCoefficients(np.asarray(coefficients.T, np.float64), channels, np.array(covariances), residual)


def _covariance(design: Array, inverse: Array, residual: Array) -> Array:
    """(p, p) of the coefficients, where the noise is correlated as the residual (m,) shows, and not below white."""
    count, columns = design.shape
    smoothed = smooth_by_correlation(residual, design)
    covariance = FEW**2 * inverse @ (design.T @ smoothed) @ inverse
    white = float(residual @ residual) / max(1, count - columns) * inverse
    raised = np.sqrt(np.maximum(1.0, np.diag(white) / np.maximum(np.diag(covariance), np.finfo(np.float64).tiny)))
    covariance = covariance * np.outer(raised, raised)
    return np.asarray(0.5 * (covariance + covariance.T) + 1e-3 * np.diag(np.diag(white)))


def smooth_by_correlation(residual: Array, columns: Array) -> Array:
    """(m, p) columns times the covariance matrix of noise whose correlation is that of a residual (m,)."""
    count = len(residual)
    reach = max(1, count // REACH)
    spectrum = np.abs(np.fft.rfft(residual, 2 * count)) ** 2
    correlation = np.fft.irfft(spectrum)[:reach] / count
    taper = correlation * (1 - np.arange(reach) / reach)
    kernel = np.concatenate([taper[:0:-1], taper])
    # as scipy.signal.fftconvolve does it, which takes longer to load than a commissioning takes
    length = next_fast_len(count + len(kernel) - 1, real=True)
    product = rfft(columns, length, axis=0) * rfft(kernel[:, None], length, axis=0)
    return np.asarray(irfft(product, length, axis=0)[reach - 1 : reach - 1 + count])
