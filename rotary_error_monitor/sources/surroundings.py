"""What acts on a stage behind third-party drivers: force on the shaft, and temperature."""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard


class WrenchDriver(Device):
    """Force of a load cell along x and y, N."""

    name = "wrench"
    meaning = "a load cell's driver that publishes geometry_msgs/WrenchStamped"
    serves = ("stage_force",)
    hears = True
    settings = (Setting("wrench.topic", "load_cell/wrench", "topic of a third-party driver: force in N"),)

    def open(self, instrument: Instrument) -> Heard:
        """Source of the forces."""
        return Heard(
            instrument.fields,
            instrument.setting("wrench.topic"),
            "geometry_msgs/msg/WrenchStamped",
            lambda message: (message.wrench.force.x, message.wrench.force.y),
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
        if instrument.fields != ("temperature",):
            raise InputError(f"{instrument.stream} shows {', '.join(instrument.fields)}; only a thermometer is read so")
        topic = instrument.setting("temperature.topic")
        return Heard(instrument.fields, topic, "sensor_msgs/msg/Temperature", lambda message: (message.temperature,))
