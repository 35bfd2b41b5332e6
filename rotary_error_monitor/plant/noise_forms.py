"""Noise of instruments that is not as their data sheets state it: heavier tails, 1/f, a memory, hum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.noise import Noise, TurbulenceCourse

FORMS = ("tails", "flicker", "wander", "hum")
"""Names of the forms, as `draw_noise` takes them."""

SPREAD = 4.0
"""Ratio of the correlation times of which 1/f noise is made; a sum over them is 1/f within a few per cent."""

LONGEST = 200.0
"""Longest correlation time, s or poses: some times a usual recording."""


SHORTEST = 10.0
"""Samples that the shortest correlation time covers: noise that is faster drowns in the white one."""


class NoiseForm(ABC):
    """What becomes of normal noise of standard deviation 1."""

    @abstractmethod
    def shaped(self, normal: Array, noise: Noise, time: Array) -> Array:
        """(n, k) noise from normal noise (n, k) at the ascending times (n,) in s; more is drawn from `noise`."""


@dataclass(frozen=True)
class Tails(NoiseForm):
    """Student's t of the stated standard deviation: now and then a value that normal noise never has.

    Attributes:
        freedom: degrees of freedom, more than 2.
    """

    freedom: float

    def shaped(self, normal: Array, noise: Noise, time: Array) -> Array:
        """Quantile by quantile, so that a sample asked for again is the same."""
        from scipy.special import ndtr, stdtrit  # loads for a third of a second, and most instruments need none

        scale = np.sqrt((self.freedom - 2) / self.freedom)
        return np.asarray(scale * stdtrit(self.freedom, ndtr(normal)), np.float64)


@dataclass(frozen=True)
class Flicker(NoiseForm):
    """Noise of density 1/f beside the stated white one.

    Attributes:
        corner: frequency at which both densities are alike, Hz.
        rate: of the samples, Hz.
    """

    corner: float
    rate: float

    def shaped(self, normal: Array, noise: Noise, time: Array) -> Array:
        """White noise, and slow noise of correlation times a factor apart, each with the same variance.

        The one-sided density of noise of variance v and correlation time T is 4 v T / (1 + (2 pi f T)²); summed over
        T in ratios of `SPREAD` it is v / (f ln SPREAD). White noise of variance 1 has 2 / rate.
        """
        variance = 2 * self.corner * np.log(SPREAD) / self.rate
        total = normal.copy()
        for column in range(normal.shape[1]):
            longest = LONGEST
            while longest > SHORTEST / self.rate:
                own = Noise(noise.seed, f"{noise.name}_flicker_{column}_{longest:.3g}")
                total[:, column] += np.sqrt(variance) * TurbulenceCourse(own, longest).at(time)
                longest /= SPREAD
        return total


@dataclass(frozen=True)
class WanderingNoise(NoiseForm):
    """Noise that remembers itself for a while beside the stated white one, as that of air or of an oil film.

    Attributes:
        size: standard deviation, over the stated one.
        correlation_time: s or poses.
    """

    size: float
    correlation_time: float

    def shaped(self, normal: Array, noise: Noise, time: Array) -> Array:
        """White noise, and an Ornstein-Uhlenbeck process in each component."""
        total = normal.copy()
        for column in range(normal.shape[1]):
            own = Noise(noise.seed, f"{noise.name}_wander_{column}")
            total[:, column] += self.size * TurbulenceCourse(own, self.correlation_time).at(time)
        return total


@dataclass(frozen=True)
class Hum(NoiseForm):
    """A line of the mains in all instruments, of unlike phase.

    Attributes:
        frequency: Hz.
        amplitude: over the stated standard deviation.
    """

    frequency: float
    amplitude: float

    def shaped(self, normal: Array, noise: Noise, time: Array) -> Array:
        """White noise and the line."""
        phases = Noise(noise.seed, f"{noise.name}_hum").uniform(0, normal.shape[1]) * 2 * np.pi
        return normal + self.amplitude * np.cos(2 * np.pi * self.frequency * time[:, None] + phases)


def draw_noise(form: str, draw: np.random.Generator, rate: float, count: int) -> NoiseForm:
    """Noise of the named form, of drawn strength.

    Args:
        form: one of `FORMS`.
        draw: where chance comes from.
        rate: of the samples, Hz, or 1 for poses.
        count: of the samples: hum stays below what `count` of them show.

    Raises:
        InputError: there is no such form.
    """
    if form == "tails":
        return Tails(float(draw.uniform(3.5, 8.0)))
    if form == "flicker":
        cycles = float(np.exp(draw.uniform(*np.log((2.0, 20.0)))))  # of a recording, up to which it is 1/f
        return Flicker(cycles * rate / count, rate)
    if form == "wander":
        memory = float(np.exp(draw.uniform(*np.log((0.01, 0.25))))) * count / rate
        louder = float(np.exp(draw.uniform(*np.log((2.0, 30.0)))))  # than the white noise, at low frequencies
        return WanderingNoise(float(np.sqrt(louder / (2 * memory * rate))), memory)
    if form == "hum":
        seen = float(draw.uniform(1.5, 4.0))  # standard deviations; a search of all lines alarms from about 5.5
        return Hum(50.0 + float(draw.uniform(-0.1, 0.1)), seen * float(np.sqrt(2 / count)))
    raise InputError(f"no noise of form '{form}'; there are {', '.join(FORMS)}")
