"""Error motion of an axis of rotation from what its sensors say: assembly errors removed, any height, with covariance.

Components in the order of ISO 230-1: `exc eyc ezc eac ebc ecc`: two radial, axial, two tilt, angular positioning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.metrology.harmonics import angular_sum, planar_sum
from rotary_error_monitor.metrology.kernel import Steps, chosen_kernel
from rotary_error_monitor.metrology.periodic_curves import graduation_error, mirror_form

COMPONENTS = ("exc", "eyc", "ezc", "eac", "ebc", "ecc")


@dataclass(frozen=True)
class ErrorMotion:
    """Error motion at m times, and what an estimate of it rests on.

    Attributes:
        theta: (m,) rotation, rad.
        components: (m, 6) exc eyc ezc (m) eac ebc ecc (rad); zero where not observable.
        observable: (m, 6) which components were determined.
        covariance: (m, 6, 6); zero rows and columns where not observable.
        times_ns: (m,) timestamp (ns) of each estimate.
        streams: (m,) bit mask of the streams that were used.
        doubts: (m,) bit mask of what was not believed, bits as in `DOUBTS` of the pipeline's belief.
        head_scale, tilt_scale: (m,) by which standard deviations from heads and autocollimator were multiplied.
        lag: (m,) uncertainty of ecc by a delay between heads and command, rad; without heads, of theta.
        unresolved, unresolved_tilt: (m,) root mean square of a vector that turns with the rotor, of which it is not
            told whether it is error motion, m and rad; part of the covariance.
        sensor_scale, sensor_conflict: (m,) by which standard deviations of the listed sensors were multiplied: for they
            scatter, and for they contradict one another.
    """

    theta: Array
    components: Array
    observable: Mask
    covariance: Array
    times_ns: NDArray[np.int64]
    streams: NDArray[np.int64]
    doubts: NDArray[np.int64]
    head_scale: Array
    tilt_scale: Array
    lag: Array
    unresolved: Array
    unresolved_tilt: Array
    sensor_scale: Array
    sensor_conflict: Array

    @staticmethod
    def of(theta: Array, components: Array, observable: Mask, covariance: Array) -> ErrorMotion:
        """Error motion by itself: at no time of a clock, of no stream, nothing of it doubted."""
        mask, one, zero = np.zeros(len(theta), np.int64), np.ones(len(theta)), np.zeros(len(theta))
        return ErrorMotion(
            theta, components, observable, covariance, mask, mask, mask, one, one, zero, zero, zero, one, one
        )

    @staticmethod
    def unknown(count: int) -> ErrorMotion:
        """Error motion at so many times of which nothing is known yet, its four first arrays to be filled in."""
        shape = (count, len(COMPONENTS))
        return ErrorMotion.of(
            np.zeros(count), np.zeros(shape), np.zeros(shape, np.bool_), np.zeros((*shape, len(COMPONENTS)))
        )

    @staticmethod
    def joined(parts: Sequence[ErrorMotion]) -> ErrorMotion:
        """One after another, of at least one."""
        if len(parts) == 1:
            return parts[0]
        return ErrorMotion(*(np.concatenate(each) for each in zip(*(part._arrays() for part in parts), strict=True)))

    def at(self, chosen: NDArray[np.int64] | Mask | slice) -> ErrorMotion:
        """The same at some of the times; of a slice, views."""
        return ErrorMotion(*(each[chosen] for each in self._arrays()))

    def said_of(
        self, times_ns: NDArray[np.int64], streams: NDArray[np.int64], said: Mapping[str, NDArray[Any]]
    ) -> ErrorMotion:
        """The same at times (ns), from some streams, with what is `said` of it: further fields by their names."""
        return ErrorMotion(**{**vars(self), "times_ns": times_ns, "streams": streams, **said})

    def hide(self, times: Mask, places: Sequence[int]) -> None:
        """Make the components at `places` not observable at some of the `times` (m,)."""
        for place in places:
            self.observable[times, place] = False
            self.components[times, place] = 0.0
            self.covariance[times, place] = self.covariance[times, :, place] = 0.0

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return tuple(vars(self).values())


def rotate(vector: tuple[float, float], theta: Array) -> Array:
    """(m, 2) a vector of the rotor's frame in the base's, at rotations `theta` (m,)."""
    cos, sin = np.cos(theta), np.sin(theta)
    turned = np.empty((len(theta), 2))
    turned[:, 0], turned[:, 1] = vector[0] * cos - vector[1] * sin, vector[0] * sin + vector[1] * cos
    return turned


def remove_graduation(reading: Array, azimuth: Array, encoder: Encoder) -> Array:
    """(m, h) readings of heads free of the graduation error G(azimuth - theta), each reading taken for theta.

    A reading differs from theta by eccentricity over radius, a few 1e-4 rad, which moves G by less than 1e-9 rad.
    """
    if not encoder.graduation and encoder.graduation_table is None:
        return reading
    return reading - graduation_error(encoder, azimuth - reading)


def remove_eccentricity(centre: Array, theta: Array, encoder: Encoder) -> Array:
    """(m, 2) radial error motion at the ring: its centre less the assembly eccentricity (Lou et al. 2019, Eq. 4-5)."""
    return centre - rotate(encoder.eccentricity, theta)


def remove_mirror(tilt: Array, theta: Array, mirror: Mirror) -> Array:
    """(m, 2) tilt error motion: the mirror's tilt less its assembly tilt and flatness (Lou et al. 2019, Equation 6)."""
    return tilt - rotate(mirror.tilt, theta) - mirror_form(mirror, theta)


