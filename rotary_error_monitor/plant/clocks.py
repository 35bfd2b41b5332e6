"""Which streams the true stage has, when each samples, and which fields a sample has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND, FORCE, OWN_REFERENCE, TEMPERATURE
from rotary_error_monitor.description.topics import samples_columns
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import NANOSECONDS

STREAMS = (AUTOCOLLIMATOR, OWN_REFERENCE, COMMAND, FORCE, TEMPERATURE)
"""Those that are neither of a head nor of a listed sensor."""

HEAD = "head_"

LISTED_RATE = 1000.0
"""Usual rate of listed sensors, Hz: what displacement probes of spindle tests are sampled with."""

INPUT_RATE = 1.0
"""Rate of listed thermometers, Hz: what loggers of machine tools' temperatures have."""

FORCE_RATE = 100.0
"""Rate of load cells, Hz."""


def fields_of(stream: str, sensors: Mapping[str, ListedSensor]) -> tuple[str, ...]:
    """Fields of a sample of a stream of a stage that lists these sensors."""
    return sensors[stream].fields if stream in sensors else samples_columns(stream)


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


def stage_clocks(
    heads: Sequence[str] = "abcd",
    rate: float | None = None,
    sensors: Sequence[str] = (),
    inputs: Mapping[str, ListedSensor] | None = None,
) -> dict[str, Clock]:
    """Clocks of all streams by name; none coincides with another.

    Args:
        heads: letters of the read heads.
        rate: rate of heads, autocollimator, command and listed sensors, Hz; None takes 250, 400, 250 and 1000 Hz as
            usual recordings do.
        sensors: streams of the listed sensors, such as `axial_probe_top`.
        inputs: listed sensors that are inputs by their streams, such as `thermometer_bearing`.
    """
    head_rate, collimator_rate, command_rate, listed_rate = (
        (250.0, 400.0, 250.0, LISTED_RATE) if rate is None else (rate,) * 4
    )
    fast = {f"{HEAD}{name}": Clock(head_rate, (0.2 + 0.03 * i) / head_rate) for i, name in enumerate(heads)}
    fixed = {
        AUTOCOLLIMATOR: Clock(collimator_rate, 0.4 / collimator_rate),
        OWN_REFERENCE: Clock(250.0, 0.0028),
        COMMAND: Clock(command_rate),
        FORCE: Clock(FORCE_RATE, 0.001),
        TEMPERATURE: Clock(5.0),
    }
    listed = {name: Clock(listed_rate, (0.33 + 0.013 * i) / listed_rate) for i, name in enumerate(sensors)}
    acting = {
        name: Clock(INPUT_RATE, 0.1 + 0.013 * i) if sensor.is_slow else Clock(FORCE_RATE, 0.0013 + 0.0002 * i)
        for i, (name, sensor) in enumerate((inputs or {}).items())
    }
    return fast | fixed | listed | acting
