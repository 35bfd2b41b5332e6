"""The kinds of sensor that a stage may have."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import rotary_error_monitor.sensors as room
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plugins import classes_in, modules_in
from rotary_error_monitor.sensors.sensor import Sensor

COMMAND = "command"
"""Channel of what the heads share against the command: as noisy as a head, in its unit."""


@cache
def sensor_kinds() -> Mapping[str, Sensor]:
    """Kinds of sensor by the first word of the names of their streams: those that this room defines."""
    found: list[Sensor] = [item() for module in modules_in(room) for item in classes_in(module, Sensor) if item.kind]
    return MappingProxyType({sensor.kind: sensor for sensor in found})


def kind_of(channel: str) -> str:
    """Kind of sensor of a channel: `head_a` is a `head`, `lvdt.x` is of the `lvdt`."""
    return channel.partition(".")[0].partition("_")[0]


def absent_kinds(stage: StageDescription) -> tuple[str, ...]:
    """Kinds of which a stage has no sensor."""
    return tuple(kind for kind, sensor in sensor_kinds().items() if not sensor.streams(stage))


def sensor_of(stream: str) -> Sensor:
    """The kind of sensor that a stream or channel is of."""
    return sensor_kinds()[kind_of(stream)]
