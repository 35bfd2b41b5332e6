"""An instrument beside the rotor that sees the tilt of a mirror on it in two axes, such as a further autocollimator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.sensors.listed import MIRROR, ListedKind


class TiltSensor(ListedKind):
    """Tilt of a mirror about x and y, turned by the `roll` of the instrument as that of an autocollimator."""

    kind = "tilt_sensor"
    moved_by = ("sensors", "spindle.tilt")

    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """`R(roll)` of (eac, ebc), as in `description.response`."""
        cos, sin = np.cos(place.get("roll", 0.0)), np.sin(place.get("roll", 0.0))
        return np.array([[0.0, 0.0, 0.0, cos, -sin, 0.0], [0.0, 0.0, 0.0, sin, cos, 0.0]])

    def forms(self, sensor: ListedSensor) -> tuple[tuple[AngularHarmonic, ...], ...]:
        """Tilt and flatness of the mirror as the fields show them: the form is along the axes of the stage."""
        axes = self.sensitivity(sensor.place)[:, 3:5]
        parts = list(zip(*sensor.forms, strict=True))
        return tuple(
            tuple(AngularHarmonic(x.order, a * x.cos + b * y.cos, a * x.sin + b * y.sin) for x, y in parts)
            for a, b in axes.tolist()
        )

    def angle(self, sensor: ListedSensor, theta: Array) -> Array:
        """The rotation: all of a mirror turns before the instrument."""
        return theta

    def surface(self, sensor: ListedSensor) -> str:
        """The mirror: as if all looked at one, for a form of two mirrors shows better."""
        return MIRROR
