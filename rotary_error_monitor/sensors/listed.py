"""What the kinds of listed sensors share: each shows one linear combination of the rotor's error motion."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.description.stage import ListedSensor, StageDescription
from rotary_error_monitor.effects.rotor import Array
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.sensors.sensor import Pose, Sensor


class ListedKind(Sensor):
    """Base of the kinds of sensors that a stage lists: displacement of one place of the rotor in one direction."""

    section = "sensors"
    fields = ("displacement",)
    unit = "m"
    is_needed = False

    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """Those of the list that are of this kind."""
        return tuple(stream for stream, sensor in stage.sensors.items() if sensor.kind == self.kind)

    def noise(self, stage: StageDescription, stream: str) -> float:
        """Of a reading, m of displacement."""
        sensor = stage.sensors[stream]
        return float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))

    @abstractmethod
    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """(6,) displacement that the sensor sees for each component of error motion, exc eyc ezc (1) eac ebc ecc (m).

        To first order: a displacement of micrometres moves the place that is seen by less than a part in 10^4 of what
        the target's form changes there.
        """

    def displacement(self, sensor: ListedSensor, reading: Array, theta: Array) -> Array:
        """(n,) m by which error motion displaces the target: readings (n,) less what the sensor says without it."""
        azimuth = sensor.place.get("azimuth", 0.0)
        return (reading - sensor.zero) / sensor.gain - angular_sum(sensor.form, azimuth - theta)

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n,) reading, m."""
        sensor = pose.stage.sensors[stream]
        azimuth, weights = sensor.place.get("azimuth", 0.0), self.sensitivity(sensor.place)
        seen = angular_sum(sensor.form, azimuth - pose.state.theta)
        if np.any(weights[:2]):
            seen = seen + pose.radial() @ weights[:2]
        if weights[2]:
            seen = seen + weights[2] * pose.axial()
        if np.any(weights[3:5]):
            seen = seen + pose.tilt() @ weights[3:5]
        return np.asarray(sensor.zero + sensor.gain * seen, np.float64)

    def within_range(self, stage: StageDescription, stream: str, shown: Array) -> Array:
        """The reading, which stays at the end of the range beyond it."""
        most = stage.sensors[stream].range
        return np.clip(shown, -most, most)
