"""A load cell at a place of the stage: the rotor yields to the force on its shaft."""

from __future__ import annotations

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.streams import FORCE
from rotary_error_monitor.metrology.forces import load_cell
from rotary_error_monitor.sensors.listed_input import ListedInput


class Force(ListedInput):
    """Force in the plane of the stage, by a load cell of two axes or of one."""

    kind = FORCE

    def measured(self, sensor: ListedSensor, reading: Array) -> Array:
        """(n, 2) force along x and y of the stage, N; across a cell of one axis it is 0."""
        return load_cell(sensor).force(reading)

    def looked_at(self, sensor: ListedSensor) -> int:
        """The axes that it has."""
        return load_cell(sensor).axes
