"""Effects of the displacement probes that a stage lists by name, and of the targets that they look at."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import AngularHarmonic, StageDescription
from rotary_error_monitor.effects.effect import Parameter, Role, Values, place_of
from rotary_error_monitor.effects.rotor import LISTED, Array, RotorState, StageEffect


class ProbeEffect(StageEffect):
    """Base of the effects of one listed sensor: it is located at the sensor's stream, and moves no other."""

    acts_on: ClassVar[tuple[str, ...]] = (LISTED,)
    stands_out_in: ClassVar[tuple[str, ...]] = (LISTED,)

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each listed sensor."""
        return tuple(machine.sensors)

    def touches(self, location: str, stream: str) -> bool:
        """Whether the stream is that of the sensor."""
        return stream == place_of(location)


class ProbeZero(ProbeEffect):
    """A probe stands nearer to its target, or further away, than the twin says."""

    name = "probe_zero"
    title = "zero of a probe"
    source = "setting of a displacement probe's zero (ISO 230-7, Annex A)"
    parameters = (Parameter("shift", "m", 1e-6, bound=1e-2),)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the shift to its zero."""
        sensor = stage.sensors[location]
        return _with_sensor(stage, location, replace(sensor, zero=sensor.zero + float(values[0])))


class ProbeGain(ProbeEffect):
    """A probe reads displacements too large or too small; its zero stays."""

    name = "probe_gain"
    title = "scale of a probe"
    source = "calibration of a displacement probe's sensitivity"
    parameters = (Parameter("relative", "1", 1e-2, bound=2.0),)
    rescales = True

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Scale its gain."""
        sensor = stage.sensors[location]
        return _with_sensor(stage, location, replace(sensor, gain=sensor.gain * (1 + float(values[0]))))


class ProbeDrift(ProbeEffect):
    """A probe's zero moves steadily."""

    name = "probe_drift"
    title = "drift of a probe"
    source = "warming-up of a probe, its amplifier and its holder, lowest order in time"
    parameters = (Parameter("rate", "m/s", 1e-8, bound=1e-5),)

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add rate times time."""
        return np.asarray(ideal + values[0] * state.time, np.float64)


class ProbeForm(ProbeEffect):
    """The target of one probe shows one more order over a turn. Order 1 is a target off centre, or a face askew."""

    name = "probe_form"
    title = "form error of a probe's target, of one order"
    source = "ISO 230-7, Annex (roundness and centring of the artefact); ISO 1101 (roundness, axial run-out)"
    parameters = (
        Parameter("order", "1", 1.0, role=Role.FIXED, bound=100, least=1),
        Parameter("cos", "m", 1e-6, bound=1e-3),
        Parameter("sin", "m", 1e-6, bound=1e-3),
    )
    orders = 100
    falling = True

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each listed sensor but those on the axis: they look at one and the same spot all the time."""
        return tuple(stream for stream, sensor in machine.sensors.items() if sensor.place.get("radius") != 0.0)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the target's form."""
        stream = place_of(location)
        row = AngularHarmonic(round(values[0]), float(values[1]), float(values[2]))
        sensor = stage.sensors[stream]
        return _with_sensor(stage, stream, replace(sensor, form=(*sensor.form, row)))


def _with_sensor(stage: StageDescription, stream: str, sensor: ListedSensor) -> StageDescription:
    return replace(stage, sensors={**stage.sensors, stream: sensor})
