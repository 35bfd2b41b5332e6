"""Effects of the sensors of angles that a stage lists by name, and of the mirrors that they look at."""

from __future__ import annotations

import math
from dataclasses import replace

from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.effects.autocollimator import planar_row
from rotary_error_monitor.effects.effect import Parameter, Values, planar_wave_of_order
from rotary_error_monitor.effects.listed import ListedDrift, ListedEffect, ListedForm, ListedGain, ListedZero


class TiltSensorZero(ListedZero):
    """A tilt sensor is aligned otherwise than the twin says."""

    name = "tilt_sensor_zero"
    title = "zero of a tilt sensor"
    remedy = "Set the sensor's zero, or state it."
    source = "alignment of an autocollimator to the axis average line"
    parameters = (Parameter("shift", "rad", 1e-5, 2, bound=1e-2),)
    listed_unit = "rad"
    listed_fields = 2


class TiltSensorGain(ListedGain):
    """A tilt sensor reads tilts too large or too small; its zero stays."""

    name = "tilt_sensor_gain"
    title = "scale of a tilt sensor"
    remedy = "Calibrate the scale against a small-angle generator and state it as gain of the sensor."
    source = "calibration of an autocollimator's scale factor"
    parameters = (Parameter("relative", "1", 1e-2, bound=2.0),)
    listed_unit = "rad"
    listed_fields = 2


class TiltSensorRoll(ListedEffect):
    """A tilt sensor is turned about its line of sight."""

    name = "tilt_sensor_roll"
    title = "tilt sensor turned about its line of sight"
    remedy = "Turn the sensor about its line of sight, or describe how its axes lie."
    source = "rotation of the measuring axes"
    parameters = (Parameter("angle", "rad", 1e-2, bound=math.pi),)
    listed_unit = "rad"
    listed_fields = 2
    rescales = True

    def changed(self, sensor: ListedSensor, values: Values) -> ListedSensor:
        """Add to its roll."""
        return replace(sensor, place={**sensor.place, "roll": sensor.place.get("roll", 0.0) + float(values[0])})


class TiltSensorDrift(ListedDrift):
    """A tilt sensor's zero moves steadily."""

    name = "tilt_sensor_drift"
    title = "drift of a tilt sensor"
    remedy = "Let the instrument warm up, shield it from draughts, and zero it again."
    source = "warming-up of the instrument and its holder, lowest order in time"
    parameters = (Parameter("rate", "rad/s", 1e-7, 2, bound=1e-4),)
    listed_unit = "rad"
    listed_fields = 2


class TiltSensorForm(ListedForm):
    """The mirror before one tilt sensor shows one more order over a turn. Order 1 is a mirror askew."""

    name = "tilt_sensor_form"
    title = "tilt or flatness of the mirror before a tilt sensor, of one order"
    remedy = "Align or calibrate the mirror before this sensor and state it among the sensor's form."
    source = "Lou et al. 2019, Section 2.3 (mirror on the rotor)"
    parameters = planar_wave_of_order("rad", 3e-6, bound=1e-2)
    listed_unit = "rad"
    listed_fields = 2

    def row(self, values: Values) -> PlanarHarmonic:
        """Of what the mirror shows."""
        return planar_row(values)
