"""A displacement probe that looks along a radius at a round artefact of the rotor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.sensors.listed import ListedKind


class RadialProbe(ListedKind):
    """Displacement outwards of the artefact at a height: two probes at different heights show the tilt."""

    kind = "radial_probe"
    moved_by = ("sensors", "spindle.radial", "spindle.tilt")

    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """Radial error motion at the height along the azimuth (Lou et al. 2019, Equation 7 in components)."""
        cos, sin, height = np.cos(place["azimuth"]), np.sin(place["azimuth"]), place["height"]
        return np.array([cos, sin, 0.0, -height * sin, height * cos, 0.0])

    def surface(self, sensor: ListedSensor) -> str:
        """The artefact at a height."""
        return f"artefact at height {sensor.place['height']:g} m"
