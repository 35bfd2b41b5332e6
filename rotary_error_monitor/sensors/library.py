"""The kinds of sensor that a stage may have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np

import rotary_error_monitor.sensors as room
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor, is_input
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plugins import classes_in, modules_of
from rotary_error_monitor.sensors.listed import ListedKind
from rotary_error_monitor.sensors.listed_input import ListedInput
from rotary_error_monitor.sensors.sensor import Sensor

ENTRY_POINTS = "rotary_error_monitor.sensors"
"""Group of the modules with kinds of sensors of other packages."""


@cache
def sensor_kinds() -> Mapping[str, Sensor]:
    """Kinds of sensor by the first word of the names of their streams: of this room, then of other packages.

    Raises:
        InputError: as `_kinds`.
    """
    return MappingProxyType({name: kind for name, kind in _kinds().items() if isinstance(kind, Sensor)})


@cache
def input_kinds() -> Mapping[str, ListedInput]:
    """Kinds of listed sensors that are inputs, by the first word of the names of their streams; as `sensor_kinds`."""
    return MappingProxyType({name: kind for name, kind in _kinds().items() if isinstance(kind, ListedInput)})


@cache
def _kinds() -> Mapping[str, Sensor | ListedInput]:
    """One object of each class with a `kind`, by that.

    Raises:
        InputError: a class of another package cannot be loaded or made, is of a kind that is known, or is none of those
            that a stage lists.
    """
    found: dict[str, Sensor | ListedInput] = {}
    for module, origin in modules_of(room, ENTRY_POINTS):
        for item in (*classes_in(module, Sensor), *classes_in(module, ListedInput)):
            if not item.kind:
                continue
            if item.kind in found:
                raise InputError(f"{origin}: sensor kind '{item.kind}' is already known; choose another name")
            base = ListedInput if is_input(item.kind) else ListedKind
            if not (module.__name__.startswith(f"{room.__name__}.") or issubclass(item, base)):
                raise InputError(
                    f"{origin}: class {item.__name__} of sensor kind '{item.kind}' is none of {base.__name__}, as its "
                    "section says; derive it from that"
                )
            try:
                found[item.kind] = item()
            except TypeError as error:  # what it has to say is left out
                raise InputError(f"{origin}: sensor kind '{item.kind}': {error}") from error
    return MappingProxyType(found)


def input_of(stream: str) -> ListedInput | None:
    """The kind of a stream that is a listed sensor's which is an input; None of any other stream."""
    kinds = (kind for name, kind in input_kinds().items() if stream.startswith(f"{name}_"))
    return max(kinds, key=lambda kind: len(kind.kind), default=None)


@cache
def kind_of(channel: str) -> str:
    """Kind of sensor of a channel: `head_a` is a `head`, `axial_probe_top.x` an `axial_probe`."""
    stream = channel.partition(".")[0]
    kinds = (kind for kind in sensor_kinds() if stream == kind or stream.startswith(f"{kind}_"))
    return max(kinds, key=len, default=stream)


@cache
def is_listed(channel: str) -> bool:
    """Whether a channel is of a sensor that the stage lists by name."""
    return isinstance(sensor_kinds().get(kind_of(channel)), ListedKind)


@cache
def instrument_of(channel: str) -> str:
    """What a channel shares its noise with: all sensors of its kind, but of those that a stage lists it alone.

    Heads of one ring are alike; two probes of one kind may be of two makes.
    """
    return channel.partition(".")[0] if is_listed(channel) else kind_of(channel)


def listed_kind(sensor: ListedSensor) -> ListedKind:
    """The kind of a sensor that a stage lists.

    Raises:
        InputError: no class is of that kind, though a section is.
    """
    found = sensor_kinds().get(sensor.kind)
    if not isinstance(found, ListedKind):
        raise InputError(f"sensor kind '{sensor.kind}': {without_class()}")
    return found


def without_class() -> str:
    """What is wrong with a kind of sensor that is described and nothing more."""
    return f"it has a section, but no class in {room.__name__} or among the entry points of '{ENTRY_POINTS}'"


@dataclass(frozen=True)
class ListedField:
    """One field of a sensor that a stage lists.

    Attributes:
        stream: of the sensor.
        number: of the sensor in the list.
        place: of the field in a sample.
        sensor: as described.
        kind: of it.
    """

    stream: str
    number: int
    place: int
    sensor: ListedSensor
    kind: ListedKind


def listed_fields(stage: StageDescription) -> tuple[ListedField, ...]:
    """All fields of all sensors that a stage lists, one after another: those of a sensor stand together."""
    kinds = [(stream, sensor, listed_kind(sensor)) for stream, sensor in stage.sensors.items()]
    return tuple(
        ListedField(stream, number, place, sensor, kind)
        for number, (stream, sensor, kind) in enumerate(kinds)
        for place in range(len(kind.fields))
    )


def listed_sensitivity(fields: Sequence[ListedField]) -> Array:
    """(p, 6) what p fields see of the components of error motion."""
    return np.array([field.kind.rows(field.sensor)[field.place] for field in fields]).reshape(-1, 6)


def absent_kinds(stage: StageDescription) -> tuple[str, ...]:
    """Kinds of which a stage has no sensor."""
    return tuple(kind for kind, sensor in sensor_kinds().items() if not sensor.streams(stage))


def sensor_of(stream: str) -> Sensor:
    """The kind of sensor that a stream or channel is of."""
    return sensor_kinds()[kind_of(stream)]
