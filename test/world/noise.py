"""Random functions: noise of instruments, smooth motion, slow wander, and quantisation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, lfiltic, sosfiltfilt

Array = NDArray[np.float64]
LIMIT = 8.0  # standard deviations beyond which no noise goes


def instrument_noise(rng: np.random.Generator, n: int, std: float, shaped: bool) -> Array:
    """(n,) noise of one instrument.

    Shaped noise is Student's with 6 to 30 degrees of freedom, of first order with a correlation of -0.1 to 0.6 from
    sample to sample, and of 0.7 to 1.3 times the stated size. Other noise is white and Gaussian.
    """
    if std == 0.0 or n == 0:
        return np.zeros(n)
    if not shaped:
        return std * rng.standard_normal(n)
    freedom, colour, factor = rng.uniform(6.0, 30.0), rng.uniform(-0.1, 0.6), rng.uniform(0.7, 1.3)
    white = rng.standard_t(freedom, n) * np.sqrt((freedom - 2.0) / freedom)
    return std * factor * np.clip(_first_order(rng, white, colour), -LIMIT, LIMIT)


def _first_order(rng: np.random.Generator, white: Array, colour: float) -> Array:
    """(n,) noise of unit size and of a correlation `colour` from sample to sample, steady from the first one."""
    gain = np.sqrt(1.0 - colour**2)
    start = lfiltic([gain], [1.0, -colour], [rng.standard_normal()])
    coloured, _ = lfilter([gain], [1.0, -colour], white, zi=start)
    return np.asarray(coloured, float)


def turbulence(rng: np.random.Generator, times: Array, std: float, correlation_time: float) -> Array:
    """(n,) Ornstein-Uhlenbeck process at evenly spaced `times`."""
    if std == 0.0 or len(times) < 2:
        return np.zeros(len(times))
    colour = float(np.exp(-(times[-1] - times[0]) / (len(times) - 1) / correlation_time))
    return std * _first_order(rng, rng.standard_normal(len(times)), colour)


class Smooth:
    """A smooth random function of time: Gaussian, of unit size, without content above its band.

    Far outside of the duration it is constant.
    """

    def __init__(self, rng: np.random.Generator, duration: float, band: float, columns: int = 1) -> None:
        margin = max(1.0, 4.0 / band)
        step = 1.0 / (8.0 * band)
        times = np.arange(-margin, duration + margin + 8.0 * step, step)
        white = rng.standard_normal((len(times), columns))
        # Forwards and backwards: the attenuation at the band's edge is the square of the filter's.
        low = sosfiltfilt(butter(4, 2.0 * band * step, output="sos"), white, axis=0)
        size = np.sqrt(2.0 * band * step * _SHAPE)
        self._spline = CubicSpline(times, low / size, axis=0)

    def __call__(self, times: Array) -> Array:
        """(n, columns) values at `times` (n,)."""
        return np.asarray(self._spline(np.clip(times, self._spline.x[0], self._spline.x[-1])), float)


# Part of the band's power that the filter, a Butterworth of fourth order applied twice, lets pass.
_SHAPE = float(np.trapezoid(1.0 / (1.0 + np.linspace(0.0, 4.0, 4001) ** 8) ** 2, np.linspace(0.0, 4.0, 4001)))


def quantise(values: Array, step: float, rounding: str) -> Array:
    """Values in whole steps: to the nearest (`round`), below (`floor`) or towards zero (`fix`)."""
    if step == 0.0:
        return values
    scaled = values / step
    if rounding == "round":
        return np.asarray(np.rint(scaled) * step, float)
    return np.asarray((np.floor(scaled) if rounding == "floor" else np.trunc(scaled)) * step, float)


def drawn_log(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between `low` and `high`, evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
