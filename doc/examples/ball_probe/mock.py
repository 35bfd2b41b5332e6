"""What a ball probe sees of the mock stage, by exact geometry: where its line leaves the displaced ball."""

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.plant.geometry import Tilting, Turns, waves
from rotary_error_monitor.plant.scene import Scene

RADIUS = 0.0125
"""Of a master ball of 25 mm, m."""


def seen(sensor: ListedSensor, scene: Scene) -> NDArray[np.float64]:
    """(n,) displacement of the surface towards the probe, m; zero and gain are taken care of elsewhere."""
    azimuth, elevation, height = (sensor.place[name] for name in ("azimuth", "elevation", "height"))
    towards = np.exp(1j * azimuth)
    plane, z = Tilting(scene.tilt).in_space(np.zeros_like(scene.tilt), np.full(len(scene.time), height))
    plane, up = plane + scene.radial, z - height + scene.axial
    along = np.cos(elevation) * (plane * np.conj(towards)).real + np.sin(elevation) * up
    across = np.abs(plane) ** 2 + up**2 - along**2
    form = waves(sensor.forms[0], Turns(towards * scene.turns.once.conj()))
    return np.asarray(along + np.sqrt(RADIUS**2 - across) - RADIUS + form, np.float64)
