"""The temperature behind a thermometer's samples over time, and how these may have been read wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.course_jumps import jumps_of
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.metrology.smooth_course import FEWEST, SmoothCourse, smooth_course

STEADY = 0.5
"""Time, s, in which a stage's temperature stays what it is: samples of the sensor are averaged over it."""

LOUDEST = 0.5
"""Standard deviation of a thermometer's readings, K, beyond which it is the temperature's: that of a thermocouple."""


def class_b_uncertainty(temperature: float) -> float:
    """Standard uncertainty of the zero of a thermometer of which nobody states one, K, at a temperature, °C.

    That of an industrial platinum thermometer: class B of IEC 60751 allows 0.3 K and 0.005 of the temperature either
    way, anything within being as likely.
    """
    return (0.3 + 0.005 * abs(temperature)) / float(np.sqrt(3.0))


@dataclass(frozen=True)
class ThermometerJump:
    """One jump of a thermometer: a stage does not warm so fast.

    Attributes:
        moment: of it, s, between two samples.
        size: by how much it reads more from then on, K.
        std: standard uncertainty of that, K.
    """

    moment: float
    size: float
    std: float


@dataclass(frozen=True)
class ThermometerCourse:
    """What the samples of a thermometer tell of a temperature.

    Attributes:
        time: (n,) when it is told, s, ascending.
        course: at those times; of fewer than three samples each is what was read.
        reach: times of the first and last sample, s.
        jumps: of the thermometer, which the course does not have; it lies midway between the first reading's zero and
            the last one's, for nothing says which is right.
    """

    time: Array
    course: SmoothCourse
    reach: tuple[float, float]
    jumps: tuple[ThermometerJump, ...] = ()

    @classmethod
    def of(cls, time: Array, readings: Array, resolution: float = 0.0) -> ThermometerCourse:
        """Of readings (n,), °C, at ascending times (n,), s, in the steps of a resolution, K, or what they show."""
        jumps = thermometer_jumps(time, readings)
        for jump in jumps:
            readings = readings - jump.size * ((time > jump.moment) - 0.5)
        count, step = len(time), max(step_of(readings), resolution)
        span = float(time[-1] - time[0])
        usual = max(float(np.median(np.diff(time))) if count > 1 else STEADY, STEADY)
        rounds = max(round(span / usual), 1)
        place = np.rint((time - time[0]) * (rounds / max(span, usual))).astype(np.intp)
        read = np.bincount(place, minlength=rounds + 1)
        present = read > 0
        if np.count_nonzero(present) < FEWEST:
            return cls(time, SmoothCourse(readings, step), (float(time[0]), float(time[-1])), jumps)
        means = np.full((2, len(read)), np.nan)
        for mean, values in zip(means, (time, readings), strict=True):
            mean[present] = np.bincount(place, values, minlength=len(read))[present] / read[present]
        course = smooth_course(means[1], LOUDEST, step)
        at = np.where(present, means[0], time[0] + span / rounds * np.arange(len(read)))
        return cls(at, course, (float(time[0]), float(time[-1])), jumps)

    def ways(self, zero: float, most: int, least: float = np.inf) -> Iterator[tuple[Array, Array]]:
        """Times (m,), s, and what it may be wrong by then (m,), K, in independent ways of one standard deviation each.

        By a zero of a standard uncertainty, K, and how the thermometer rounds; by what noise and steps leave open, the
        largest `most` of it and all others of a root mean square of `least`, K; by the size of each jump.
        """
        apart = sum(jump.size for jump in self.jumps)
        ways = self.course.ways(float(np.hypot(zero, apart / 2)))
        noisy = np.sqrt(np.mean(np.square(ways), axis=0)) >= least
        noisy[: 1 + most] = True
        yield from ((self.time, way) for way in ways[:, noisy].T)
        for jump in self.jumps:
            ends = np.array([self.reach[0], jump.moment, np.nextafter(jump.moment, np.inf), self.reach[1]])
            yield ends, jump.std * np.array([-0.5, -0.5, 0.5, 0.5])

    def at(self, time: Array) -> Array:
        """(m,) temperature, °C, at times (m,); before the first and after the last sample as at those."""
        within = np.clip(time, *self.reach)
        if len(self.time) < FEWEST:
            return np.interp(within, self.time, self.course.values)
        # a straight line between readings of each second misses 15 mK of a temperature that swings within 8 s
        return np.asarray(self._spline(within), np.float64)

    @cached_property
    def _spline(self) -> Callable[[Array], Array]:
        from scipy.interpolate import CubicSpline  # loads for a while

        spline: Callable[[Array], Array] = CubicSpline(self.time, self.course.values, bc_type="natural")
        return spline


def thermometer_jumps(time: Array, readings: Array) -> tuple[ThermometerJump, ...]:
    """Jumps of a thermometer from readings (n,), °C, at ascending times (n,), s.

    None of one whose samples are so far apart that a stage warms between two of them.
    """
    period = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if period > STEADY:
        return ()
    found = jumps_of(np.rint((time - time[0]) / period), readings, LOUDEST)
    return tuple(ThermometerJump(float(time[j.before : j.before + 2].mean()), j.size, j.std) for j in found)
