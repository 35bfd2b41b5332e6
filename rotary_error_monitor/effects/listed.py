"""What effects of the sensors that a stage lists by name share, whatever the fields and the unit of the sensors."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Values, place_of
from rotary_error_monitor.effects.rotor import LISTED, RotorState, StageEffect, fits

TOGETHER = "+"
"""Between the streams of sensors before one target, in the location of an effect of that target."""


def streams_of(location: str) -> tuple[str, ...]:
    """Streams of the listed sensors that an effect at a location moves."""
    return tuple(place_of(location).split(TOGETHER))


class ListedEffect(StageEffect):
    """Base of the effects of one listed sensor: it is located at the sensor's stream, and moves no other.

    One of a target is located at all sensors before it.

    A concrete one states `listed_unit` and `listed_fields`; of its parameters those with that unit have a value for
    each field.
    """

    acts_on: ClassVar[tuple[str, ...]] = (LISTED,)
    stands_out_in: ClassVar[tuple[str, ...]] = (LISTED,)

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each listed sensor of its unit and number of fields."""
        return tuple(stream for stream, sensor in machine.sensors.items() if fits(self, sensor))

    def touches(self, location: str, stream: str) -> bool:
        """Whether the stream is that of the sensor, or of one before the target."""
        return stream in streams_of(location)

    def changed(self, sensor: ListedSensor, values: Values) -> ListedSensor:
        """The sensor with the effect in its parameters."""
        return sensor

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """The description with the changed sensors."""
        before = {stream: stage.sensors[stream] for stream in streams_of(location)}
        after = {stream: self.changed(sensor, values) for stream, sensor in before.items()}
        same = all(after[stream] is sensor for stream, sensor in before.items())
        return stage if same else replace(stage, sensors={**stage.sensors, **after})


class ListedZero(ListedEffect):
    """Base of the effects that shift the zero of each field."""

    def changed(self, sensor: ListedSensor, values: Values) -> ListedSensor:
        """Add the shift to its zero."""
        return sensor.shifted(values.tolist())


class ListedGain(ListedEffect):
    """Base of the effects that scale all fields about their zeros."""

    rescales = True

    def changed(self, sensor: ListedSensor, values: Values) -> ListedSensor:
        """Scale its gain."""
        return replace(sensor, gain=sensor.gain * (1 + float(values[0])))


class ListedDrift(ListedEffect):
    """Base of the effects that move the zero of each field steadily."""

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add rate times time."""
        moved = values[0] * state.time if len(values) == 1 else state.time[:, None] * values
        return np.asarray(ideal + moved, np.float64)


class ListedForm(ListedEffect):
    """Base of the effects that add one more order to what a target shows over a turn."""

    orders = 100
    falling = True

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each listed sensor of its unit and number of fields, those before one target together."""
        found: dict[tuple[str, str], list[str]] = {}
        for stream in super().locations(machine):
            target = machine.sensors[stream].target
            found.setdefault(("target", target) if target else ("sensor", stream), []).append(stream)
        return tuple(map(TOGETHER.join, found.values()))

    @abstractmethod
    def row(self, values: Values) -> AngularHarmonic | PlanarHarmonic:
        """Of the target's form."""

    def changed(self, sensor: ListedSensor, values: Values) -> ListedSensor:
        """Add the order to the target's form."""
        return replace(sensor, form=(*sensor.form, self.row(values)))


class ListedWave(ListedForm):
    """Base of those whose target shows one field, by orders of the place on it."""

    def row(self, values: Values) -> AngularHarmonic:
        """Of the target's form."""
        return AngularHarmonic(round(values[0]), float(values[1]), float(values[2]))
