"""Effects of listed sensors that show one angle, such as a level with one axis, and of their targets."""

from __future__ import annotations

from rotary_error_monitor.effects.effect import Parameter, wave_of_order
from rotary_error_monitor.effects.listed import ListedDrift, ListedGain, ListedWave, ListedZero


class AngleSensorZero(ListedZero):
    """An angle sensor is set otherwise than the twin says."""

    name = "angle_sensor_zero"
    title = "zero of an angle sensor"
    remedy = "Set the sensor's zero, or state it."
    source = "setting of a level's zero by turning it round on the spot"
    parameters = (Parameter("shift", "rad", 1e-5, bound=1e-2),)
    listed_unit = "rad"
    listed_fields = 1


class AngleSensorGain(ListedGain):
    """An angle sensor reads angles too large or too small; its zero stays."""

    name = "angle_sensor_gain"
    title = "scale of an angle sensor"
    remedy = "Calibrate the scale against a small-angle generator and state it as gain of the sensor."
    source = "calibration of a level's sensitivity"
    parameters = (Parameter("relative", "1", 1e-2, bound=2.0),)
    listed_unit = "rad"
    listed_fields = 1


class AngleSensorDrift(ListedDrift):
    """An angle sensor's zero moves steadily."""

    name = "angle_sensor_drift"
    title = "drift of an angle sensor"
    remedy = "Let the sensor warm up, look for a holder that creeps, and set its zero again."
    source = "warming-up of the instrument and its holder, lowest order in time"
    parameters = (Parameter("rate", "rad/s", 1e-7, bound=1e-4),)
    listed_unit = "rad"
    listed_fields = 1


class AngleSensorForm(ListedWave):
    """What one angle sensor looks at shows one more order over a turn. Order 1 is a target askew."""

    name = "angle_sensor_form"
    title = "form error of an angle sensor's target, of one order"
    remedy = "State the target's form (or how it is askew) among the sensor's form, or align it."
    source = "Lou et al. 2019, Section 2.3 (mirror on the rotor), along one axis"
    parameters = wave_of_order("rad", 3e-6, bound=1e-2)
    listed_unit = "rad"
    listed_fields = 1
