"""What an axial probe sees: the height of the tilted face before it."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.plant.geometry import Plane, Turns, pierce_face, waves
from rotary_error_monitor.plant.scene import Scene


def seen(sensor: ListedSensor, scene: Scene) -> Array:
    """(n,) height of the face before the probe, its form included, m."""
    height, towards = _face(sensor, scene)
    return height + waves(sensor.forms[0], Turns(towards * scene.turns.once.conj()))


def _face(sensor: ListedSensor, scene: Scene) -> tuple[Array, Plane]:
    """Height (n,) m of the face before the probe, and the direction (n,) from the axis to the place that it sees."""
    azimuth, radius = sensor.place.get("azimuth", 0.0), sensor.place["radius"]
    towards = complex(np.cos(azimuth), np.sin(azimuth))
    height, place = pierce_face(radius * towards, scene.radial, scene.axial, scene.tilt)
    if radius == 0:  # about the axis the way that the rotor strays has no direction that would tell of the form
        return height, np.full_like(place, towards)
    return height, place / np.abs(place)
