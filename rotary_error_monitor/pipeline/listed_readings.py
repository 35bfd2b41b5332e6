"""What listed sensors show at the ticks of an estimate, beside what is known of the rotor without them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.error_motion import (
    COMPONENTS,
    ErrorMotion,
    described_error_motion,
    reading_variance,
)
from rotary_error_monitor.metrology.rigid_motion import LEAST_VARIANCE, redundant_sensors
from rotary_error_monitor.pipeline.evidence import INDEX, SIGMAS
from rotary_error_monitor.pipeline.verdict import DOUBTS
from rotary_error_monitor.sensors.library import listed_fields, listed_sensitivity
from rotary_error_monitor.signals.resampling import FEWEST_TO_FIT, GUARD, Resampled

UNVERIFIED = 1 << DOUBTS.index("unverified")
LIMIT = 2.0
"""Times what the stage can do at most by which a displacement is no contradiction: the description may be the opposite
of the truth."""

TURNED = 1e-6
"""Rotation, rad, over which the slope of a form is taken: a wave of the highest order that a file states is straight
over it to a hundredth, and it is far above rounding."""


@dataclass(frozen=True)
class ListedTicks:
    """What p fields of listed sensors show at m ticks, each in its own unit, m or rad.

    Attributes:
        theta: (m,) rotation, rad.
        components, covariance, observable: (m, 6), (m, 6, 6), (m, 6) error motion without them.
        there: (m, p) whether it can be used.
        raw: (m, p) what the sensor says.
        reading: (m, p) displacement less what the sensor says of a perfect axis.
        surplus: (m, p) of that what neither the other sensors nor the description predict.
        undescribed: (m, p) what the description alone does not predict.
        noise: (m, p) variance of a reading.
        systematic: (m, p) variance of what stays as it is from tick to tick.
        variance: (m, p) of the surplus, by noise of the sensor and of what is predicted.
        others: (m, p) of the surplus by what other sensors have wrong beside their noise, and by `late`.
        stamps: (m, p) standard deviation of that part of it which wanders: by stamps, and by the air before the
            autocollimator.
        unknown: (m, p) largest displacement by components that nothing else shows.
        rate: (m, p) fastest change of that, per s.
        turned: (m, p) displacement by form that one standard deviation of the rotation makes, where the command alone
            tells it, or heads that do not tell it apart from displacement.
        tilt: (m, p) of `variance` the noise of the autocollimator, also by the lever of a probe: it comes at its rate.
        late: (m, p) displacement that the sensor's reading goes through in one standard deviation of its own stamps.
        doubts: (m,) bit mask of what was not believed, bits as in `DOUBTS`.
        refused: (m, 3) tilt of an autocollimator that the listed sensors contradict, and its variance by noise; else
            NaN.
    """

    theta: Array
    components: Array
    covariance: Array
    observable: NDArray[np.bool_]
    there: NDArray[np.bool_]
    raw: Array
    reading: Array
    surplus: Array
    undescribed: Array
    noise: Array
    systematic: Array
    variance: Array
    others: Array
    stamps: Array
    unknown: Array
    rate: Array
    turned: Array
    tilt: Array
    late: Array
    doubts: NDArray[np.int64]
    refused: Array

    @property
    def bound(self) -> Array:
        """(m, p) largest surplus of a tick that is no contradiction, m."""
        return np.asarray(self.unknown + SIGMAS * np.sqrt(self.variance + self.systematic + self.others))

    @property
    def common(self) -> Array:
        """(m, p) variance of each reading by the rotation and by its stamps, as if each had a rotation of its own.

        One rotation is wrong for all p alike: its covariance matrix is at most p times its diagonal (Cauchy). So are
        the stamps of a sensor for all of its fields.
        """
        return np.asarray(self.there.sum(axis=1, keepdims=True) * self.turned**2 + self.late**2)

    def part(self, chosen: slice) -> ListedTicks:
        """The same of some of the ticks."""
        return ListedTicks(*(values[chosen] for values in self._arrays()))

    def followed_by(self, other: ListedTicks) -> ListedTicks:
        """Both, one after the other."""
        pairs = zip(self._arrays(), other._arrays(), strict=True)
        return ListedTicks(*(np.concatenate(pair) for pair in pairs))

    def _arrays(self) -> tuple[Any, ...]:
        return tuple(vars(self).values())


class ListedReadings:
    """Makes of the samples of a stage's listed sensors what they show at ticks.

    Attributes:
        fields: p of the sensors.
        sensitivity: (p, 6) what each sees of the components.
        stated: (p,) variance of zero and form as stated, m² or rad².
        late: streams of the fields whose latency is uncertain.
    """

    def __init__(self, stage: StageDescription, period: float) -> None:
        """Sensors of `stage`, at ticks that are `period` (s) apart."""
        self._fitted = (1.0 - GUARD) * period
        self._timing = [stage.timing(f"sensors.{name_of(f.stream, f.sensor)}") for f in listed_fields(stage)]
        self.late = [f.stream for f, timing in zip(listed_fields(stage), self._timing, strict=True) if timing]
        self._spindle, self._commanded = stage.spindle, stage.encoder is None
        self.fields = listed_fields(stage)
        self._checked: dict[tuple[bytes, bytes], NDArray[np.bool_]] = {}
        self.sensitivity = listed_sensitivity(self.fields)
        limits = stage.limits
        most = np.array([*limits.components[:5], 0.0])
        rate = [limits.radial_rate, limits.radial_rate, limits.axial_rate, limits.tilt_rate, limits.tilt_rate, 0.0]
        self._most, self._rate = np.abs(self.sensitivity) * LIMIT * most, np.abs(self.sensitivity) * np.array(rate)
        zeros = [stage.zero_uncertainty(field.stream) or 0.0 for field in self.fields]
        self.stated = np.array([field.sensor.uncertainty**2 for field in self.fields])
        self.stated += [(zero / field.sensor.gain) ** 2 for zero, field in zip(zeros, self.fields, strict=True)]
        forms = [field.kind.forms(field.sensor)[field.place] for field in self.fields]
        air = stage.autocollimator.turbulence if stage.autocollimator else None
        # what is held against a field that sees tilt alone is the autocollimator's, not a small part of it by a lever
        alone = ~self.sensitivity[:, :3].any(axis=1, keepdims=True)
        self._through_air = np.where(alone, self.sensitivity[:, 3:5] ** 2, 0.0)
        self._air = air.std**2 if air else 0.0
        self._forms = np.array([sum(row.cos**2 + row.sin**2 for row in form) for form in forms])

    def checked(self, known: NDArray[np.bool_], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(p,) which fields are of sensors whose fault would show in what all the others say.

        Args:
            known: (6,) components that others show.
            used: (p,) fields that are used; of the others it is true.
        """
        case = known.tobytes(), used.tobytes()
        if case not in self._checked:
            owner = np.array([field.number for field in self.fields], np.intp)
            owners, own = np.unique(owner[used], return_inverse=True)
            seen = redundant_sensors(known, self.sensitivity[used], own)
            self._checked[case] = ~np.isin(owner, owners[~seen])
        return self._checked[case]

    def make(
        self,
        motion: ErrorMotion,
        evidence: Array,
        there: NDArray[np.bool_],
        sampled: Mapping[str, Resampled],
        rates: Mapping[str, float | Array],
        late_tilt: Array | None = None,
        refused: Array | None = None,
        turned_by: Array | None = None,
    ) -> ListedTicks:
        """What the sensors show at m ticks.

        Args:
            motion: the estimate without them.
            evidence: (m, e) what the ticks say, columns as in `pipeline.evidence`.
            there: (m, p) which readings can be used.
            sampled: each stream at the ticks.
            rates: samples per s around each tick of each stream whose latency is uncertain.
            late_tilt: (m, 2) variance of the tilt by when the autocollimator read it, rad², where that is uncertain.
            refused: (m, 3) as in `ListedTicks`.
            turned_by: (m,) standard deviation of the rotation, rad, where heads do not tell it for sure.
        """
        described = described_error_motion(self._spindle, motion.theta)
        expected = np.where(motion.observable, motion.components, described)
        raw, reading, noise = self._read(motion.theta, sampled)
        turned = self._turned(motion.theta, motion.lag if self._commanded else turned_by)
        late = self._late(sampled, rates)
        # the form of a target is taken off at the wrong place while the zero of the rotation may be another one
        elsewhere = np.where(motion.doubts & UNVERIFIED, 1.0, 0.0)
        noisy, by_tilt, air, wandering = self._by_others(motion, evidence, late_tilt)
        alone = np.where(motion.observable, 0.0, 1.0)
        return ListedTicks(
            motion.theta,
            motion.components,
            motion.covariance,
            motion.observable,
            there,
            raw,
            reading,
            reading - _summed(expected, self.sensitivity),
            reading - _summed(described, self.sensitivity),
            noise,
            self.stated + elsewhere[:, None] * self._forms,
            noise + noisy,
            np.maximum(self._known(motion.covariance) - noisy, 0.0) + turned**2 + air + late**2,
            np.sqrt(wandering + late**2),
            _summed(alone, self._most),
            _summed(alone, self._rate),
            turned,
            np.maximum(by_tilt - air, 0.0),
            late,
            motion.doubts,
            np.full((len(motion.theta), 3), np.nan) if refused is None else refused,
        )

    def _by_others(
        self, motion: ErrorMotion, evidence: Array, late_tilt: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """(m, p) each variance of what others show of a displacement: by their noise; of that by the autocollimator's,
        with air; by air; and by what wanders beside noise: stamps of heads and autocollimator, and air.
        """
        seen, squares = motion.observable.astype(np.float64), self.sensitivity**2
        by_noise = seen * _noise_of(evidence)
        air = _summed(seen[:, 3:5] * self._air, self._through_air)
        late = _summed(seen[:, 3:5] * (np.zeros((1, 2)) if late_tilt is None else late_tilt), squares[:, 3:5])
        raised = np.maximum(motion.head_scale**2 - 1.0, 0.0)
        by_heads = raised[:, None] * _summed(by_noise[:, :2], squares[:, :2])
        return _summed(by_noise, squares), _summed(by_noise[:, 3:5], squares[:, 3:5]), air, by_heads + late + air

    def _turned(self, theta: Array, lag: Array | None) -> Array:
        """(m, p) displacement by form that one standard deviation of the rotation, `lag` (m,) rad, makes."""
        total = np.zeros((len(theta), len(self.fields)))
        if lag is not None:
            for column, field in enumerate(self.fields):
                nothing = np.zeros((1, len(field.sensor.fields)))
                there, ahead = (field.kind.displacement(field.sensor, nothing, at) for at in (theta, theta + TURNED))
                total[:, column] = (ahead - there)[:, field.place] * (lag / TURNED)
        return total

    def _late(self, sampled: Mapping[str, Resampled], rates: Mapping[str, float | Array]) -> Array:
        """(m, p) displacement that readings go through in one standard deviation of their stamps.

        All that a reading shows is late, what the target shows of itself as well as error motion: its rate of change is
        that of the samples themselves.
        """
        total = np.zeros((len(next(iter(sampled.values())).gain), len(self.fields)))
        for column, (field, timing) in enumerate(zip(self.fields, self._timing, strict=True)):
            seen = sampled[field.stream]
            rate = np.broadcast_to(rates.get(field.stream, 0.0), len(seen.gain))
            if timing == 0.0 or not rate.all():
                continue
            # an interpolation takes four samples, a fit those of its cell, which are not even: a rate tells it roughly
            is_fit = (seen.bend[:, field.place] == 0.0) & (2.0 * rate * self._fitted >= FEWEST_TO_FIT)
            passed = np.where(is_fit, self._fitted - 1.0 / rate, 3.0 / rate)
            alike = len(field.kind.fields)  # fields that are late together, see `ListedTicks.common`
            total[:, column] = math.sqrt(alike) * timing * seen.travel[:, field.place] / passed / abs(field.sensor.gain)
        return total

    def _read(self, theta: Array, sampled: Mapping[str, Resampled]) -> tuple[Array, Array, Array]:
        """(m, p) each what the sensors say, the displacement by that, and the variance of it by their noise."""
        raw, reading, noise = (np.zeros((len(theta), len(self.fields))) for _ in range(3))
        for column, field in enumerate(self.fields):
            seen, sensor, place = sampled[field.stream], field.sensor, field.place
            raw[:, column] = seen.values[:, place]
            reading[:, column] = field.kind.displacement(sensor, seen.values, theta)[:, place]
            noise[:, column] = reading_variance(sensor.noise, sensor.resolution, seen.gain, seen.travel[:, place])
            noise[:, column] = np.maximum(noise[:, column] / sensor.gain**2, LEAST_VARIANCE)
        return raw, reading, noise

    def _known(self, covariance: Array) -> Array:
        """(m, p) variance of what the estimate without the sensors says of each displacement."""
        total = np.zeros((len(covariance), len(self.sensitivity)))
        for place in range(len(COMPONENTS)):
            total += _summed(covariance[:, place], self.sensitivity) * self.sensitivity[:, place]
        return total


def _noise_of(evidence: Array) -> Array:
    """(m, 6) variance of each component by stated noise alone, m² and rad²; what stamps make lasts."""
    variance = np.zeros((len(evidence), len(COMPONENTS)))
    variance[:, :2] = evidence[:, [INDEX["radial_variance"]]]
    variance[:, 3:5] = evidence[:, [INDEX["tilt_variance"]]]
    return variance


def _summed(values: Array, weights: Array) -> Array:
    """(m, p) products of values (m, k) and weights (p, k), summed term by term: the bits of a tick are its own."""
    total = np.zeros((len(values), len(weights)))
    for place in range(values.shape[1]):
        total += values[:, place, None] * weights[:, place]
    return total
