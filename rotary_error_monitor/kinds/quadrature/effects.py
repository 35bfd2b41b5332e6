"""Sub-divisional effects: what makes sine and cosine signals go round other than on a circle about zero.

Heydemann 1981 (Appl. Opt. 20, 3382): offset, unequal gain and quadrature error, orders 1 and 2 of the radius. Signals
that saturate have order 4 (Dai et al. 2004, Meas. Sci. Technol. 15, 444), hard limits all orders divisible by 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Complex
from rotary_error_monitor.effects.effect import Effect, Parameter, Role, Values, order_of, wave_of_order
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription

_HEYDEMANN = "Heydemann 1981, Appl. Opt. 20, 3382"


@dataclass(frozen=True)
class CircleState:
    """The ideal signals at n true phases: cosine + i sine, in counts.

    Attributes:
        turning: (n,) of length 1.
        amplitude: counts.
        signals: (n,) what the effects before this one leave.
    """

    turning: Complex
    amplitude: float
    signals: Complex


class QuadratureEffect(Effect[QuadratureDescription]):
    """An effect of sine and cosine signals.

    Attributes:
        rank: effects act in rising order: optics and photodiodes first, converters last.
        rescales: whether it is looked at beside the causes found: where signals are cut off, a gain shows otherwise.
            Not so harmonics and saturation: beside each other they differ by next to nothing, and that must not count.
        ends: whether its parameter `level` is where the recorded signals end.
    """

    rank: ClassVar[int] = 0
    rescales: ClassVar[bool] = False
    ends: ClassVar[bool] = False

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """(n,) by how much the point is displaced, cosine + i sine, counts."""
        raise TypeError(f"{type(self).__name__} does not say what it does")


class QuadratureError(QuadratureEffect):
    """The two signals are not a quarter of a period apart."""

    name = "quadrature_error"
    title = "phase between the signals"
    remedy = "Adjust the phase between the signals (head tilt, wave plate), or correct it by the fitted ellipse."
    source = _HEYDEMANN
    parameters = (Parameter("angle", "rad", 0.01, bound=0.5),)
    rank = 0
    rescales = True

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """The sine leads by the angle."""
        real, imaginary = state.signals.real, state.signals.imag
        lead = float(values[0])
        return np.asarray(1j * ((np.cos(lead) - 1) * imaginary + np.sin(lead) * real), np.complex128)


class UnequalGain(QuadratureEffect):
    """One signal is larger than the other."""

    name = "unequal_gain"
    title = "unequal gain of the signals"
    remedy = "Trim the gains, or correct them by the fitted ellipse."
    source = _HEYDEMANN
    parameters = (Parameter("relative", "1", 0.01, bound=0.5),)
    rank = 1
    rescales = True

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """The cosine is larger by half of it, the sine smaller."""
        return np.asarray(0.5 * values[0] * np.conj(state.signals), np.complex128)


class CircleHarmonic(QuadratureEffect):
    """The signals hold one more harmonic, which goes round backwards and shows in the radius as one order more.

    A harmonic that goes round forwards, and shows as one order less, looks the same in the radius, but its phase error
    has the other sign; amplifiers that saturate make the former.
    """

    name = "circle_harmonic"
    title = "harmonic of the circle"
    remedy = "Adjust the optics; what stays is corrected by the fitted harmonic."
    source = "Fourier series of the radius; order 4: Dai et al. 2004, Meas. Sci. Technol. 15, 444"
    parameters = wave_of_order("count", 1.0, bound=200.0, highest=12)
    orders = 12
    falling = True
    lowest = 3
    rank = 2

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """Radius changed by `cos cos(order phase) + sin sin(order phase)`."""
        order = order_of(location)
        wave = complex(values[1], values[2])
        return np.asarray(wave * state.turning ** (1 - order), np.complex128)


class SignalCompression(QuadratureEffect):
    """Both signals saturate gently."""

    name = "signal_compression"
    title = "amplifiers that saturate"
    remedy = "Lower the signals, or use amplifiers with more headroom."
    source = "third-order characteristic of an amplifier; orders 4 and 0 of the radius"
    parameters = (Parameter("relative", "1", 0.003, bound=0.5),)
    rank = 3

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """Each signal loses a part that grows as its cube; at its full amplitude it is the relative loss."""
        return _each(state.signals, lambda signal: -values[0] * signal**3 / state.amplitude**2)


class SignalOffset(QuadratureEffect):
    """The signals do not swing about zero."""

    name = "signal_offset"
    title = "offset of the signals"
    remedy = "Trim the offsets, or correct them by the fitted ellipse."
    source = _HEYDEMANN
    parameters = (Parameter("shift", "count", 3.0, 2, bound=200.0),)
    rank = 4
    rescales = True

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """Cosine and sine each by its shift."""
        return np.full(len(state.signals), complex(values[0], values[1]))


class SignalClipping(QuadratureEffect):
    """The converters end before the signals do.

    Where they end is where the recorded signals end: no sample is beyond.
    """

    name = "signal_clipping"
    title = "signals beyond the converters' range"
    remedy = "Lower the gain, so that the signals stay within the converters' range."
    source = "limit of an analogue-to-digital converter"
    parameters = (
        Parameter("level", "count", 500.0, 4, role=Role.FIXED, bound=2.0**32),
        Parameter("part", "1", 1.0, bound=2.0),
    )
    rank = 5
    ends = True

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """Takes away a part of what exceeds the levels (cosine above, below, sine above, below); part 1 cuts it off."""
        real, imaginary = state.signals.real, state.signals.imag
        return np.asarray(
            -values[4] * (_excess(real, values[:2]) + 1j * _excess(imaginary, values[2:4])), np.complex128
        )


def _excess(signal: NDArray[np.float64], levels: Values) -> NDArray[np.float64]:
    """What goes beyond a highest level and, negatively, beyond a lowest one; both told as positive numbers."""
    above, below = levels
    return np.asarray(np.maximum(signal - above, 0.0) - np.maximum(-signal - below, 0.0), np.float64)


def _each(signals: Complex, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Complex:
    """The same done to cosine and sine."""
    return np.asarray(change(signals.real) + 1j * change(signals.imag), np.complex128)
