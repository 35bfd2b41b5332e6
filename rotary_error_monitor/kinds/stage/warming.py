"""What is not known of a stage's temperature, as nuisances: nobody measured it, or the thermometer has noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rotary_error_monitor.effects.rotor import Array, RotorState
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
        return ()
    return tuple(_WarmedTwin(twin, course) for course in courses)


def _unknown(last: float) -> list[Course]:
    """Powers of time up to `last`, s."""

    def course(power: int) -> Course:
        return lambda time: UNKNOWN_WARMING * (2 * np.asarray(time, np.float64) / last - 1) ** power

    return [course(power) for power in range(UNKNOWN_COURSES)]


def _noisy(temperature: Stream) -> list[Course]:
    """Cosines over the recording, each as large as white noise of the thermometer has it."""
    count, begin = len(temperature.time), float(temperature.time[0])
    noise = float(np.median(np.abs(np.diff(temperature.values[:, 0])))) / MEDIAN_OF_DIFFERENCES if count > 1 else 0.0
    span = max(float(temperature.time[-1]) - begin, np.finfo(np.float64).tiny)

    def course(order: int) -> Course:
        std = noise * np.sqrt((2 if order else 1) / count)
        return lambda time: std * np.cos(np.pi * order * np.clip((np.asarray(time, np.float64) - begin) / span, 0, 1))

    return [course(order) for order in range(NOISY_COURSES)]


class _WarmedTwin(StageTwin):
    """A twin on another course of temperature; the rotor's states are the first one's but for that."""

    def __init__(self, twin: StageTwin, course: Course) -> None:
        def warming(time: Array) -> Array:
            return np.asarray(twin.inputs.warming(time) + course(time), np.float64)

        inputs = replace(twin.inputs, warming=warming)
        super().__init__(twin.stage, inputs, twin.times, twin.observed, twin.known, twin.keeps_states)
        self._cool = twin
        self._course = course

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
        return replace(state, warming=state.warming + self._course(state.time - state.age), _kept={})
