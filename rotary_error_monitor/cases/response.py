"""What faults do to a recording: how far they move each channel, over its noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.cases.departures.departure import AnyFault, acting
from rotary_error_monitor.cases.faults.instruments import HeadMissedCounts
from rotary_error_monitor.cases.faults.named import Named
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.description.topics import samples_topic, topic_named
from rotary_error_monitor.plant.clocks import fields_of
from rotary_error_monitor.plant.machine import MachineFault, MachinePlant, MachineStates
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import NANOSECONDS

TRACKER_NOISE = 1.5e-6  # m
INPUTS = ("command", "force", "temperature")


class FaultResponse(ABC):
    """How faults move a recording of a plant."""

    @abstractmethod
    def channels(self, faults: Sequence[AnyFault]) -> Mapping[str, Array]:
        """By the name of the channel (m,) how far the faults move it, over its noise.

        The root of the summed squares is that of all samples, also where only some are looked at.
        """

    def made_real(self, fault: Named) -> Named:
        """The fault nearest to one that the stage or machine can have: as a rule itself."""
        return fault

    def moved(self, faults: Sequence[AnyFault]) -> Array:
        """(m,) all channels, one after another."""
        with np.errstate(invalid="ignore"):  # so large that a head looks past the ring: not a number
            return np.concatenate(list(self.channels(faults).values()))

    def size(self, faults: Sequence[AnyFault]) -> float:
        """Root of the summed squares of all channels, standard deviations."""
        return float(np.linalg.norm(self.moved(faults)))

    def ratios(self, faults: Sequence[AnyFault]) -> dict[str, float]:
        """Root of the summed squares of each channel, standard deviations."""
        return {name: float(np.linalg.norm(moved)) for name, moved in self.channels(faults).items()}


@dataclass(frozen=True)
class StageResponse(FaultResponse):
    """Response of a stage.

    Attributes:
        plain: the stage without the faults.
        duration: of the recording, s.
        every: only every so many samples are looked at; the squares are scaled up.
        scattered: one of every so many, drawn, so that no order looks like another.
    """

    plain: StagePlant
    duration: float
    every: int = 1
    scattered: bool = False

    def channels(self, faults: Sequence[AnyFault]) -> Mapping[str, Array]:
        """Heads, autocollimator, reference and listed sensors, topic + `.` + field."""
        parts = tuple(part for part in acting(faults) if isinstance(part, Fault))
        plant = replace(self.plain, faults=(*self.plain.faults, *parts))
        found: dict[str, Array] = {}
        for stream, (time, base) in self._bases.items():
            moved = (plant.signal(stream, time) - base) * (np.sqrt(self.every) / noise_of(self.plain.stage, stream))
            for name, column in zip(fields_of(stream, self.plain.stage.sensors), moved.T, strict=True):
                found[f"{samples_topic(stream)}.{name}"] = column
        return found

    def made_real(self, fault: Named) -> Named:
        """Counts are lost whole."""
        return fault.in_counts(self.plain.stage.ring.resolution) if isinstance(fault, HeadMissedCounts) else fault

    @cached_property
    def _bases(self) -> dict[str, tuple[Array, Array]]:
        """Times (m,) and signals (m, fields) of each stream without the faults."""
        found: dict[str, tuple[Array, Array]] = {}
        for stream in self.plain.streams:
            if stream not in INPUTS:
                time = times_of(self.plain, stream, self.duration)
                index = np.arange(0, len(time), self.every)
                if self.scattered:
                    steps = np.random.default_rng(len(found)).integers(0, self.every, len(index))
                    index = np.minimum(index + steps, len(time) - 1)
                time = time[index]
                found[stream] = (time, self.plain.signal(stream, time))
        return found


@dataclass(frozen=True)
class MachineResponse(FaultResponse):
    """Response of a machine.

    Attributes:
        plain: the machine without the faults.
        poses: of the recording.
    """

    plain: MachinePlant
    poses: MachineStates

    def channels(self, faults: Sequence[AnyFault]) -> Mapping[str, Array]:
        """The probe, as one channel."""
        return {topic_named("tool_probe"): ((self.tool(faults) - self._base) / TRACKER_NOISE).ravel()}

    def tool(self, faults: Sequence[AnyFault]) -> Array:
        """(n, 3) tool tip minus where it should be, m."""
        parts = tuple(part for part in acting(faults) if isinstance(part, MachineFault))
        plant = replace(self.plain, faults=(*self.plain.faults, *parts))
        return plant.tool_offset(self.poses)[:, :3]

    @cached_property
    def _base(self) -> Array:
        return self.tool(())


def times_of(plant: StagePlant, stream: str, duration: float) -> Array:
    """(n,) times of the samples of a stream in a recording of `duration` s, s after the epoch."""
    clock = plant.clocks[stream]
    return np.asarray(clock.times_ns(0, clock.index_at(round(duration * NANOSECONDS))) * 1e-9, dtype=np.float64)


def noise_of(stage: StageDescription, stream: str) -> float:
    """Standard deviation of noise and rounding of one sample of a stream."""
    if stream == OWN_REFERENCE:
        return stage.reference.noise if stage.reference else np.inf
    instrument = stage.tilt_instrument if stream == "autocollimator" else stage.sensors.get(stream) or stage.ring
    return float(np.hypot(instrument.noise, instrument.resolution / np.sqrt(12)))
