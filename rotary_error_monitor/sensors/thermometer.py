"""A thermometer at a place of the stage: what goes with the warming of that place follows it."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.sensors.listed_input import ListedInput


class Thermometer(ListedInput):
    """Temperature of the place that it is called after."""

    kind = "thermometer"

    def measured(self, sensor: ListedSensor, reading: Array) -> Array:
        """(n,) temperature, °C."""
        return np.asarray(reading[:, 0] - sensor.zeros[0], np.float64)