def described_error_motion(spindle: Spindle, theta: Array) -> Array:
    """(m, 6) error motion (m, rad) that a spindle's description has at rotations `theta` (m,), rad."""
    motion = np.zeros((len(theta), len(COMPONENTS)))
    motion[:, :2] = planar_sum(spindle.radial, theta)
    motion[:, 2] = angular_sum(spindle.axial, theta)
    motion[:, 3:5] = planar_sum(spindle.tilt, theta)
    return motion


def radial_error_motion_at(components: Array, height: float) -> Array:
    """(m, 2) radial error motion at `height` above the ring, m (Abbe; Lou et al. 2019, Equation 7 in components)."""
    exc, eyc, eac, ebc = (components[:, i] for i in (0, 1, 3, 4))
    return np.stack([exc + height * np.tan(ebc), eyc - height * np.tan(eac)], axis=1)


def radial_covariance_at(covariance: Array, height: float) -> Array:
    """(m, 2, 2) covariance of `radial_error_motion_at` by propagation of (m, 6, 6)."""
    sensitivity = np.zeros((2, 6))
    sensitivity[0, [0, 4]] = 1.0, height
    sensitivity[1, [1, 3]] = 1.0, -height
    return np.asarray(sensitivity @ covariance @ sensitivity.T)


NO_STEP = 1e-6
"""A step smaller than this part of the noise adds less than a part in 1e12 to its variance."""


def reading_variance(noise: float, resolution: float, gain: Array, travel: Array) -> Array:
    """Variance of a resampled reading from the instrument's noise and resolution.

    Rounding adds resolution²/12. The part that noise does not break up, exp(-(2 pi noise/resolution)²) of its first
    harmonic, is shared by neighbouring samples and is averaged only as the signal moves across steps (sinc² of the
    travel, its envelope); the rest is independent from sample to sample.

    Args:
        noise: standard deviation of a sample before rounding.
        resolution: size of one step.
        gain: sum of the squared weights of the samples, of the shape of `travel` or one that goes with it.
        travel: how far the signal moves over the samples, of any shape.
    """
    if resolution <= NO_STEP * noise:
        return gain * noise**2 + np.zeros_like(travel)
    kernel, unbroken = chosen_kernel(), _unbroken(noise, resolution)
    if kernel is not None:
        of = Steps(noise**2, resolution, resolution**2, unbroken)
        if (found := kernel.reading_variance(of, gain, travel)) is not None:
            return found
    steps = np.pi * travel / resolution
    shared = unbroken / (1.0 + 2.0 * steps * steps)
    rounding = (gain + np.maximum(1.0 - gain, 0.0) * shared) * resolution**2 / 12
    return np.asarray(gain * noise**2 + rounding)


@lru_cache(maxsize=64)
def _unbroken(noise: float, resolution: float) -> float:
    """The part of the first harmonic of the rounding that noise does not break up."""
    return float(np.exp(-((2 * np.pi * noise / resolution) ** 2)))


BEND = (9 / 384) ** 2
"""Variance of an interpolation over the square of the third difference of its samples, see `bend_variance`."""


KINK = 1 / (9 * math.sqrt(3))
"""Part of a third difference that a cubic through even samples misses at most where the acceleration jumps once: the
largest x (1 - x²) / 6 between the middle ones, 0 to 1, of a parabola that begins just before the last one."""


def bend_variance(bend: Array) -> Array:
    """(m,) variance of a rotation against its command from what interpolation cannot follow, rad².

    A cubic through even samples misses at most 9/384 of their fourth difference. Where a ramp of speed lasts some
    samples, the fourth difference is about the third, `bend` (m, streams), which four samples give; heads miss alike,
    the command by itself.
    """
    return np.asarray(BEND * (np.max(np.abs(bend[:, :-1]), axis=1) ** 2 + bend[:, -1] ** 2))


def head_variance(
    encoder: Encoder, gain: Array, travel: Array, bend: Array | float = 0.0, stamps: Array | float = 0.0
) -> Array:
    """Variance of heads' resampled readings, rad², of the shape of `travel`.

    Heads are read at times of their own: what interpolation of each cannot follow is another. It is told by third
    differences, `bend`, as of `bend_variance`; 0 where times at which that matters are left out. It counts where it is
    more than a sample is uncertain by, with `stamps` (rad) by its stamp: scatter from sample to sample bends as well.
    """
    missed = BEND * np.square(bend)
    known = encoder.noise**2 + encoder.resolution**2 + np.square(stamps)
    return reading_variance(encoder.noise, encoder.resolution, gain, travel) + np.where(missed > known, missed, 0.0)


def tilt_variance(instrument: Autocollimator, gain: Array, travel: Array, bend: Array) -> Array:
    """Variance of components of the resampled tilt, rad², of the shape of `travel`; turbulence is not averaged.

    What turns with the rotor may turn by a large part of a turn between two samples: what interpolation cannot follow
    of it is told by the third differences, `bend`, as of `bend_variance`.
    """
    slow = 0.0 if instrument.turbulence is None else instrument.turbulence.std**2
    return reading_variance(instrument.noise, instrument.resolution, gain, travel) + (BEND * bend**2 + slow)
