"""Readings in steps: their mean error where nobody says how an instrument rounds, and the step they show."""

from __future__ import annotations

import numpy as np
from scipy.special import erf, ndtr

from rotary_error_monitor.arrays import Array

_SAME = 1e-3
"""Part of a step by which readings may miss it and be on it: each continuous one is so by chance once in 500."""

_EQUAL = 1e-12
"""Part of the largest reading below which two readings are one: what double precision leaves of them after a gain."""

HARMONICS = 24
"""Of the sawtooth of rounding that are looked at: what others add to the variance of rounding is below 3 % of it."""

_NOTHING = 1e-6
"""Part of the variance of rounding that is left where all readings share it, below which it is not looked for."""


def rounding_errors(values: Array, noise: float, step: float) -> Array:
    """(n, 2) half a step, and half a step away from zero, as far as the noise leaves a reading its sign.

    A reading to the nearest step errs by neither in the mean, one that is cut off to the step below by minus the first,
    one that is cut off towards zero by minus the second: `trunc(v) = v - sign(v) step / 2`, up to a sawtooth about 0
    that noise breaks up, and the mean of `sign(v)` is `erf(value / (sqrt(2) noise))`.

    Args:
        values: (n,) what is read, before noise.
        noise: standard deviation of a reading before it is rounded.
        step: of a reading.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        sign = np.where(values == 0.0, 0.0, erf(values / (np.sqrt(2.0) * noise)))
    return 0.5 * step * np.stack([np.ones_like(values), sign], axis=1)


def sawtooth(values: Array, noise: float, step: float) -> Array:
    """(n,) mean error of readings to the nearest step: a sawtooth of what is read, as far as noise leaves it one.

    Of its harmonics noise leaves `exp(-2 (pi k noise / step)²)` (Widrow and Kollár, Quantization Noise, 2008).

    Args:
        values: (n,) what is read, before noise.
        noise: standard deviation of a reading before it is rounded.
        step: of a reading.
    """
    within = values / step - np.rint(values / step)
    if noise == 0.0:
        return np.asarray(-step * within, np.float64)
    if noise > step:  # less than 1e-8 of a step is left
        return np.zeros_like(within)
    farthest = 1 + int(np.ceil(6 * noise / step))  # edges that noise reaches
    edges = np.arange(-farthest, farthest) + 0.5
    passed = ndtr((within[:, None] - edges) * (step / noise)).sum(axis=1) - farthest
    return np.asarray(step * (passed - within), np.float64)


def repeated_errors(path: Array, noise: float, step: float) -> Array:
    """(n,) how many times the variance of rounding, step²/12, repeats in the readings around each.

    What noise does not break up of the steps, `exp(-(2 pi noise / step)²)` of that variance, is a function of what is
    read, and the same in all readings over which that moves by less than a step: they are worth one.

    Args:
        path: (n,) what is read, one after another, before noise.
        noise: standard deviation of a reading before it is rounded.
        step: of a reading.
    """
    shared = float(np.exp(-((2 * np.pi * noise / step) ** 2)))
    if shared * len(path) < _NOTHING:
        return np.zeros(len(path))
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path)))])
    first = np.searchsorted(travelled, travelled - step / 2, "left")
    last = np.searchsorted(travelled, travelled + step / 2, "right")
    return np.asarray(shared * (last - first - 1), np.float64)


def rounding_variance(advance: Array, noise: Array, step: float, kept: Array) -> Array:
    """(n,) mean square of what a fit leaves of the errors of rounding of readings on a straight line.

    Errors of readings that advance by a part of a step beat with the steps: they are neither independent nor uniform,
    and the fit leaves up to 1.5 times as much of them, or nothing. In the mean over all places of the line between two
    steps the errors of readings a distance `d` apart have the covariance
    `step² / (2 pi²) sum(cos(2 pi k d / step) exp(-(2 pi k noise / step)²) / k²)` (Widrow and Kollár, Quantization
    Noise, 2008), and they are not correlated with noise.

    Args:
        advance: (n,) from one reading to the next.
        noise: (n,) standard deviation of a reading before it is rounded.
        step: of a reading.
        kept: (m, m) matrix by which what is left follows from m readings: a projection.
    """
    # sums of the diagonals: what is left of a pair of readings so far apart
    weights = [2 * float(np.trace(kept, each)) for each in range(1, len(kept))]
    turning = np.exp(2j * np.pi * np.multiply.outer(np.arange(1, len(kept)), advance / step))
    wave = np.ones_like(turning)
    covariance = np.zeros(turning.shape)
    for k in range(1, HARMONICS + 1):
        wave *= turning
        covariance += wave.real * np.exp(-((2 * np.pi * k * noise / step) ** 2)) / (2 * np.pi**2 * k**2)
    left = np.trace(kept) / 12 + np.asarray(weights) @ covariance
    return np.asarray(step**2 * np.maximum(left, 0.0) / np.trace(kept), np.float64)


def step_of(readings: Array) -> float:
    """Step of which all readings (n,) are whole numbers, up to one offset; 0 where they have none in common.

    Readings that never repeat have steps too fine to matter, if they have any.
    """
    ordered = np.unique(readings)
    apart = np.diff(ordered)
    apart = apart[apart > _EQUAL * float(np.abs(ordered).max(initial=0.0))]
    if len(apart) == 0 or len(apart) + 1 == len(readings):
        return 0.0
    step = float(apart.min())
    return step if bool(np.all(np.abs(apart / step - np.rint(apart / step)) < _SAME)) else 0.0
