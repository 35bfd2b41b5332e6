"""Synchronous error motion by its orders: waves a turn, with what the heads cannot tell from a graduation error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.spindle_figures import SignalNoise, TurnSpectrum
from rotary_error_monitor.metrology.turns import TurnProfiles

_NEIGHBOURS = 5
"""Orders of which the loudest scatter counts for the one in their middle: of two turns each alone has two degrees of
freedom, and a tone between two orders shows in both."""


@dataclass(frozen=True)
class OrderSpectrum:
    """Amplitudes of whole orders of the mean over the turns.

    Attributes:
        orders: (l,) 1, 2, … up to the cut-off of the filter, which is taken out of the amplitudes again.
        amplitude: (l,) in the signal's unit.
        uncertainty: (l,) its standard uncertainty; an amplitude below twice of it may be noise.
        hidden: orders at which a form error that nobody calibrated looks the same.
    """

    orders: NDArray[np.int64]
    amplitude: Array
    uncertainty: Array
    hidden: tuple[int, ...] = ()


def estimate_orders(
    turns: TurnProfiles, signal: int, noise: SignalNoise, hidden: Sequence[int] = ()
) -> OrderSpectrum | None:
    """Order spectrum of a signal; None without a whole turn. Whole turns at equal angles: no order leaks into another.

    Args:
        turns: profiles of whole turns.
        signal: number of the signal among them.
        noise: of the signal, by the covariance of the estimate; what is the same in each turn lies at hidden orders.
        hidden: orders at which a form error passes for this signal.
    """
    if turns.count == 0:
        return None
    profile = turns.summary(signal).mean
    orders = np.arange(1, turns.cut_off + 1)
    through = turns.transmission[orders]
    mean = np.fft.rfft(profile)[orders] * (2 / turns.points)
    spectrum = TurnSpectrum.of(turns, signal, profile, noise.random)
    # both parts of a complex amplitude have half of its variance, and a wave is twice its amplitude
    square = 2 * maximum_filter1d(spectrum.between, _NEIGHBOURS)[orders] / turns.count / through**2
    square += 2 * spectrum.unseen**2  # of whatever order
    square[0] += 2 * noise.turning**2
    known = tuple(order for order in hidden if order <= turns.cut_off)
    square[np.array(known, np.intp) - 1] += 2 * noise.shape**2
    return OrderSpectrum(orders, np.abs(mean) / through, np.sqrt(square), known)
