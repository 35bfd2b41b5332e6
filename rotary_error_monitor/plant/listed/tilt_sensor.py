"""What a tilt sensor sees: the ray that a mirror on the rotor sends back."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.plant.geometry import as_columns, reflect, waves
from rotary_error_monitor.plant.scene import Scene


def seen(sensor: ListedSensor, scene: Scene) -> Array:
    """(n, 2) tilt of a mirror whose form is the tilt of the spot that is looked at, along the stage, rad."""
    x, y = (waves(form, scene.turns) for form in sensor.forms)
    tilt = reflect(scene.turns.once, 0j, scene.tilt, x + 1j * y)
    return as_columns(np.exp(1j * sensor.place.get("roll", 0.0)) * tilt)
