"""The twin of a rotary stage: predicts each stream at its own sample times from command, force and temperature.

The true rotation is not an input. The twin assumes the command (with the drive effects that are given); what the heads
share beyond it is treated as the jitter of the rotor, as noise with its own spectrum, by `stage_noise`. A fault of one
head therefore never reaches the prediction of another stream.

What each kind of sensor shows of the rotor stands in `sensors`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor, name_of
from rotary_error_monitor.description.sensor_section import PLACE_TEMPERATURE, SHAFT_FORCE
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Cause, values_of
from rotary_error_monitor.effects.rotor import RotorState, StageEffect
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.metrology.thermometer_course import ThermometerCourse
from rotary_error_monitor.sensors.library import sensor_of
from rotary_error_monitor.signals.reading_noise import noise_of
from rotary_error_monitor.twin.commanded import CommandCurve
from rotary_error_monitor.twin.finite import check_finite
from rotary_error_monitor.twin.recording import SignalStream, StageRecording, measured

Signals = dict[str, Array]
"""Arrays (n, k) by stream."""

NEIGHBOURS = 25
"""Samples of a load cell that are judged together: their mean has a fifth of the noise of one, and at 100 Hz they last
a quarter of a second, which is shorter than a force acts on a shaft."""

_BEYOND_NOISE = 6.0
"""Standard deviations of their mean from which a force acts: chance does not get there in hours."""


@dataclass(frozen=True)
class StageInputs:
    """What drives the stage, as functions of time: command and speed (m,), force (m, 2), warming (m,).

    `warmings` are those of the places of listed thermometers, by their names, as far as they were recorded; `others`
    (m, k) what further listed inputs measured.
    """

    command: Callable[[Array], Array]
    omega: Callable[[Array], Array]
    force: Callable[[Array], Array]
    warming: Callable[[Array], Array]
    warmings: Mapping[str, Callable[[Array], Array]] = field(default_factory=dict)
    others: Mapping[str, Callable[[Array], Array]] = field(default_factory=dict)


def stage_inputs(
    recording: StageRecording, reference_temperature: float, listed: Mapping[str, ListedSensor] | None = None
) -> StageInputs:
    """Inputs from the recorded streams; `listed` are those that the stage lists, by their streams.

    The command is interpolated with its own velocity, so it holds under acceleration. Temperature is smoothed: its
    noise is the sensor's, and the stage is slower than that. Without a force stream no force acted, nor where a load
    cell shows nothing but its noise: a compliance must not be fitted to that.
    """
    command = recording.streams["command"]
    rotation = CommandCurve(command.time, command.values[:, 0], command.values[:, 1])
    force, temperature = recording.streams.get("force"), recording.streams.get("temperature")
    force_of = _no_force if force is None else _force(force)

    def nothing(time: Array) -> Array:
        return np.zeros(len(time))

    warmings = {
        name_of(stream, sensor): _warming(_measured(recording.streams[stream], stream, sensor), reference_temperature)
        for stream, sensor in (listed or {}).items()
        if sensor.measures == PLACE_TEMPERATURE and stream in recording.streams
    }
    own = nothing if temperature is None else _warming(temperature, reference_temperature)
    others = {
        name_of(stream, sensor): _course(_measured(recording.streams[stream], stream, sensor))
        for stream, sensor in (listed or {}).items()
        if sensor.measures not in (PLACE_TEMPERATURE, SHAFT_FORCE) and stream in recording.streams
    }
    return StageInputs(rotation.angle, rotation.speed, force_of, own, warmings, others)


def _no_force(time: Array) -> Array:
    return np.zeros((len(time), 2))


def _force(read: SignalStream) -> Callable[[Array], Array]:
    """(m, 2) force at any times (m,): a spline through the samples, and nothing between two that show none."""
    values = _above_noise(read.values)
    spline, acting = CubicSpline(read.time, values, axis=0), np.any(values, axis=1)

    def force(time: Array) -> Array:
        within = _within(time, read)
        after = np.clip(np.searchsorted(read.time, within), 1, len(acting) - 1)
        return np.asarray(np.where((acting[after] | acting[after - 1])[:, None], spline(within), 0.0), np.float64)

    return force


def _course(stream: SignalStream) -> Callable[[Array], Array]:
    """(m, k) values of a stream at any times (m,): straight between samples, the first and last beyond them."""
    columns = stream.values.T
    return lambda time: np.column_stack([np.interp(time, stream.time, column) for column in columns])


def _warming(temperature: SignalStream, reference: float) -> Callable[[Array], Array]:
    """Smoothed temperature above the reference, K, as a function of time; it stays at its first and last value."""
    course = ThermometerCourse.of(temperature.time, temperature.values[:, 0])
    return lambda time: course.at(time) - reference


def _measured(stream: SignalStream, name: str, sensor: ListedSensor) -> SignalStream:
    """What a listed input measures by its readings."""
    return SignalStream(stream.time, measured(name, sensor, stream.values))


def _above_noise(force: Array) -> Array:
    """Force (n, 2) with zero wherever its mean over neighbouring samples is within its own noise."""
    mean = uniform_filter1d(force, NEIGHBOURS, axis=0, mode="mirror")
    acting = np.any(np.abs(mean) > _BEYOND_NOISE * noise_of(force) / np.sqrt(NEIGHBOURS), axis=1)
    return np.where(maximum_filter1d(acting.astype(np.uint8), 2 * NEIGHBOURS + 1)[:, None] > 0, force, 0.0)


def _within(time: Array, stream: SignalStream) -> Array:
    """Times held inside the stream: a slow input stays at its first and last value."""
    return np.clip(time, stream.time[0], stream.time[-1])


@dataclass
class StageTwin:
    """A stage description with its inputs at the sample times of a recording.

    Attributes:
        stage: the description.
        inputs: what drives it.
        times: sample times of each predicted stream, s.
        observed: what each head read, rad; carries the phase of errors within a line.
        known: effects that the stage has besides the description's parameters.
        keeps_states: whether the rotor's states at the sample times are kept between predictions.
    """

    stage: StageDescription
    inputs: StageInputs
    times: dict[str, Array]
    observed: dict[str, Array] = field(default_factory=dict)
    known: tuple[Cause, ...] = ()
    keeps_states: bool = True
    _states: dict[str, RotorState] = field(default_factory=dict, repr=False)
    _moved: dict[str, tuple[tuple[tuple[str, str, bytes], ...], RotorState]] = field(default_factory=dict, repr=False)

    def predict(
        self,
        causes: Sequence[Cause] = (),
        streams: Sequence[str] | None = None,
        stage: StageDescription | None = None,
    ) -> Signals:
        """Predicted values (n, k) of each stream, or of those asked for, with the effects `causes` added.

        Args:
            causes: effects of the stage with their values.
            streams: names of streams; all by default.
            stage: another description than the twin's own.

        Raises:
            UnpredictableError: a value is not finite.
        """
        wanted = tuple(self.times) if streams is None else streams
        described = self.stage if stage is None else stage
        # A sight line beyond the ring, or an overflow, gives a number that is not finite: that is checked.
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            return {name: self._stream(name, (*self.known, *causes), described) for name in wanted}

    def driven_by(self, inputs: StageInputs) -> Self:
        """The same twin with other inputs."""
        return replace(self, inputs=inputs, _states={}, _moved={})

    @property
    def span(self) -> tuple[float, float]:
        """First and last sample time of all streams, s."""
        return min(float(t[0]) for t in self.times.values()), max(float(t[-1]) for t in self.times.values())

    def _moved_state(self, stream: str, acting: Acting) -> RotorState:
        """The rotor at the sample times of a stream as the effects delay it and turn it; the last one is kept.

        Many predictions in a row differ in other things than these.
        """
        moving = [(c, e) for c, e in acting if e.moves_rotor]
        if not moving:
            return self.state(stream)
        key = values_of([cause for cause, _ in moving])
        kept = self._moved.get(stream)
        if kept is not None and kept[0] == key:
            return kept[1]
        state = self.state(stream, sum(effect.delay(cause.values, cause.location) for cause, effect in moving))
        ahead = turned_by(moving, state)
        if np.any(ahead):
            state = state.rotated(ahead)
        if self.keeps_states:
            self._moved[stream] = key, state
        return state

    def state(self, stream: str, delay: float = 0.0) -> RotorState:
        """The rotor at the sample times of a stream, `delay` seconds earlier."""
        if delay != 0.0 or not self.keeps_states:
            return self.state_at(self.times[stream], delay, self.observed.get(stream))
        if stream not in self._states:
            self._states[stream] = self.state_at(self.times[stream], 0.0, self.observed.get(stream))
        return self._states[stream]

    def forget(self) -> None:
        """Give back the memory of the states."""
        self._states.clear()
        self._moved.clear()

    def state_at(self, time: Array, delay: float = 0.0, observed: Array | None = None) -> RotorState:
        """The rotor at any times (m,), `delay` seconds earlier, with what a head read there."""
        earlier = time - delay
        command = np.asarray(self.inputs.command(earlier), np.float64)
        return RotorState(
            time=time,
            command=command,
            omega=np.asarray(self.inputs.omega(earlier), np.float64),
            theta=command,
            force=np.asfortranarray(self.inputs.force(earlier)),
            warming=self.inputs.warming(earlier),
            command_at=self.inputs.command,
            lines=0 if self.stage.encoder is None else self.stage.encoder.lines_per_revolution,
            observed=observed,
            age=delay,
            warmings={place: warming(earlier) for place, warming in self.inputs.warmings.items()},
            inputs={name: course(earlier) for name, course in self.inputs.others.items()},
        )

    def motion(self, time: Array, causes: Sequence[Cause] = ()) -> tuple[Array, Array, Array]:
        """True rotation (m,), radial error motion at the ring (m, 2) and tilt error motion (m, 2) at times (m,).

        Raises:
            UnpredictableError: a value is not finite.
        """
        acting = [(c, c.effect) for c in (*self.known, *causes) if isinstance(c.effect, StageEffect)]
        state, stage = self.state_at(time), self.stage
        ahead = turned_by(acting, state)
        if np.any(ahead):
            state = state.rotated(ahead)
        for cause, effect in acting:
            stage = effect.amend(stage, cause.values, cause.location)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # what is not finite is told below
            pose = RotorPose(stage, state, acting)
            radial, tilt = pose.radial(), pose.tilt()
        check_finite("the rotor", np.column_stack([state.theta, radial, tilt]), causes)
        return state.theta, radial, tilt

    def _stream(self, name: str, causes: Sequence[Cause], stage: StageDescription) -> Array:
        acting = [(c, c.effect) for c in causes if isinstance(c.effect, StageEffect)]
        acting = [(cause, effect) for cause, effect in acting if effect.touches(cause.location, name)]
        state = self._moved_state(name, acting)
        for cause, effect in acting:
            stage = effect.amend(stage, cause.values, cause.location)
        sensor = sensor_of(name)
        ideal = sensor.shown(name, RotorPose(stage, state, acting))
        for cause, effect in acting:
            ideal = effect.measured(cause.values, cause.location, _felt(cause, effect, state), ideal)
        check_finite(name, ideal, causes)
        ideal = sensor.within_range(stage, name, ideal)
        if stage.response(name) != self.stage.response(name):  # recorded values were corrected by the twin's own
            ideal = self.stage.response(name).corrected(stage.response(name).readings(ideal))
        return ideal[:, None] if ideal.ndim == 1 else ideal


Acting = Sequence[tuple[Cause, StageEffect]]
"""Causes with their effects, known to be of a stage."""


def _felt(cause: Cause, effect: StageEffect, state: RotorState) -> RotorState:
    """The state as the hooks of a cause see it: with the warming of its place if it goes with that."""
    return state.warmed_at(cause.location) if effect.warms else state


def turned_by(acting: Acting, state: RotorState) -> Array:
    """(m,) rad by which effects turn the rotor ahead of that state."""
    ahead = (effect.rotation(cause.values, _felt(cause, effect, state)) for cause, effect in acting)
    return sum((part for part in ahead if part is not None), np.zeros(len(state.theta)))


@dataclass(frozen=True)
class RotorPose:
    """The rotor at n instants as the twin has it: see `sensors.sensor.Pose`."""

    stage: StageDescription
    state: RotorState
    acting: Acting

    def radial(self) -> Array:
        """(n, 2) radial error motion at the ring, m: as described, and what effects add."""
        state, spindle = self.state, self.stage.spindle

        def own() -> Array:
            moved = state.harmonics(spindle.radial)
            if spindle.radial_compliance:
                moved += spindle.radial_compliance * state.force
            if any(spindle.radial_thermal):
                moved += np.outer(spindle.radial_thermal, state.warming).T
            return moved

        total = state.keep("radial", spindle, own)
        for cause, effect in self.acting:
            part = effect.radial(cause.values, _felt(cause, effect, state))
            total = total if part is None else total + part
        return total

    def axial(self) -> Array:
        """(n,) axial error motion, m: as described, and what effects add."""
        total = angular_sum(self.stage.spindle.axial, self.state.theta)
        for cause, effect in self.acting:
            part = effect.axial(cause.values, _felt(cause, effect, self.state))
            total = total if part is None else total + part
        return total

    def tilt(self) -> Array:
        """(n, 2) tilt error motion, a rotation vector in rad: as described, and what effects add."""
        state, spindle = self.state, self.stage.spindle

        def own() -> Array:
            leaning = state.harmonics(spindle.tilt)
            if spindle.tilt_compliance:
                leaning += spindle.tilt_compliance * np.stack([-state.force[:, 1], state.force[:, 0]]).T
            return leaning

        total = state.keep("tilt", spindle, own)
        for cause, effect in self.acting:
            part = effect.tilt(cause.values, _felt(cause, effect, state))
            total = total if part is None else total + part
        return total


def twin_of(
    stage: StageDescription,
    recording: StageRecording,
    known: tuple[Cause, ...] = (),
    inputs: StageInputs | None = None,
) -> StageTwin:
    """Twin of the recorded stage: predicts every sensor stream that was recorded and that the stage has.

    `inputs` stands for those in the recording, where that is a stretch of a longer one.
    """
    sensors = [name for name in recording.sensors if name in sensor_of(name).streams(stage)]
    return StageTwin(
        stage,
        inputs or stage_inputs(recording, stage.reference_temperature, stage.inputs),
        {name: recording.streams[name].time for name in sensors},
        {name: recording.streams[name].values[:, 0] for name in recording.heads},
        known,
    )
