"""The rotor's own motion about the command, which all heads see alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gamma

from rotary_error_monitor.arrays import Array


@dataclass(frozen=True)
class Jitter:
    """Spectrum of the rotor's motion about the command: `std^2` spread over frequencies below about `bandwidth`.

    The one-sided density is `A exp(-(f / bandwidth)^shape)`, smooth and falling as that of a rotor's inertia.
    """

    std: float = 2e-6
    bandwidth: float = 5.0
    shape: float = 1.2

    def density(self, frequency: Array) -> Array:
        """(n,) one-sided power density, rad^2/Hz."""
        area = self.bandwidth * gamma(1 + 1 / self.shape)
        exponent = self.shape * np.log(np.maximum(frequency, 1e-9) / self.bandwidth)
        power = np.exp(np.minimum(exponent, 6.4))
        return np.asarray(self.std**2 / area * np.exp(-power), np.float64)
