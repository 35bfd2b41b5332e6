"""What rounding to whole counts leaves in the mean radius of a cell where noise does not break up the steps.

Errors of rounding are as good as noise where the noise is half a step or more. Below that one signal errs alike
wherever it stands within one step: where sine or cosine turn back that is over some degrees of the circle, whatever the
number of samples (Widrow and Kollár 2008, Quantization Noise, section on Gaussian dither).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Complex

VARIANCE = 1.0 / 12.0
"""Of an error of rounding, in squares of a step."""

WHOLE = 0.01
"""Counts by which readings that were rounded to whole ones may differ from them, once phase and radius were written."""

_HARMONICS = np.arange(1, 51)


def are_whole(signals: Complex) -> bool:
    """Whether cosine and sine were rounded to whole counts."""
    parts = np.stack([signals.real, signals.imag])
    return bool(np.all(np.abs(parts - np.round(parts)) <= WHOLE))


def repeated_variance(noise: float) -> float:
    """Variance, in squares of a step, of the mean error of rounding at one place, over all places within a step.

    Args:
        noise: standard deviation of normal noise before rounding, in steps.
    """
    falling = np.exp(-np.square(2 * np.pi * _HARMONICS * noise))
    return float(np.sum(falling / (2 * np.square(np.pi * _HARMONICS))))


def rounding_variance(signals: Complex, cells: NDArray[np.intp], scatter: float) -> Array:
    """(m,) variance, squares of counts, that rounding leaves in the mean radius of each of m cells of the circle.

    Readings of one count share one error, in however many cells; where a circle is about zero on all four sides, and of
    both signals. Together they weigh as one.

    Args:
        signals: (n,) samples, cosine + i sine, whole counts.
        cells: (n,) number of the cell of each, 0 … m - 1, none without samples.
        scatter: standard deviation of the radius at one place, counts, errors of rounding among it.
    """
    count = int(cells.max()) + 1
    repeated = repeated_variance(float(np.sqrt(max(scatter**2 - VARIANCE, 0.0))))
    direction, parts = np.angle(signals), np.stack([signals.real, signals.imag])
    counts = np.round(np.abs(parts)).astype(np.int64)
    met = [np.unique(np.stack([step, cells]), axis=1) for step in counts]
    _, step, shared = np.unique(np.concatenate([m[0] for m in met]), return_inverse=True, return_counts=True)
    readings = np.split(1.0 / shared[step], [met[0].shape[1]])
    total, members = np.zeros(count), np.bincount(cells, minlength=count)
    for m, of_each, weight in zip(met, readings, (np.cos(direction), np.sin(direction)), strict=True):
        of_cell = np.bincount(m[1], of_each, count)
        total += repeated * np.bincount(cells, np.square(weight), count) / members / of_cell
    return total
