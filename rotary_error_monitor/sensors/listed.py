"""What the kinds of listed sensors share: each field shows one linear combination of the rotor's error motion."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor, name_of, quantity
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.sensors.sensor import Pose, RadialView, Sensor

ECCENTRIC = 1
"""Order of a target's form that is its eccentricity: a shift of a circle (e_x, e_y) is e_x cos(psi) + e_y sin(psi)."""

MIRROR = "mirror"
"""What sensors of tilt see of the rotor, the autocollimator among them."""


class ListedKind(Sensor):
    """Base of the kinds of sensors that a stage lists: displacement of one place of the rotor in one direction.

    Its `fields` and `unit` are those of its section, `description/sensor_kinds/<kind>.py`.
    """

    section = "sensors"
    is_needed = False

    def __init_subclass__(cls) -> None:
        """Take over what the section says."""
        if cls.kind:
            cls.fields, cls.unit = quantity(cls.kind)

    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """Those of the list that are of this kind."""
        return tuple(stream for stream, sensor in stage.sensors.items() if sensor.kind == self.kind)

    def noise(self, stage: StageDescription, stream: str) -> float:
        """Of a reading, in the unit of the kind."""
        sensor = stage.sensors[stream]
        return float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))

    def resolution(self, stage: StageDescription, stream: str) -> float:
        """Of a reading, in the unit of the kind."""
        return stage.sensors[stream].resolution

    @abstractmethod
    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """(6,) or (fields, 6) what each field shows of the components of error motion.

        The components are exc eyc ezc (m) eac ebc ecc (rad), each of size 1.

        To first order: a displacement of micrometres moves the place that is seen by less than a part in 10^4 of what
        the target's form changes there.
        """

    def forms(self, sensor: ListedSensor) -> tuple[tuple[AngularHarmonic, ...], ...]:
        """What the target shows in each field, by orders of `angle`."""
        return sensor.forms

    def angle(self, sensor: ListedSensor, theta: Array) -> Array:
        """(n,) angle that the orders of the form are of, rad, at rotations (n,): the place on a target that turns."""
        return sensor.place.get("azimuth", 0.0) - theta

    def surface(self, sensor: ListedSensor) -> str:
        """What of the rotor it sees, in the same words for all that see the same; empty where nothing turns."""
        place = [f"{name} {value:g}" for name, value in sorted(sensor.place.items()) if name != "azimuth"]
        return " ".join([f"target of kind {self.kind}", *(["at", ", ".join(place)] if place else [])])

    def rows(self, sensor: ListedSensor) -> Array:
        """(fields, 6) sensitivity of each field."""
        return np.atleast_2d(self.sensitivity(sensor.place))

    def displacement(self, sensor: ListedSensor, reading: Array, theta: Array) -> Array:
        """(n, fields) by which error motion moves the target: readings (n, fields) less what it says without that."""
        angle = self.angle(sensor, theta)
        form = [angular_sum(rows, angle) for rows in self.forms(sensor)]
        return np.asarray((reading - np.array(sensor.zeros)) / sensor.gain - np.stack(form, axis=1), np.float64)

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n,) reading, or (n, fields) of several, in the unit of the kind."""
        sensor = pose.stage.sensors[stream]
        angle = self.angle(sensor, pose.state.theta)
        parts = [
            zero + sensor.gain * _moved(angular_sum(form, angle), weights, pose)
            for zero, form, weights in zip(sensor.zeros, self.forms(sensor), self.rows(sensor), strict=True)
        ]
        return parts[0] if len(parts) == 1 else np.stack(parts, axis=1)

    def radial_view(self, stage: StageDescription, stream: str) -> RadialView | None:
        """Along its azimuth, of a sensor that states its height and sees no axial error motion."""
        sensor = stage.sensors[stream]
        if "height" not in sensor.place or len(sensor.forms) > 1 or self.rows(sensor)[:, 2].any():
            return None
        azimuth, size = sensor.place.get("azimuth", 0.0), abs(sensor.gain)
        once = [row for row in sensor.forms[0] if row.order == ECCENTRIC]
        form = tuple(row for row in sensor.forms[0] if row.order != ECCENTRIC)
        own, stated = f"{self.section}.{name_of(stream, sensor)}", stage.uncertainty
        return RadialView(
            axes=(f"{np.degrees(azimuth):.0f}deg",),
            directions=self.rows(sensor)[:, :2],
            height=sensor.place["height"],
            form=form,
            azimuth=azimuth,
            eccentricity=(sum(row.cos for row in once), sum(row.sin for row in once)),
            zero=sensor.zeros,
            scale=sensor.gain,
            noise=sensor.noise / size,
            resolution=sensor.resolution / size,
            gain=stated.get(f"{own}.gain", 0.0) / size,
            roll=stated.get(f"{own}.azimuth", 0.0),
            place=stated.get(f"{own}.height", 0.0),
            lasting=len(form) * sensor.uncertainty**2,
        )

    def within_range(self, stage: StageDescription, stream: str, shown: Array) -> Array:
        """The reading, which stays at the end of the range beyond it."""
        most = stage.sensors[stream].range
        return np.clip(shown, -most, most)


def _moved(form: Array, weights: Array, pose: Pose) -> Array:
    """(n,) what a target with a form (n,) shows of the error motion, by its sensitivity (6,)."""
    seen = form
    if np.any(weights[:2]):
        seen = seen + pose.radial() @ weights[:2]
    if weights[2]:
        seen = seen + weights[2] * pose.axial()
    if np.any(weights[3:5]):
        seen = seen + pose.tilt() @ weights[3:5]
    return np.asarray(seen, np.float64)
