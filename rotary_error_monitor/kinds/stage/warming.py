"""What is not known of the temperature of a stage and of places of it, as nuisances.

Nobody measured it, or a thermometer has noise, a zero that is uncertain, and steps, and follows after a while.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import OWN_THERMOMETER
from rotary_error_monitor.description.streams import TEMPERATURE
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.kinds.stage.other_twin import Course, OtherTwin, Warmed
from rotary_error_monitor.metrology.thermometer_course import ThermometerCourse, class_b_uncertainty
from rotary_error_monitor.metrology.unread_temperature import UNKNOWN_COURSES, UNKNOWN_WARMING, unknown_warming
from rotary_error_monitor.sensors.library import sensor_of
from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import StageTwin

GAP = 3.5
"""Samples of a thermometer that may be missing at either end, as in a stream that has lost none."""

NOISY_COURSES = 8
"""Slow courses in which a smoothed thermometer errs that always count: a cause may go with it of which the twin says
nothing."""

UNSEEN = 0.5
"""Standard deviations of noise by which all readings of a recording together show a course in which a thermometer errs,
below which it is left out: it adds a quarter to the variance of what is as that course."""

RESPONSE = 5.0
"""Standard uncertainty of how long a thermometer is behind its place, s, where nobody states one.

Time constants of thin-film platinum elements in still air are 3 to 7 s by their data sheets; a place of some mass that
is itself behind its thermometer counts the other way.
"""

_SLOPE = 0.25
"""Time on either side, s, over which a warming is taken as straight."""


def uncertain_warmings(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins that warm by one standard uncertainty of each slow course."""
    if TEMPERATURE not in recording.streams:
        courses = _unknown(recording.duration)
    elif np.any(twin.stage.spindle.radial_thermal):
        read = recording.streams[TEMPERATURE]
        zero = twin.stage.uncertainty.get(OWN_THERMOMETER, class_b_uncertainty(float(np.mean(read.values))))
        constant = twin.stage.uncertainty.get(f"{OWN_THERMOMETER}_timing", RESPONSE)
        late = _behind(twin.inputs.warming, read, constant)
        seen = _seen(twin, "")
        courses = [*_misread(read, seen, zero), *late, *_unread(read, recording.duration)]
    else:
        courses = []
    whole = (OtherTwin(twin, Warmed(course)) for course in courses)
    places = (OtherTwin(twin, Warmed(course, place)) for place, course in _of_places(twin, recording))
    return (*whole, *places)


def _of_places(twin: StageTwin, recording: StageRecording) -> Iterator[tuple[str, Course]]:
    """Courses by place: of listed thermometers, and of what the twin states to go with one that nobody read."""
    read = {place: stream for place, stream in twin.stage.thermometers.items() if stream in recording.streams}
    stated = {cause.location for cause in twin.known if isinstance(cause.effect, StageEffect) and cause.effect.warms}
    for place, stream in read.items():
        sensor, known = twin.stage.inputs[stream], recording.streams[stream]
        seen = _seen(twin, place)
        yield from ((place, course) for course in _misread(known, seen, sensor.uncertainty, sensor.resolution))
        if place in stated:  # a cause that is looked for lags by a departure of its own
            constant = twin.stage.uncertainty.get(f"sensors.{place}.timing", RESPONSE)
            yield from ((place, course) for course in _behind(twin.inputs.warmings[place], known, constant))
        yield from ((place, course) for course in _unread(known, recording.duration))
    for place in sorted(stated - {"", *read}):
        yield from ((place, course) for course in _unknown(recording.duration))


def _unknown(last: float) -> list[Course]:
    """Powers of time up to `last`, s."""

    def course(power: int) -> Course:
        return lambda time: unknown_warming(np.asarray(time, np.float64) / last)[:, power]

    return [course(power) for power in range(UNKNOWN_COURSES)]


def _seen(twin: StageTwin, place: str) -> float:
    """Standard deviations of noise by which all readings of a recording together show one degree more."""
    warmer = OtherTwin(twin, Warmed(np.ones_like, place)).predict(())
    squares = 0.0
    for name, values in twin.predict(()).items():
        std = sensor_of(name).noise(twin.stage, name)
        squares += float(np.sum(np.square((warmer[name] - values) / std))) if std else 0.0
    return float(np.sqrt(squares))


def _misread(read: SignalStream, seen: float, zero: float, resolution: float = 0.0) -> Iterator[Course]:
    """By its zero, of a standard uncertainty, K, and how it rounds; then what noise, steps and jumps leave open.

    Args:
        read: by a thermometer.
        seen: standard deviations of noise by which the recording shows one degree.
        zero: standard uncertainty, K.
        resolution: K.
    """
    found = ThermometerCourse.of(read.time, read.values[:, 0], resolution)
    least = UNSEEN / seen if seen else np.inf
    yield from (_between(at, way) for at, way in found.ways(zero, NOISY_COURSES, least))


def _behind(warming: Course, read: SignalStream, constant: float) -> Iterator[Course]:
    """By how much a place is warmer, K, than a thermometer that follows it with a time constant, s, if it has one.

    Of first order, that is the constant times how fast the readings rise.
    """
    first, last = float(read.time[0]), float(read.time[-1])

    def course(time: Array) -> Array:
        within = np.clip(time, first + _SLOPE, max(last - _SLOPE, first + _SLOPE))
        return constant * (warming(within + _SLOPE) - warming(within - _SLOPE)) / (2 * _SLOPE)

    if constant:
        yield course


def _between(at: Array, values: Array) -> Course:
    return lambda time: np.interp(time, at, values)


def _unread(temperature: SignalStream, last: float) -> Iterator[Course]:
    """What warming may be before the first reading and behind the last, K: powers of time, as where nobody reads it.

    A thermometer that begins and ends with the recording, to a few of its samples, leaves nothing unread.
    """
    least = GAP * temperature.period

    def course(end: float, sign: float, power: int) -> Course:
        def unread(time: Array) -> Array:
            return UNKNOWN_WARMING * (2 * np.maximum(sign * (np.asarray(time, np.float64) - end), 0.0) / last) ** power

        return unread

    for end, sign, missing in (
        (float(temperature.time[0]), -1.0, float(temperature.time[0])),
        (float(temperature.time[-1]), 1.0, last - float(temperature.time[-1])),
    ):
        if missing > least:
            yield from (course(end, sign, power) for power in range(1, UNKNOWN_COURSES))
