"""The true stage: a rigid rotor whose pose, surroundings and readings are functions of (seed, absolute time) alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.sensor_section import PLACE_TEMPERATURE, SHAFT_FORCE
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import FORCE, OWN_REFERENCE, TEMPERATURE, TWO_AXIS
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.clocks import HEAD, STREAMS, Clock, fields_of, stage_clocks
from rotary_error_monitor.plant.environment import Forces, TemperatureCourse, place_temperature
from rotary_error_monitor.plant.geometry import Turns, as_columns, waves
from rotary_error_monitor.plant.instruments import ENTRY_POINTS, geometries, planar, pushed, read_off, seen
from rotary_error_monitor.plant.motion import CommandedCourse, reversing_motion
from rotary_error_monitor.plant.noise import Noise, TurbulenceCourse
from rotary_error_monitor.plant.noise_forms import NoiseForm
from rotary_error_monitor.plant.scene import Fault, Scene
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples


@dataclass(frozen=True)
class StagePlant:
    """A stage in the real world, with its drive, its surroundings and its instruments.

    All that happens is a function of (seed, time): processes that are given the same arguments see the same rotor, and
    a sample that is asked for again, alone or with others, is the same to the last bit.

    Attributes:
        description: the stage as described; the true one differs from it by `faults`.
        seed: of jitter and noise.
        epoch_ns: when time 0 is, timestamp (ns).
        motion: what the controller commands.
        forces, temperature: what acts from outside.
        places: temperature of places with a thermometer by its name; one that is not named is drawn from the seed.
        clocks: when each stream samples, by the name of the stream; a head or listed sensor without one gives none.
        faults: what the description does not say.
        jitter: standard deviation of the true rotation about the command, rad.
        noise_forms: by stream, noise that is not normal and white as stated.
        force_noise, temperature_noise: standard deviation of load cell and thermometer, N and K.
    """

    description: StageDescription
    seed: int
    epoch_ns: int = 0
    motion: CommandedCourse = field(default_factory=reversing_motion)
    forces: Forces = field(default_factory=Forces)
    temperature: TemperatureCourse = field(default_factory=TemperatureCourse)
    clocks: Mapping[str, Clock] = field(default_factory=stage_clocks)
    faults: tuple[Fault, ...] = ()
    jitter: float = 2e-6
    noise_forms: Mapping[str, NoiseForm] = field(default_factory=dict)
    force_noise: float = 0.2
    temperature_noise: float = 0.01
    places: Mapping[str, TemperatureCourse] = field(default_factory=dict)

    @cached_property
    def stage(self) -> StageDescription:
        """The true stage: the description with the parameters that the faults change."""
        stage = self.description
        for fault in self.faults:
            stage = fault.describe(stage)
        return stage

    @cached_property
    def place_temperatures(self) -> Mapping[str, TemperatureCourse]:
        """Temperature of each place with a listed thermometer, by its name."""
        drawn = {place: place_temperature(self.temperature, self.seed, place) for place in self.stage.thermometers}
        return drawn | {**self.places}

    @cached_property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams that this stage has and that a clock drives."""
        heads = tuple(f"{HEAD}{name}" for name in self.stage.azimuths)
        others = tuple(name for name in STREAMS if name not in TWO_AXIS or name in self.stage.two_axis)
        return tuple(name for name in (*heads, *others, *self.stage.listed) if name in self.clocks)

    def having(self, faults: tuple[Fault, ...]) -> StagePlant:
        """The same stage with other faults."""
        return replace(self, faults=faults)

    def index_at(self, stream: str, time_ns: int) -> int:
        """Index of the first sample of a stream at or after `time_ns`, timestamp (ns).

        Raises:
            InputError: there is no such stream.
        """
        return self._clock(stream).index_at(time_ns - self.epoch_ns)

    def samples(self, stream: str, first: int, count: int) -> SampleBlock:
        """Block of `count` samples of a stream from index `first`, with noise, limits and resolution.

        Raises:
            InputError: there is no such stream.
        """
        times_ns = self._clock(stream).times_ns(first, count)
        time = np.asarray(times_ns * 1e-9, dtype=np.float64)
        values = self._instrument(stream, self.signal(stream, time), time, first)
        return block_from_samples(self.epoch_ns + times_ns, fields_of(stream, self.stage.listed), values)

    def signal(self, stream: str, time: Array) -> Array:
        """(n, fields) what an instrument without noise, limits and resolution shows at `time` (n,) s after the epoch.

        Raises:
            InputError: there is no such stream.
        """
        self._clock(stream)
        for fault in self.faults:
            whole = fault.over_time(self, stream, time)
            if whole is not None:
                return whole
        time = time - sum(fault.age(stream) for fault in self.faults)
        response = self.stage.responses.get(stream)
        if response is not None:
            time = time - response.latency
        if stream == "command":
            return read_off(np.column_stack(self.motion.at(time)), response)
        if stream == "force":
            return as_columns(self.forces.at(time))
        if stream == "temperature":
            return self.temperature.at(time)[:, None]
        if stream in self.stage.inputs and self.stage.inputs[stream].kind not in geometries():
            sensor = self.stage.inputs[stream]
            if sensor.measures == SHAFT_FORCE:
                return pushed(sensor, self.forces.at(time))
            if sensor.measures != PLACE_TEMPERATURE:
                raise InputError(
                    f"nothing is known of the true course of what '{stream}' measures; give its samples, or register a "
                    f"function of kind '{sensor.kind}' as an entry point of '{ENTRY_POINTS}'"
                )
            return sensor.zeros[0] + self.place_temperatures[name_of(stream, sensor)].at(time)[:, None]
        return read_off(seen(stream, self.scene(time), self.faults), response)

    def scene(self, time: Array) -> Scene:
        """The truth at `time` (n,) s after the epoch."""
        spindle = self.stage.spindle
        command, speed = self.motion.at(time)
        trail = sum(fault.trail() for fault in self.faults)
        driven, speed = self.motion.at(time - trail) if trail else (command, speed)
        force = self.forces.at(time)
        warming = self.temperature.at(time) - self.stage.reference_temperature
        nowhere, level = np.zeros(len(time), dtype=np.complex128), np.zeros(len(time))
        theta = driven + self._jitter(time)
        turns = Turns(np.exp(1j * theta))
        known = (self.stage, self.motion, self.temperature, self.place_temperatures)
        scene = Scene(time, command, speed, theta, turns, force, warming, nowhere, level, nowhere, *known)
        for fault in self.faults:
            theta = fault.drive(scene.theta, scene)
            if theta is not scene.theta:
                scene = replace(scene, theta=theta, turns=Turns(np.exp(1j * theta)))
        radial = planar(spindle.radial, scene.turns) + spindle.radial_compliance * force
        radial += warming * complex(*spindle.radial_thermal)
        tilt = planar(spindle.tilt, scene.turns) + 1j * spindle.tilt_compliance * force
        axial = waves(spindle.axial, scene.turns)
        plain = replace(scene, radial=radial, axial=axial, tilt=tilt)
        for fault in self.faults:
            radial, tilt = fault.displace(radial, plain), fault.lean(tilt, plain)
            axial = fault.lift(axial, plain)
        return replace(scene, radial=radial, axial=axial, tilt=tilt)

    def _clock(self, stream: str) -> Clock:
        if stream not in self.streams:
            raise InputError(f"no stream '{stream}'; this stage has {', '.join(self.streams)}")
        return self.clocks[stream]

    def _jitter(self, time: Array) -> Array:
        """Smooth motion about the command: sinusoids below 20 Hz with seeded frequencies and phases."""
        total = np.zeros(len(time))
        if self.jitter:
            for frequency, phase in self.jitter_lines:
                total += np.sin(frequency * time + phase)
            total *= self.jitter * np.sqrt(2 / len(self.jitter_lines))
        return total

    @cached_property
    def jitter_lines(self) -> list[tuple[float, float]]:
        """Frequency (rad/s) and phase (rad) of each sinusoid of the jitter."""
        draw = Noise(self.seed, "jitter").generator()
        count = 6
        frequencies = 2 * np.pi * (0.5 + 19 * (np.arange(count) + draw.uniform(size=count)) / count)
        return list(zip(frequencies.tolist(), draw.uniform(0, 2 * np.pi, count).tolist(), strict=True))

    def _instrument(self, stream: str, shown: Array, time: Array, first: int) -> Array:
        """What comes out of an instrument: to what it shows noise is added first, then limits, then resolution.

        All of these are of what is shown, so that an instrument with a gain has them larger by it.
        """
        reference = self.stage.reference
        scale = abs(self.stage.response(stream).gain)
        if stream.startswith(HEAD):
            encoder = self.stage.ring
            return _rounded(shown + encoder.noise * self._noise(stream, first, shown.shape), encoder.resolution)
        if stream == "autocollimator":
            collimator = self.stage.tilt_instrument
            noise = collimator.noise * self._noise(stream, first, shown.shape)
            noisy = shown + scale * noise + scale * self._turbulence(time)
            most = scale * collimator.range
            return _rounded(np.clip(noisy, -most, most), scale * collimator.resolution)
        if stream in self.stage.listed:
            sensor = self.stage.listed[stream]
            noisy = shown + sensor.noise * self._noise(stream, first, shown.shape)
            limited = np.clip(noisy, -sensor.range, sensor.range)
            return _rounded(limited, sensor.resolution) if sensor.resolution else limited
        std = {FORCE: self.force_noise, TEMPERATURE: self.temperature_noise}
        std |= {} if reference is None else {OWN_REFERENCE: reference.noise}
        return shown + scale * std[stream] * self._noise(stream, first, shown.shape) if stream in std else shown

    def _noise(self, stream: str, first: int, shape: tuple[int, ...]) -> Array:
        count, fields = shape
        noise = self._noises[stream]
        normal = noise.normal(first * fields, count * fields).reshape(count, fields)
        form = self.noise_forms.get(stream)
        time = np.asarray(self.clocks[stream].times_ns(first, count) * 1e-9, dtype=np.float64)
        return form.shaped(normal, noise, time) if form else normal

    @cached_property
    def _noises(self) -> dict[str, Noise]:
        return {stream: Noise(self.seed, stream) for stream in self.streams}

    def _turbulence(self, time: Array) -> Array | float:
        air = self.stage.tilt_instrument.turbulence
        if air is None:
            return 0.0
        columns = (
            TurbulenceCourse(Noise(self.seed, f"turbulence_{axis}"), air.correlation_time).at(time) for axis in "xy"
        )
        return air.std * np.stack(list(columns), axis=1)


def _rounded(values: Array, step: float) -> Array:
    return np.asarray(np.rint(values / step) * step, dtype=np.float64)
