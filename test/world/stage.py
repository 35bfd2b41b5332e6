"""A recording of a rotary stage that is as its description says, with all the habits of real instruments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .geometry import autocollimator_reading, head_reading, lvdt_reading
from .noise import drawn_log, instrument_noise, quantise, turbulence
from .options import ROUNDINGS, Options, Seeds
from .probes import Probe
from .recording import (
    AUTOCOLLIMATOR,
    COMMAND,
    FORCE,
    LOAD_CELL,
    LVDT,
    TEMPERATURE,
    THERMOMETER,
    Recording,
    head_topic,
    probe_topic,
)
from .rotor import Rotor
from .streams import Stream, make_blocks, make_stream

Array = NDArray[np.float64]
Times = NDArray[np.int64]
HEAD_RATES = (231.7, 250.0, 333.3, 411.9, 500.0, 811.3, 1000.0, 1003.0, 2000.0)
EPOCH_NS = 1_750_000_000_000_000_000


def make_recording(
    seed: int, *, duration: float, stage: Mapping[str, Any], options: Options | None = None
) -> Recording:
    """Recording of a healthy stage.

    Args:
        seed: of everything that is drawn.
        duration: length in s.
        stage: section `stage` of a description, which is the truth.
        options: what is drawn and how large it is.
    """
    options = options or Options()
    seeds = Seeds(seed)
    drawn_start = EPOCH_NS + int(seeds.generator("start").integers(0, 10**17))
    start_ns = drawn_start if options.start_ns is None else options.start_ns
    rotor = Rotor(seeds, duration, stage, options, start_ns)
    maker = _Maker(seeds, duration, stage, options, rotor)
    topics = maker.topics()
    blocks = {topic: pair[0] for topic, pair in topics.items()}
    arrivals = {topic: pair[1] for topic, pair in topics.items()}
    return Recording(stage, blocks, arrivals, rotor, start_ns, duration, maker.drawn)


class _Maker:
    """Makes the streams of one recording."""

    def __init__(self, seeds: Seeds, duration: float, stage: Mapping[str, Any], options: Options, rotor: Rotor) -> None:
        self.seeds, self.duration, self.stage, self.options, self.rotor = seeds, duration, stage, options, rotor
        rng = seeds.generator("rounding")
        self.rounding = options.rounding or str(rng.choice(ROUNDINGS, p=(0.6, 0.3, 0.1)))
        self.drawn: dict[str, Any] = {"motion": rotor.motion_name, "rounding": self.rounding, "streams": {}}

    def topics(self) -> dict[str, tuple[list[SampleBlock], Times]]:
        """Blocks and arrivals of all topics."""
        rng = self.seeds.generator("rates")
        rates = _rates(rng, self.options)
        made = {}
        for i, (head, place) in enumerate(self.stage.get("encoder", {}).get("heads", {}).items()):
            topic = head_topic(head)
            signal = self._head(topic, float(place["azimuth"]))
            made[topic] = self._stream(topic, rates["heads"][i % len(rates["heads"])], ("angle",), signal)
        if "autocollimator" in self.stage:
            made[AUTOCOLLIMATOR] = self._stream(
                AUTOCOLLIMATOR, rates["autocollimator"], ("tilt_x", "tilt_y"), self._autocollimator
            )
        made[COMMAND] = self._stream(COMMAND, rates["command"], ("angle", "velocity"), self._command)
        wanted = rng.uniform() < 0.5 if self.options.lvdt is None else self.options.lvdt
        if "lvdt" in self.stage and wanted:
            made[LVDT] = self._stream(LVDT, rates["lvdt"], ("radial_x", "radial_y"), self._lvdt)
        if self.rotor.environment.has_force:
            made[FORCE] = self._stream(FORCE, rates["force"], ("force_x", "force_y"), self._force)
        if self.rotor.environment.has_temperature:
            made[TEMPERATURE] = self._stream(TEMPERATURE, rates["temperature"], ("temperature",), self._temperature)
        for name, section in self.stage.get("sensors", {}).items():
            if section["kind"] == THERMOMETER:
                topic = probe_topic(name, section)
                made[topic] = self._stream(topic, rates["thermometer"], ("temperature",), self._place(name, section))
                continue
            if section["kind"] == LOAD_CELL:
                topic = probe_topic(name, section)
                made[topic] = self._stream(topic, rates["force"], ("force_x", "force_y"), self._pushed(name, section))
                continue
            probe = Probe(self.seeds, name, section, self.options)
            made[probe.topic] = self._stream(probe.topic, probe.rate, probe.fields, self._seen_by(probe))
            self.drawn["streams"][probe.topic]["rounding"] = probe.rounding
        return made

    def _seen_by(self, probe: Probe) -> Callable[[Array], Array]:
        """Signal of one probe."""
        return lambda times: probe(self.rotor.at(times))

    def _stream(
        self, topic: str, rate: float, names: tuple[str, ...], signal: Callable[[Array], Array]
    ) -> tuple[list[SampleBlock], Times]:
        """Blocks and arrivals of one topic, whose signal is (n, k) at times (n,)."""
        stream = make_stream(self.seeds, topic, rate, self.options)
        times = stream.times(self.duration)
        self.drawn["streams"][topic] = _clock(stream)
        return make_blocks(stream, times, signal(times), ("t", *names), self.rotor.start_ns, self.options)

    def _noise(self, name: str, n: int, std: float) -> Array:
        """(n,) noise of one component of a signal."""
        size = std * self.options.noise
        return instrument_noise(self.seeds.generator(f"{name}/noise"), n, size, self.options.noise_shape)

    def _steps(self, values: Array, step: float) -> Array:
        """Values in steps, if readings come in steps."""
        return quantise(values, step, self.rounding) if self.options.quantise else values

    def _head(self, topic: str, azimuth: float) -> Callable[[Array], Array]:
        """Signal of one head."""
        encoder = self.stage["encoder"]
        lines = encoder["lines_per_revolution"]
        count = 2.0 * np.pi / (lines * encoder["counts_per_line"])
        waves = self.options.interpolation_error * count * self.seeds.generator(f"{topic}/lines").uniform(-1, 1, 2)

        def signal(times: Array) -> Array:
            angle = head_reading(self.rotor.at(times), azimuth, encoder)
            if waves.any():
                angle = angle + waves[0] * np.cos(lines * angle) + waves[1] * np.sin(2 * lines * angle)
            angle = angle + self._noise(topic, len(times), encoder["noise"])
            return self._steps(angle, count)[:, None]

        return signal

    def _autocollimator(self, times: Array) -> Array:
        """Signal of the autocollimator."""
        section = self.stage["autocollimator"]
        tilt = autocollimator_reading(self.rotor.at(times), self.stage.get("mirror", {}))
        air = section.get("turbulence", {"std": 0.0, "correlation_time": 1.0})
        std = air["std"] * self.options.noise * self.options.turbulence
        for i, name in enumerate("xy"):
            tilt[:, i] += self._noise(f"autocollimator {name}", len(times), section["noise"])
            rng = self.seeds.generator(f"turbulence {name}")
            tilt[:, i] += turbulence(rng, times, std, air["correlation_time"])
        return self._steps(np.clip(tilt, -section["range"], section["range"]), section["resolution"])

    def _command(self, times: Array) -> Array:
        """Signal of the controller."""
        motion, rng = self.rotor.motion, self.seeds.generator("command")
        angle_step, velocity_step = drawn_log(rng, 1e-9, 5e-7), drawn_log(rng, 1e-7, 1e-5)
        angle = self._steps(motion.angle(times), angle_step)
        return np.stack([angle, self._steps(motion.velocity(times), velocity_step)], axis=-1)

    def _lvdt(self, times: Array) -> Array:
        """Signal of the LVDT."""
        radial = lvdt_reading(self.rotor.at(times), self.stage["lvdt"])
        for i, name in enumerate("xy"):
            radial[:, i] += self._noise(f"lvdt {name}", len(times), self.stage["lvdt"]["noise"])
        return self._steps(radial, drawn_log(self.seeds.generator("lvdt"), 1e-9, 2e-8))

    def _force(self, times: Array) -> Array:
        """Signal of the load cell."""
        force = self.rotor.environment.force(times)
        std = self.seeds.generator("load cell").uniform(0.02, 0.1)
        for i, name in enumerate("xy"):
            force[:, i] += self._noise(f"force {name}", len(times), std)
        return self._steps(force, 0.01)

    def _temperature(self, times: Array) -> Array:
        """Signal of the thermometer."""
        warm = self.rotor.environment.reference + self.rotor.environment.warmth(times)
        step = float(self.seeds.generator("thermometer").choice((0.01, 0.0625)))
        return self._steps(warm + self._noise("temperature", len(times), 0.01), step)[:, None]

    def _place(self, name: str, section: Mapping[str, Any]) -> Callable[[Array], Array]:
        """Signal of the thermometer at a place, whose zero is as uncertain as stated."""
        zero = (
            section.get("zero", 0.0) + section["uncertainty"] * self.seeds.generator(f"{name}/zero").standard_normal()
        )

        def signal(times: Array) -> Array:
            warm = self.rotor.environment.reference + self.rotor.environment.warmth_of(name, times)
            noisy = zero + warm + self._noise(f"{name}/temperature", len(times), section["noise"])
            return self._steps(noisy, section["resolution"])[:, None]

        return signal

    def _pushed(self, name: str, section: Mapping[str, Any]) -> Callable[[Array], Array]:
        """Signal of a listed load cell, whose zeros are as uncertain as stated; it looks along its own directions."""
        rng = self.seeds.generator(f"{name}/zeros")
        zeros = np.array(section.get("zero", (0.0, 0.0))) + section["uncertainty"] * rng.standard_normal(2)
        turned = section["azimuth"] + np.array([0.0, np.pi / 2])
        seen = np.array([1.0, 1.0 if section.get("axes", 2) == 2 else 0.0])

        def signal(times: Array) -> Array:
            force = self.rotor.environment.force(times - section.get("latency", 0.0))
            along = np.outer(force[:, 0], np.cos(turned)) + np.outer(force[:, 1], np.sin(turned))
            reading = zeros + section.get("gain", 1.0) * along * seen
            for i, axis in enumerate("xy"):
                reading[:, i] += self._noise(f"{name} {axis}", len(times), section["noise"])
            return self._steps(np.clip(reading, -section["range"], section["range"]), section["resolution"])

        return signal


def _rates(rng: np.random.Generator, options: Options) -> dict[str, Any]:
    """Nominal rates in Hz of the streams; the heads mostly share one."""
    if not options.odd_rates:
        fixed = {
            "autocollimator": 100.0,
            "command": 250.0,
            "lvdt": 200.0,
            "force": 100.0,
            "temperature": 2.0,
            "thermometer": 1.0,
        }
        return {"heads": [500.0], **fixed}
    together = rng.uniform() < 0.8
    heads = rng.choice(HEAD_RATES, 1 if together else 6).tolist()
    return {
        "heads": heads,
        "autocollimator": drawn_log(rng, 40.0, 260.0),
        "command": drawn_log(rng, 90.0, 1100.0),
        "lvdt": drawn_log(rng, 60.0, 600.0),
        "force": drawn_log(rng, 30.0, 300.0),
        "temperature": drawn_log(rng, 0.7, 10.0),
        "thermometer": 1.0,
    }


def _clock(stream: Stream) -> dict[str, float]:
    """What was drawn for a stream's clock."""
    return {
        "rate": stream.rate,
        "offset": stream.offset,
        "drift": stream.drift,
        "wander": stream.wander[0],
    }
