"""What the kinds of listed sensors share that measure what acts on the stage, such as its temperature at a place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor, quantity


class ListedInput(ABC):
    """Base of the kinds of listed sensors that are inputs; one object stands for all sensors of a kind.

    They show nothing of how the rotor stands, so they are no `Sensor`: no twin predicts them, no estimate takes them.

    Attributes:
        kind: first word of the names of its streams: `thermometer` of `thermometer_bearing`.
        fields: of a sample, as its section `description/sensor_kinds/<kind>.py` names them.
        unit: of the fields, from there.
    """

    kind: ClassVar[str] = ""
    fields: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Take over what the section says."""
        if cls.kind:
            cls.fields, cls.unit = quantity(cls.kind)

    @abstractmethod
    def measured(self, sensor: ListedSensor, reading: Array) -> Array:
        """(n,) or (n, k) what acts on the stage, in `unit`, by readings (n, fields)."""

    def looked_at(self, sensor: ListedSensor) -> int:
        """Number of its fields that tell something, from the first: all, if its kind does not say otherwise."""
        return len(self.fields)
