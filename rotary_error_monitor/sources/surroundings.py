"""What acts on a stage behind third-party drivers: force on the shaft, and temperature."""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.streams import FORCE
from rotary_error_monitor.description.topics import samples_columns
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard

FORCE_UNITS = {"N": 1.0, "kN": 1e-3, "mN": 1e3, "kgf": 1 / 9.80665, "lbf": 1 / 4.4482216152605}
"""What one newton reads, by the unit; kilogram-force and pound-force as NIST SP 811 has them, exact."""


class WrenchDriver(Device):
    """Force along x and y of the stage's load cell, or of a listed one, in N unless its driver tells another unit."""

    name = "wrench"
    meaning = "a load cell's driver that publishes geometry_msgs/WrenchStamped"
    serves = ("stage_force", "listed_sensor")
    hears = True
    settings = (
        Setting("wrench.topic", "load_cell/wrench", "topic of a third-party driver: force in x and y, in N"),
        Setting("wrench.unit", "N", "unit of the forces in its messages", choices=tuple(FORCE_UNITS)),
    )

    def open(self, instrument: Instrument) -> Heard:
        """Source of the forces.

        Raises:
            InputError: the instrument is no load cell.
        """
        if instrument.fields != samples_columns(FORCE):
            raise InputError(f"{instrument.stream} shows {', '.join(instrument.fields)}; only a load cell is read so")
        newton = FORCE_UNITS[instrument.setting("wrench.unit")]
        return Heard(
            instrument.fields,
            instrument.setting("wrench.topic"),
            "geometry_msgs/msg/WrenchStamped",
            lambda message: (message.wrench.force.x / newton, message.wrench.force.y / newton),
        )


class TemperatureDriver(Device):
    """Temperature of the stage's thermometer, or of a listed one, °C."""

    name = "temperature"
    meaning = "a thermometer's driver that publishes sensor_msgs/Temperature"
    serves = ("stage_temperature", "listed_sensor")
    hears = True
    settings = (
        Setting("temperature.topic", "thermometer/temperature", "topic of a third-party driver: temperature in °C"),
    )

    def open(self, instrument: Instrument) -> Heard:
        """Source of the temperatures.

        Raises:
            InputError: the instrument is no thermometer.
        """
        if instrument.fields != samples_columns("temperature"):
            raise InputError(f"{instrument.stream} shows {', '.join(instrument.fields)}; only a thermometer is read so")
        topic = instrument.setting("temperature.topic")
        return Heard(instrument.fields, topic, "sensor_msgs/msg/Temperature", lambda message: (message.temperature,))
