"""What is not known of the temperature of a stage and of places of it, as nuisances.

Nobody measured it, or the thermometer has noise and a zero that is uncertain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from rotary_error_monitor.effects.rotor import Array, RotorState, StageEffect
from rotary_error_monitor.twin.recording import StageRecording, Stream
from rotary_error_monitor.twin.stage import MEDIAN_OF_DIFFERENCES, Acting, StageTwin, turned_by

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
    whole = (_WarmedTwin(twin, course) for course in courses)
    places = (_WarmedTwin(twin, course, place) for place, course in _of_places(twin, recording))
    return (*whole, *places)


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


class _WarmedTwin(StageTwin):
    """A twin on another course of temperature, of the stage or a place; its states are the first one's but for that."""

    def __init__(self, twin: StageTwin, course: Course, place: str = "") -> None:
        before = twin.inputs.warmings.get(place, lambda time: np.zeros(len(time))) if place else twin.inputs.warming

        def warming(time: Array) -> Array:
            return np.asarray(before(time) + course(time), np.float64)

        inputs = replace(twin.inputs, warmings={**twin.inputs.warmings, place: warming})
        if not place:
            inputs = replace(twin.inputs, warming=warming)
        super().__init__(twin.stage, inputs, twin.times, twin.observed, twin.known, twin.keeps_states)
        self._cool = twin
        self._course, self._place = course, place

    def state(self, stream: str, delay: float = 0.0) -> RotorState:
        """The rotor at the sample times of a stream, `delay` seconds earlier."""
        return self._warm(self._cool.state(stream, delay))

    def _moved_state(self, stream: str, acting: Acting) -> RotorState:
        cool = self._cool._moved_state(stream, acting)
        # The first one's waves hold unless an effect turns the rotor by its temperature.
        before = self._warm(cool.unturned or cool)
        turned = before.theta + turned_by(acting, before)
        return self._warm(cool) if np.array_equal(turned, cool.theta) else super()._moved_state(stream, acting)

    def _warm(self, state: RotorState) -> RotorState:
        added = self._course(state.time - state.age)
        if not self._place:
            return replace(state, warming=state.warming + added, _kept={})
        return replace(state, warmings={**state.warmings, self._place: state.warmings.get(self._place, 0.0) + added})
