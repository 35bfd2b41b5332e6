"""Instruments and channels of a stage's recording: the noise that is stated of each, and what it is called."""

from __future__ import annotations

from rotary_error_monitor.description.listed_sensors import short_names
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.sensors.library import instrument_of, sensor_kinds, sensor_of


def noise_std(stage: StageDescription) -> dict[str, float]:
    """Standard deviation of one sample of each instrument as the stage states it, rounding included, rad or m.

    Instruments are what `instrument_of` says; a kind of which the stage has none has 0.
    """
    found: dict[str, float] = {}
    for kind, sensor in sensor_kinds().items():
        streams = sensor.streams(stage)
        found |= {instrument_of(stream): sensor.noise(stage, stream) for stream in streams} if streams else {kind: 0.0}
    return found


def channels_of(stream: str) -> tuple[str, ...]:
    """Names of a sensor's channels, one for each of its fields: two of an autocollimator, `axial_probe_top` alone."""
    fields = sensor_of(stream).fields
    return (stream,) if len(fields) == 1 else tuple(f"{stream}.{axis}" for axis in short_names(fields))
