"""What a radial probe sees: where its line meets the displaced and tilted artefact."""

from __future__ import annotations

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.plant.geometry import Turns, cut_artefact, waves
from rotary_error_monitor.plant.scene import Scene

ARTEFACT_RADIUS = 0.02
"""Radius, m, of the round artefact before radial probes: an artefact of usual size; no description tells it."""


def seen(sensor: ListedSensor, scene: Scene) -> Array:
    """(n,) displacement of the surface before the probe, its form included, m."""
    azimuth, height = sensor.place["azimuth"], sensor.place["height"]
    distance, cut = cut_artefact(azimuth, height, ARTEFACT_RADIUS, scene.radial, scene.axial, scene.tilt)
    towards = cut / ARTEFACT_RADIUS
    return distance - ARTEFACT_RADIUS + waves(sensor.forms[0], Turns(towards * scene.turns.once.conj()))
