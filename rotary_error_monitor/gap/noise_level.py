"""How loud the noise of an instrument is beside what is stated of it: the prior of that, whatever the thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from rotary_error_monitor.gap.slow_noise import LARGEST

OTHERWISE = 0.35
"""Standard deviation of the logarithm of noise that is not as stated, over what is stated: in 19 of 20 quieter noise is
no less than half of it, as data sheets state the noise at most."""

LOUDEST = float(np.exp(OTHERWISE * LARGEST))
"""Times the noise that somebody stated of an instrument beyond which it is none, as with slow noise (`LARGEST`): the
prior of the level holds it for less likely than a false alarm may be."""

LOUDEST_IN_MOTION = float(np.exp(np.sqrt(2) * OTHERWISE * LARGEST))
"""The same of an instrument at the speed at which it is loudest: by how much its noise grows is as uncertain again."""

LOUDEST_UNSTATED = LOUDEST**2
"""The same of noise that nobody stated: of an assumed one the logarithm is twice as uncertain."""

NOISIER = 0.05
"""Part by which noise differs from what is stated from which it is reported."""

SAME_LEVEL = 0.02
"""Part by which levels of noise may differ and be the same: limits of what is found change as much."""


@dataclass(frozen=True)
class NoiseLevel:
    """How many times the stated noise an instrument has.

    Attributes:
        value: times the stated standard deviation.
        variance: of its logarithm; 0 where the noise is as stated for certain.
    """

    value: float = 1.0
    variance: float = 0.0

    @property
    def dof(self) -> float:
        """Degrees of freedom of an estimate of the variance that is as uncertain; infinite for as stated."""
        return 0.5 / self.variance if self.variance > 0 else np.inf


def expected_level(found: float, variance: float) -> NoiseLevel:
    """Level of an instrument's noise, once its prior is counted.

    The noise is as stated or otherwise, each as likely beforehand, the logarithm of the level then half-normal
    (`OTHERWISE`) towards the side that is found.

    Args:
        found: estimate of the level from a recording.
        variance: of its logarithm, by the recording alone.
    """
    apart, both = float(np.log(found)), OTHERWISE**2 + variance
    log_odds = np.log(2.0) + 0.5 * (np.log(variance / both) + apart**2 * (1 / variance - 1 / both))
    otherwise, mean = float(expit(log_odds)), apart * OTHERWISE**2 / both
    spread = variance * OTHERWISE**2 / both + (1 - otherwise) * mean**2
    return NoiseLevel(float(np.exp(otherwise * mean)), otherwise * spread)
