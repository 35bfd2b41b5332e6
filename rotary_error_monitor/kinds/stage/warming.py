"""What is not known of the temperature of a stage and of places of it, and of the force on its shaft, as nuisances.

Nobody measured the temperature, or thermometer and load cell have noise, a zero that is uncertain, and round in a way
that nobody states: one that cuts its readings off is wrong by half a step in the mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.sensor_section import SHAFT_FORCE
from rotary_error_monitor.description.stage import OWN_THERMOMETER
from rotary_error_monitor.description.streams import FORCE, TEMPERATURE
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.problem import FIRST_ORDER
from rotary_error_monitor.kinds.stage.other_twin import Course, Diluted, OtherTwin, Pushed, Warmed
from rotary_error_monitor.metrology.forces import LoadCell, load_cell, shares
from rotary_error_monitor.metrology.reading_noise import noise_of
from rotary_error_monitor.metrology.reading_steps import step_of
from rotary_error_monitor.metrology.thermometer_course import ThermometerCourse, class_b_uncertainty
from rotary_error_monitor.metrology.unread_temperature import UNKNOWN_COURSES, UNKNOWN_WARMING, unknown_warming
from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import NEIGHBOURS, StageTwin

GAP = 3.5
"""Samples of a thermometer that may be missing at either end, as in a stream that has lost none."""

NOISY_COURSES = 8
"""Slow courses in which a smoothed thermometer errs: it passes about seven, faster ones are smoothed away."""


def uncertain_warmings(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins that warm by one standard uncertainty of each slow course."""
    if TEMPERATURE not in recording.streams:
        courses = _unknown(recording.duration)
    elif np.any(twin.stage.spindle.radial_thermal):
        read = recording.streams[TEMPERATURE]
        zero = twin.stage.uncertainty.get(OWN_THERMOMETER, class_b_uncertainty(float(np.mean(read.values))))
        courses = [*_misread(read, zero), *_unread(read, recording.duration)]
    else:
        courses = []
    whole = (OtherTwin(twin, Warmed(course)) for course in courses)
    places = (OtherTwin(twin, Warmed(course, place)) for place, course in _of_places(twin, recording))
    return (*whole, *places)


def uncertain_forces(twin: StageTwin, recording: StageRecording) -> tuple[OtherTwin, ...]:
    """Twins with one standard uncertainty of the force on the shaft more.

    Of each axis of its load cells that is the zero of one that is listed, and half a step of a reading: less, which is
    a zero, or closer to 0. Of all it is a part of the force itself, see `_diluted`.
    """
    names = [name for name, sensor in twin.stage.inputs.items() if sensor.measures == SHAFT_FORCE]
    pushed: list[Pushed | Diluted] = []
    if names:
        sensors = [twin.stage.inputs[name] for name in names]
        cells = [load_cell(sensor) for sensor in sensors]
        for part in zip(names, sensors, cells, shares(cells), strict=True):
            pushed += _of_listed_cell(*part, recording)
        variances = [(each.noise**2 + each.resolution**2 / 4) / each.gain**2 for each in sensors]
    elif FORCE in recording.streams:
        read = recording.streams[FORCE]
        steps = [step_of(axis) for axis in read.values.T]
        seen = noise_of(read.values)
        for axis, (step, noise) in enumerate(zip(steps, seen, strict=True)):
            pushed += _of_own_cell(read, axis, step, float(noise))
        variances = [float(noise**2) + step**2 / 4 for noise, step in zip(seen, steps, strict=True)]
    if FORCE in recording.streams:
        pushed += _diluted(recording.streams[FORCE], max(variances))
    return tuple(OtherTwin(twin, push) for push in pushed)


@dataclass(frozen=True)
class ForceNoise:
    """Noise of the load cells, which moves what the twin predicts as a force would.

    Attributes:
        pushed: twins with one standard deviation of it more where a force acts, along each axis.
        period: of the samples of the force, s: within it, readings of other sensors share it.
    """

    pushed: tuple[OtherTwin, ...] = ()
    period: float = 0.0

    @classmethod
    def of(cls, twin: StageTwin, recording: StageRecording) -> ForceNoise:
        """As the readings of the force show it."""
        if FORCE not in recording.streams:
            return cls()
        read = recording.streams[FORCE]
        pushes = (Pushed(force, where_it_acts=True) for force in np.diag(noise_of(read.values)))
        return cls(tuple(OtherTwin(twin, push) for push in pushes), read.period)

    def squares(self, twin: StageTwin, stream: str) -> Array:
        """(n, fields) of what it adds to the predictions of a stream; those that share it count as one."""
        base = twin.predict((), [stream])[stream]
        moved = [np.square(push.beside(twin).predict((), [stream])[stream] - base) for push in self.pushed]
        period = float(np.median(np.diff(twin.times[stream]))) if len(base) > 1 else np.inf
        return np.asarray(sum(moved, np.zeros_like(base)) * max(self.period / period, 1.0), np.float64)


