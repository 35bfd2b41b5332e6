"""What is not known of the temperature of a stage and of places of it, and of the force on its shaft, as nuisances.

Nobody measured the temperature, or thermometer and load cell have noise and a zero that is uncertain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.description.sensor_section import SHAFT_FORCE
from rotary_error_monitor.effects.rotor import Array, RotorState, StageEffect
from rotary_error_monitor.metrology.forces import load_cell, shares
from rotary_error_monitor.twin.recording import StageRecording, Stream
from rotary_error_monitor.twin.stage import MEDIAN_OF_DIFFERENCES, Acting, StageInputs, StageTwin, turned_by

TEMPERATURE = "temperature"

UNKNOWN_WARMING = 3.0
"""Standard uncertainty of a stage's warming, K, while nobody measures it."""

UNKNOWN_COURSES = 4

NOISY_COURSES = 8
"""Slow courses in which a smoothed thermometer errs: it passes about seven, faster ones are smoothed away."""

Course = Callable[[Array], Array]


def uncertain_warmings(twin: StageTwin, recording: StageRecording) -> tuple[StageTwin, ...]:
    """Twins that warm by one standard uncertainty of each slow course."""
    if TEMPERATURE not in recording.streams:
        courses = _unknown(recording.duration)
    elif np.any(twin.stage.spindle.radial_thermal):
        courses = _noisy(recording.streams[TEMPERATURE])
    else:
        courses = []
    whole = (_OtherTwin(twin, _Warmed(course)) for course in courses)
    places = (_OtherTwin(twin, _Warmed(course, place)) for place, course in _of_places(twin, recording))
    return (*whole, *places)


def uncertain_forces(twin: StageTwin) -> tuple[StageTwin, ...]:
    """Twins with one standard uncertainty of the zero of each axis of the listed load cells more on the shaft."""
    sensors = [sensor for sensor in twin.stage.inputs.values() if sensor.measures == SHAFT_FORCE]
    cells = [load_cell(sensor) for sensor in sensors]
    found = []
    for sensor, cell, share in zip(sensors, cells, shares(cells) if cells else [], strict=True):
        size = sensor.uncertainty / abs(cell.gain)
        found += [_OtherTwin(twin, _Pushed(size * share @ axis)) for axis in cell.directions if size]
    return tuple(found)


def _of_places(twin: StageTwin, recording: StageRecording) -> Iterator[tuple[str, Course]]:
    """Courses by place: of listed thermometers, and of what the twin states to go with one that nobody read."""
    read = {place: stream for place, stream in twin.stage.thermometers.items() if stream in recording.streams}
    for place, stream in read.items():
        sensor = twin.stage.inputs[stream]
        noise = float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))
        zero = [_always(sensor.uncertainty)] if sensor.uncertainty else []
        yield from ((place, course) for course in (*zero, *_noisy(recording.streams[stream], noise)))
    stated = {cause.location for cause in twin.known if isinstance(cause.effect, StageEffect) and cause.effect.warms}
    for place in sorted(stated - {"", *read}):
        yield from ((place, course) for course in _unknown(recording.duration))


def _always(warming: float) -> Course:
    return lambda time: np.full(len(time), warming)


def _unknown(last: float) -> list[Course]:
    """Powers of time up to `last`, s."""

    def course(power: int) -> Course:
        return lambda time: UNKNOWN_WARMING * (2 * np.asarray(time, np.float64) / last - 1) ** power

    return [course(power) for power in range(UNKNOWN_COURSES)]


def _noisy(temperature: Stream, stated: float | None = None) -> list[Course]:
    """Cosines over the recording, each as large as white noise of the thermometer has it: as stated, K, or as seen."""
    count, begin = len(temperature.time), float(temperature.time[0])
    seen = float(np.median(np.abs(np.diff(temperature.values[:, 0])))) / MEDIAN_OF_DIFFERENCES if count > 1 else 0.0
    noise = seen if stated is None else stated
    span = max(float(temperature.time[-1]) - begin, np.finfo(np.float64).tiny)

    def course(order: int) -> Course:
        std = noise * np.sqrt((2 if order else 1) / count)
        return lambda time: std * np.cos(np.pi * order * np.clip((np.asarray(time, np.float64) - begin) / span, 0, 1))

    return [course(order) for order in range(NOISY_COURSES)]


@dataclass(frozen=True)
class _Warmed:
    """Another course of temperature, of the stage or a place."""

    course: Course
    place: str = ""

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        nothing = inputs.warmings.get(self.place, lambda time: np.zeros(len(time)))
        before = nothing if self.place else inputs.warming

        def warming(time: Array) -> Array:
            return np.asarray(before(time) + self.course(time), np.float64)

        if self.place:
            return replace(inputs, warmings={**inputs.warmings, self.place: warming})
        return replace(inputs, warmings={**inputs.warmings, "": warming}, warming=warming)

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        added = self.course(state.time - state.age)
        if not self.place:
            return replace(state, warming=state.warming + added, _kept={})
        return replace(state, warmings={**state.warmings, self.place: state.warmings.get(self.place, 0.0) + added})


@dataclass(frozen=True)
class _Pushed:
    """A force (2,) on the shaft, N, that was not noticed."""

    force: Array

    def inputs(self, inputs: StageInputs) -> StageInputs:
        """What drives the stage, with it."""
        before = inputs.force
        return replace(inputs, force=lambda time: np.asarray(before(time) + self.force, np.float64))

    def state(self, state: RotorState) -> RotorState:
        """A state of the rotor, with it."""
        return replace(state, force=np.asfortranarray(state.force + self.force), _kept={})


class _OtherTwin(StageTwin):
    """A twin with something else acting on it; its states are the first one's but for that."""

    def __init__(self, twin: StageTwin, change: _Warmed | _Pushed) -> None:
        inputs = change.inputs(twin.inputs)
        super().__init__(twin.stage, inputs, twin.times, twin.observed, twin.known, twin.keeps_states)
        self._plain, self._change = twin, change

    def state(self, stream: str, delay: float = 0.0) -> RotorState:
        """The rotor at the sample times of a stream, `delay` seconds earlier."""
        return self._change.state(self._plain.state(stream, delay))

    def _moved_state(self, stream: str, acting: Acting) -> RotorState:
        plain = self._plain._moved_state(stream, acting)
        # The first one's waves hold unless an effect turns the rotor by what is other.
        before = self._change.state(plain.unturned or plain)
        turned = before.theta + turned_by(acting, before)
        return (
            self._change.state(plain) if np.array_equal(turned, plain.theta) else super()._moved_state(stream, acting)
        )
