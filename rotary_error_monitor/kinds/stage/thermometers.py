"""Which of the thermometers and load cells that a stage lists are of use in a recording."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.repeated_readings import longest_run, run_by_chance
from rotary_error_monitor.sensors.library import input_of
from rotary_error_monitor.signals.reading_noise import noise_of
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

LOUD = 3.0
"""Times the stated scatter from which it is said: what data sheets state is met within a factor of two."""

_JUDGED = 100
"""Readings from which a scatter is known within a sixth, at four standard deviations of it."""


def with_useful_inputs(stage: StageDescription, recording: StageRecording) -> tuple[StageDescription, StageRecording]:
    """Stage and recording without the listed inputs that tell nothing; remarks say so.

    Those are the ones that were not recorded, read beyond their range, or are stuck. Nothing can be known of what goes
    with the warming of such a place. One that scatters more than it should is used, and that is said.
    """
    streams, remarks, inputs = dict(recording.streams), list(recording.remarks), dict(stage.inputs)
    for name, sensor in stage.inputs.items():
        if name in streams:
            kind = input_of(name)
            assert kind is not None  # only such sensors are among a stage's inputs
            readings = streams[name].values[:, : kind.looked_at(sensor)]
            read = SignalStream(streams[name].time, readings)
            told = _beyond(read, sensor) or _stuck(read, sensor)
            if not told:
                remarks += _loud(name, read, sensor)
                continue
            remarks.append(f"{name}: {told}; left out")
            del streams[name]
        del inputs[name]
    if len(remarks) == len(recording.remarks) and len(inputs) == len(stage.inputs):
        return stage, recording
    return replace(stage, inputs=inputs), StageRecording(recording.start_ns, streams, tuple(remarks))


def _beyond(stream: SignalStream, sensor: ListedSensor) -> str:
    """What it reads where that is beyond its range; empty where it is not."""
    most = float(np.max(np.abs(stream.values)))
    if most < sensor.range:
        return ""
    return f"read {most:.4g} {sensor.unit}, the end of its range or beyond ({sensor.range:.4g})"


def _stuck(stream: SignalStream, sensor: ListedSensor) -> str:
    """Since when it has been stuck, and where; empty where its noise may let it repeat for as long.

    A temperature may stand still within a step for minutes. But noise moves a reading, wherever in a step it stands,
    and one that stays for longer than chance allows does not show it. An instrument that cuts off towards zero, as any
    may, reads 0 over two steps.
    """
    for column in stream.values.reshape(len(stream.time), -1).T:
        # Each on its own: a long run of 0, which is sound, hides no shorter one elsewhere that is not.
        for same, steps in ((column == 0.0, 2), (column != 0.0, 1)):
            begin, count = longest_run(np.where(same, column, np.nan))
            most = run_by_chance(sensor.noise, steps * sensor.resolution)
            if count <= most:
                continue
            return (
                f"stuck at {column[begin]:.4g} {sensor.unit} from {stream.time[begin]:.1f} s on: {count} equal ones "
                f"where noise ({sensor.noise:.4g}) and resolution ({sensor.resolution:.4g}) leave {most:.0f} at most"
            )
    return ""


def _loud(name: str, stream: SignalStream, sensor: ListedSensor) -> list[str]:
    """A remark where readings differ from one to the next by far more than noise and resolution make them."""
    stated = math.hypot(sensor.noise, sensor.resolution / math.sqrt(12))
    if sensor.is_slow or len(stream.time) < _JUDGED:  # what is slow may change between two readings
        return []
    seen = float(noise_of(stream.values).max())
    if seen <= LOUD * stated + sensor.resolution:
        return []
    return [f"{name}: scatters by {seen:.2g} {sensor.unit}, where noise and resolution state {stated:.2g}"]
