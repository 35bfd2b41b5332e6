"""A displacement probe that looks along the axis at a face of the rotor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.sensors.listed import ListedKind


class AxialProbe(ListedKind):
    """Displacement along z of a place on the face: axial error motion, and beside the axis what tilt adds."""

    kind = "axial_probe"
    moved_by = ("sensors", "spindle.axial", "spindle.tilt")

    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """Z of a place that a small rotation vector (eac, ebc) tilts: ezc + y eac - x ebc."""
        azimuth, radius = place.get("azimuth", 0.0), place["radius"]
        return np.array([0.0, 0.0, 1.0, radius * np.sin(azimuth), -radius * np.cos(azimuth), 0.0])

    def surface(self, sensor: ListedSensor) -> str:
        """The face at a radius, from above or below by the way it counts; a place on the axis does not go round."""
        radius, side = sensor.place["radius"], ", counted the other way" if sensor.gain < 0 else ""
        return f"face at radius {radius:g} m{side}" if radius else ""