def _diluted(read: SignalStream, variance: float) -> Iterator[Diluted]:
    """What noise of the readings hides of a compliance: regression dilution (Fuller 1987, Equation 1.1.6).

    Steps count as half of them, which is the most: a reading on the edge of one jumps between two values.
    """
    part = variance / max(float(np.mean(np.square(read.values))), variance)
    if part > FIRST_ORDER:
        yield Diluted(part)


def _of_listed_cell(
    name: str, sensor: ListedSensor, cell: LoadCell, share: Array, recording: StageRecording
) -> Iterator[Pushed]:
    directions = [share @ axis / abs(cell.gain) for axis in cell.directions]
    if sensor.uncertainty:
        yield from (Pushed(sensor.uncertainty * direction) for direction in directions)
    read = recording.streams[name]
    if _matters(sensor.resolution, read.values[:, : cell.axes] - np.array(sensor.zeros[: cell.axes])):
        width = float(np.hypot(sensor.noise, sensor.resolution))
        for axis, direction in enumerate(directions):
            yield from _cut_off(sensor.resolution * direction, _side(read, axis, width))


def _of_own_cell(read: SignalStream, axis: int, step: float, noise: float) -> Iterator[Pushed]:
    """How the load cell of a topic of its own rounds, whose steps it shows."""
    if _matters(step, read.values):
        yield from _cut_off(step * np.eye(2)[axis], _side(read, axis, float(np.hypot(noise, step))))


def _cut_off(step: Array, side: Course) -> Iterator[Pushed]:
    """Half a step (2,) less and half a step closer to 0, where a force acts."""
    yield Pushed(step / 2, where_it_acts=True)
    yield Pushed(step / 2, side, where_it_acts=True)


def _matters(step: float, force: Array) -> bool:
    """Whether half a step is more of a force (n, k), along the axes of a cell, than what a twin may be wrong by."""
    return step / 2 > FIRST_ORDER * float(np.abs(force).max())


def _side(read: SignalStream, axis: int, width: float) -> Course:
    """Which side of zero a cell is on: 1 or -1, in between where neighbours read less than `width` in the mean.

    A single reading is there by its noise, and one that is cut off towards zero is right in the mean around it.
    """
    mean = uniform_filter1d(read.values[:, axis], NEIGHBOURS, mode="mirror")
    side = np.clip(mean / max(width, np.finfo(np.float64).tiny), -1.0, 1.0)
    return lambda time: np.interp(time, read.time, side)


def _of_places(twin: StageTwin, recording: StageRecording) -> Iterator[tuple[str, Course]]:
    """Courses by place: of listed thermometers, and of what the twin states to go with one that nobody read."""
    read = {place: stream for place, stream in twin.stage.thermometers.items() if stream in recording.streams}
    for place, stream in read.items():
        sensor = twin.stage.inputs[stream]
        misread = _misread(recording.streams[stream], sensor.uncertainty, sensor.resolution)
        yield from ((place, course) for course in (*misread, *_unread(recording.streams[stream], recording.duration)))
    stated = {cause.location for cause in twin.known if isinstance(cause.effect, StageEffect) and cause.effect.warms}
    for place in sorted(stated - {"", *read}):
        yield from ((place, course) for course in _unknown(recording.duration))


def _unknown(last: float) -> list[Course]:
    """Powers of time up to `last`, s."""

    def course(power: int) -> Course:
        return lambda time: unknown_warming(np.asarray(time, np.float64) / last)[:, power]

    return [course(power) for power in range(UNKNOWN_COURSES)]


def _misread(read: SignalStream, zero: float, resolution: float = 0.0) -> Iterator[Course]:
    """By its zero, of a standard uncertainty, K, and how it rounds; then what noise, steps and jumps leave open."""
    found = ThermometerCourse.of(read.time, read.values[:, 0], resolution)
    yield from (_between(at, way) for at, way in found.ways(zero, NOISY_COURSES))


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
