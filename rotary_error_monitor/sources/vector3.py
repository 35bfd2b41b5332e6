"""An instrument with one axis or two behind a third-party driver that publishes vectors."""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard
from rotary_error_monitor.units import ANGLE_UNITS


class _Vector3Driver(Device):
    """The first components of a vector with a stamp, as many as a sample has fields; what one of SI reads is `size`."""

    meaning = "a driver that publishes geometry_msgs/Vector3Stamped"

    def open(self, instrument: Instrument) -> Heard:
        """Source of the vectors."""
        size = self.size(instrument)
        return Heard(
            instrument.fields,
            instrument.setting("vector3.topic"),
            "geometry_msgs/msg/Vector3Stamped",
            lambda message: (message.vector.x / size, message.vector.y / size)[: len(instrument.fields)],
        )

    def size(self, instrument: Instrument) -> float:
        """What one radian or one metre reads."""
        return 1.0


class TiltDriver(_Vector3Driver):
    """Tilt as a rotation vector, in rad unless its driver tells another unit."""

    name = "vector3"
    serves = ("autocollimator",)
    hears = True
    settings = (
        Setting("vector3.topic", "autocollimator/tilt", "topic of a third-party driver: rotation vector in rad"),
        Setting("vector3.unit", "rad", "unit of the components of its vectors", choices=tuple(ANGLE_UNITS)),
    )

    def size(self, instrument: Instrument) -> float:
        """What one radian reads."""
        return ANGLE_UNITS[instrument.setting("vector3.unit")]


class DisplacementDriver(_Vector3Driver):
    """Displacement, m."""

    name = "vector3"
    serves = ("lvdt",)
    hears = True
    settings = (Setting("vector3.topic", "lvdt/displacement", "topic of a third-party driver: displacement in m"),)


class ProbeDriver(_Vector3Driver):
    """What a listed sensor sees: a displacement in x, m, or a tilt in x and y, rad."""

    name = "vector3"
    serves = ("listed_sensor",)
    hears = True
    settings = (
        Setting(
            "vector3.topic",
            "probe/displacement",
            "topic of a third-party driver: displacement in x, in m; of a tilt sensor a rotation vector in rad",
        ),
    )
