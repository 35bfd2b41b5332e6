"""The true stage: a rigid rotor whose pose, surroundings and readings are functions of (seed, absolute time) alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import PlanarHarmonic, StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import geometry
from rotary_error_monitor.plant.environment import Forces, Temperature
from rotary_error_monitor.plant.geometry import Plane, Turns, as_columns
from rotary_error_monitor.plant.motion import Course, reversing_motion
from rotary_error_monitor.plant.noise import Noise, Turbulence
from rotary_error_monitor.plant.noise_forms import NoiseForm
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples

FIELDS = {
    "autocollimator": ("tilt_x", "tilt_y"),
    "lvdt": ("radial_x", "radial_y"),
    "command": ("angle", "velocity"),
    "force": ("force_x", "force_y"),
    "temperature": ("temperature",),
}
HEAD_FIELDS = ("angle",)
HEAD = "head_"


@dataclass(frozen=True)
class Clock:
    """When a stream samples: at `offset + k / rate * (1 + drift)` after the epoch (s, Hz, relative)."""

    rate: float
    offset: float = 0.0
    drift: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0 and np.isfinite(self.offset) and abs(self.drift) < 0.01):
            raise InputError(f"{self}: rate must be positive (Hz), offset finite (s), drift below 1 %")

    @property
    def period_ns(self) -> float:
        """Time between samples, ns."""
        return NANOSECONDS / self.rate * (1 + self.drift)

    def times_ns(self, first: int, count: int) -> NDArray[np.int64]:
        """(count,) ns after the epoch of the samples from index `first`."""
        index = np.arange(first, first + count)
        return np.asarray(np.rint(index * self.period_ns + self.offset * NANOSECONDS), dtype=np.int64)

    def index_at(self, time_ns: int) -> int:
        """Index of the first sample at or after `time_ns` after the epoch."""
        guess = int(np.floor((time_ns - self.offset * NANOSECONDS) / self.period_ns)) - 1
        return guess + int(np.searchsorted(self.times_ns(guess, 4), time_ns))


def stage_clocks(heads: Sequence[str] = "abcd", rate: float | None = None) -> dict[str, Clock]:
    """Clocks of all streams by name; none coincides with another.

    Args:
        heads: letters of the read heads.
        rate: rate of heads, autocollimator and command, Hz; None takes 250, 400 and 250 Hz as usual recordings do.
    """
    head_rate, collimator_rate, command_rate = (250.0, 400.0, 250.0) if rate is None else (rate,) * 3
    fast = {f"{HEAD}{name}": Clock(head_rate, (0.2 + 0.03 * i) / head_rate) for i, name in enumerate(heads)}
    return fast | {
        "autocollimator": Clock(collimator_rate, 0.4 / collimator_rate),
        "lvdt": Clock(250.0, 0.0028),
        "command": Clock(command_rate),
        "force": Clock(100.0, 0.001),
        "temperature": Clock(5.0),
    }


@dataclass(frozen=True)
class Scene:
    """What is true at each of n times.

    Attributes:
        time: (n,) s after the epoch.
        command: (n,) what the controller commands, rad.
        velocity: (n,) the speed that the drive follows, rad/s.
        theta: (n,) true rotation, rad.
        turns: powers of `exp(1j * theta)`.
        force: (n,) on the shaft as `x + 1j * y`, N.
        warming: (n,) temperature above the reference, K.
        radial: (n,) displacement of the rotor at the ring as `x + 1j * y`, m.
        tilt: (n,) its tilt, rotation vector as `x + 1j * y`, rad.
        stage: the true stage.
        motion, temperature: their whole course, for what depends on the past.
    """

    time: NDArray[np.float64]
    command: NDArray[np.float64]
    velocity: NDArray[np.float64]
    theta: NDArray[np.float64]
    turns: Turns
    force: Plane
    warming: NDArray[np.float64]
    radial: Plane
    tilt: Plane
    stage: StageDescription
    motion: Course
    temperature: Temperature

    @property
    def error_motion(self) -> NDArray[np.float64]:
        """(n, 6) true error motion at the ring: exc eyc ezc (m) eac ebc ecc (rad); the rotor does not move along z."""
        radial, tilt, angular = as_columns(self.radial), as_columns(self.tilt), self.theta - self.command
        return np.column_stack([radial, np.zeros_like(angular), tilt, angular])


class Fault:
    """Something about the true stage that its description does not say; a subclass overrides what it changes.

    Every method gets the value so far and gives the changed one; arrays are never changed in place. Vectors in the
    plane are complex, `x + 1j * y`.
    """

    def describe(self, stage: StageDescription) -> StageDescription:
        """Parameters of the stage."""
        return stage

    def over_time(self, plant: StagePlant, stream: str, time: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(n, fields) all that a stream shows, where the size of the fault changes over time; None where it does not.

        The fault is among those of the plant; nothing else of it is asked then.
        """
        return None

    def age(self, stream: str) -> float:
        """Age of the values of a stream at their stamps, s."""
        return 0.0

    def trail(self) -> float:
        """How long the rotor trails the command, s."""
        return 0.0

    def drive(self, theta: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
        """True rotation (n,); the scene holds all but radial and tilt."""
        return theta

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Displacement of the rotor (n,) m; in the scene radial and tilt are without faults."""
        return radial

    def lean(self, tilt: Plane, scene: Scene) -> Plane:
        """Tilt of the rotor (n,) rad; in the scene radial and tilt are without faults."""
        return tilt

    def centre(self, eccentricity: Plane, scene: Scene) -> Plane:
        """Ring centre in the rotor, (1,) or (n,) m."""
        return eccentricity

    def graduate(self, error: NDArray[np.float64], place: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
        """Graduation error (n,) rad at the places (n,) rad on the ring."""
        return error

    def read(self, angle: NDArray[np.float64], stream: str, scene: Scene) -> NDArray[np.float64]:
        """What a head sees (n,) rad, before noise and rounding."""
        return angle

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """What the autocollimator sees (n,) rad, before noise and rounding."""
        return tilt

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """What the LVDT sees (n,) m, before noise."""
        return radial


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
        clocks: when each stream samples, by the name of the stream.
        faults: what the description does not say.
        jitter: standard deviation of the true rotation about the command, rad.
        noise_forms: by stream, noise that is not normal and white as stated.
        force_noise, temperature_noise: standard deviation of load cell and thermometer, N and K.
    """

    description: StageDescription
    seed: int
    epoch_ns: int = 0
    motion: Course = field(default_factory=reversing_motion)
    forces: Forces = field(default_factory=Forces)
    temperature: Temperature = field(default_factory=Temperature)
    clocks: Mapping[str, Clock] = field(default_factory=stage_clocks)
    faults: tuple[Fault, ...] = ()
    jitter: float = 2e-6
    noise_forms: Mapping[str, NoiseForm] = field(default_factory=dict)
    force_noise: float = 0.2
    temperature_noise: float = 0.01

    @cached_property
    def stage(self) -> StageDescription:
        """The true stage: the description with the parameters that the faults change."""
        stage = self.description
        for fault in self.faults:
            stage = fault.describe(stage)
        return stage

    @cached_property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams that this stage has and that a clock drives."""
        heads = tuple(f"{HEAD}{name}" for name in self.stage.encoder.azimuths)
        absent = {name for name in ("autocollimator", "lvdt") if getattr(self.stage, name) is None}
        others = tuple(name for name in FIELDS if name not in absent)
        return tuple(name for name in (*heads, *others) if name in self.clocks)

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
        names = HEAD_FIELDS if stream.startswith(HEAD) else FIELDS[stream]
        return block_from_samples(self.epoch_ns + times_ns, names, values)

    def signal(self, stream: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
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
        if stream == "command":
            return np.column_stack(self.motion.at(time))
        if stream == "force":
            return as_columns(self.forces.at(time))
        if stream == "temperature":
            return self.temperature.at(time)[:, None]
        scene = self.scene(time)
        if stream == "autocollimator":
            return as_columns(self._tilt(scene))
        if stream == "lvdt":
            return as_columns(self._radial(scene))
        return self._angle(stream, scene)[:, None]

    def scene(self, time: NDArray[np.float64]) -> Scene:
        """The truth at `time` (n,) s after the epoch."""
        spindle = self.stage.spindle
        command, speed = self.motion.at(time)
        trail = sum(fault.trail() for fault in self.faults)
        driven, speed = self.motion.at(time - trail) if trail else (command, speed)
        force = self.forces.at(time)
        warming = self.temperature.at(time) - self.stage.reference_temperature
        nowhere, theta = np.zeros(len(time), dtype=np.complex128), driven + self._jitter(time)
        turns = Turns(np.exp(1j * theta))
        known = (self.stage, self.motion, self.temperature)
        scene = Scene(time, command, speed, theta, turns, force, warming, nowhere, nowhere, *known)
        for fault in self.faults:
            theta = fault.drive(scene.theta, scene)
            if theta is not scene.theta:
                scene = replace(scene, theta=theta, turns=Turns(np.exp(1j * theta)))
        radial = planar(spindle.radial, scene.turns) + spindle.radial_compliance * force
        radial += warming * complex(*spindle.radial_thermal)
        tilt = planar(spindle.tilt, scene.turns) + 1j * spindle.tilt_compliance * force
        plain = replace(scene, radial=radial, tilt=tilt)
        for fault in self.faults:
            radial, tilt = fault.displace(radial, plain), fault.lean(tilt, plain)
        return replace(scene, radial=radial, tilt=tilt)

    def _clock(self, stream: str) -> Clock:
        if stream not in self.streams:
            raise InputError(f"no stream '{stream}'; this stage has {', '.join(self.streams)}")
        return self.clocks[stream]

    def _jitter(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Smooth motion about the command: sinusoids below 20 Hz with seeded frequencies and phases."""
        total = np.zeros(len(time))
        if self.jitter:
            for frequency, phase in self._jitter_lines:
                total += np.sin(frequency * time + phase)
            total *= self.jitter * np.sqrt(2 / len(self._jitter_lines))
        return total

    @cached_property
    def _jitter_lines(self) -> list[tuple[float, float]]:
        draw = Noise(self.seed, "jitter").generator()
        count = 6
        frequencies = 2 * np.pi * (0.5 + 19 * (np.arange(count) + draw.uniform(size=count)) / count)
        return list(zip(frequencies.tolist(), draw.uniform(0, 2 * np.pi, count).tolist(), strict=True))

    def _angle(self, stream: str, scene: Scene) -> NDArray[np.float64]:
        encoder = self.stage.encoder
        azimuth = encoder.azimuths[stream.removeprefix(HEAD)]
        centre = np.array([complex(*encoder.eccentricity)])
        for fault in self.faults:
            centre = fault.centre(centre, scene)
        rotor, radius = scene.turns.once, encoder.disc_radius
        cut = geometry.cut_ring(rotor, azimuth, radius, centre, scene.radial, scene.tilt)
        shift = np.arctan2(cut.imag, cut.real)
        place = azimuth - scene.theta + shift
        error = np.zeros(len(place))
        turns = Turns(rotor.conj() * cut * complex(np.cos(azimuth), np.sin(azimuth)))
        for row in encoder.graduation:
            error += (complex(row.cos, -row.sin) * turns(row.order)).real
        for fault in self.faults:
            error = fault.graduate(error, place, scene)
        angle = scene.theta - shift + error
        for fault in self.faults:
            angle = fault.read(angle, stream, scene)
        return angle

    def _tilt(self, scene: Scene) -> Plane:
        mirror = self.stage.mirror
        flatness = planar(mirror.flatness, scene.turns)
        tilt = geometry.reflect(scene.turns.once, complex(*mirror.tilt), scene.tilt, flatness)
        for fault in self.faults:
            tilt = fault.look(tilt, scene)
        return tilt

    def _radial(self, scene: Scene) -> Plane:
        lvdt = self.stage.lvdt
        assert lvdt is not None  # there is no such stream otherwise
        centre = complex(*lvdt.artefact_eccentricity)
        radial = geometry.place_point(scene.turns.once, centre, lvdt.height, scene.radial, scene.tilt)
        for fault in self.faults:
            radial = fault.touch(radial, scene)
        return radial

    def _instrument(
        self, stream: str, seen: NDArray[np.float64], time: NDArray[np.float64], first: int
    ) -> NDArray[np.float64]:
        """What comes out of an instrument that sees `seen`: noise first, then limits, then resolution."""
        encoder, lvdt = self.stage.encoder, self.stage.lvdt
        if stream.startswith(HEAD):
            return _rounded(seen + encoder.noise * self._noise(stream, first, seen.shape), encoder.resolution)
        if stream == "autocollimator":
            collimator = self.stage.tilt_instrument
            noisy = seen + collimator.noise * self._noise(stream, first, seen.shape) + self._turbulence(time)
            return _rounded(np.clip(noisy, -collimator.range, collimator.range), collimator.resolution)
        std = {"lvdt": lvdt.noise if lvdt else 0.0, "force": self.force_noise, "temperature": self.temperature_noise}
        return seen + std[stream] * self._noise(stream, first, seen.shape) if stream in std else seen

    def _noise(self, stream: str, first: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
        count, fields = shape
        noise = self._noises[stream]
        normal = noise.normal(first * fields, count * fields).reshape(count, fields)
        form = self.noise_forms.get(stream)
        time = np.asarray(self.clocks[stream].times_ns(first, count) * 1e-9, dtype=np.float64)
        return form.shaped(normal, noise, time) if form else normal

    @cached_property
    def _noises(self) -> dict[str, Noise]:
        return {stream: Noise(self.seed, stream) for stream in self.streams}

    def _turbulence(self, time: NDArray[np.float64]) -> NDArray[np.float64] | float:
        air = self.stage.tilt_instrument.turbulence
        if air is None:
            return 0.0
        columns = (Turbulence(Noise(self.seed, f"turbulence_{axis}"), air.correlation_time).at(time) for axis in "xy")
        return air.std * np.stack(list(columns), axis=1)


def planar(rows: Sequence[PlanarHarmonic], turns: Turns) -> Plane:
    """(n,) sum over the rows of the ellipses that their coefficients of cos and sin in x and y describe."""
    total = np.zeros_like(turns.once)
    for row in rows:
        cosine, sine = complex(row.x[0], row.y[0]), complex(row.x[1], row.y[1])
        phase = turns(row.order)
        total += cosine * phase.real + sine * phase.imag
    return total


def _rounded(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    return np.asarray(np.rint(values / step) * step, dtype=np.float64)
