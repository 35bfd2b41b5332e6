"""What acts on a stage behind third-party drivers: force on the shaft, and temperature."""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard


class WrenchDriver(Device):
    """Force of a load cell along x and y, N."""

    name = "wrench"
    serves = ("stage_force",)
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
    """Temperature of a thermometer, °C."""

    name = "temperature"
    serves = ("stage_temperature",)
    settings = (
        Setting("temperature.topic", "thermometer/temperature", "topic of a third-party driver: temperature in °C"),
    )

    def open(self, instrument: Instrument) -> Heard:
        """Source of the temperatures."""
        return Heard(
            instrument.fields,
            instrument.setting("temperature.topic"),
            "sensor_msgs/msg/Temperature",
            lambda message: (message.temperature,),
        )
