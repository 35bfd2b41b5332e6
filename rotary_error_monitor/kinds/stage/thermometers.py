"""Which of the thermometers that a stage lists are of use in a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotary_error_monitor.description.stage import ListedSensor, StageDescription
from rotary_error_monitor.metrology.repeated_readings import longest_run, run_by_chance
from rotary_error_monitor.twin.recording import StageRecording, Stream


def with_useful_inputs(stage: StageDescription, recording: StageRecording) -> tuple[StageDescription, StageRecording]:
    """Stage and recording without the listed inputs that tell nothing; remarks say so.

    Those are the ones that were not recorded, read beyond their range, or are stuck. Nothing can be known of what goes
    with the warming of such a place.
    """
    streams, remarks, inputs = dict(recording.streams), list(recording.remarks), dict(stage.inputs)
    for name, sensor in stage.inputs.items():
        if name in streams:
            told = _beyond(streams[name], sensor) or _stuck(streams[name], sensor)
            if not told:
                continue
            remarks.append(f"{name}: {told}; left out")
            del streams[name]
        del inputs[name]
    if len(inputs) == len(stage.inputs):
        return stage, recording
    return replace(stage, inputs=inputs), StageRecording(recording.start_ns, streams, tuple(remarks))


def _beyond(stream: Stream, sensor: ListedSensor) -> str:
    """What it reads where that is beyond its range; empty where it is not."""
    most = float(np.max(np.abs(stream.values)))
    if most < sensor.range:
        return ""
    return f"read {most:.4g} {sensor.unit}, the end of its range or beyond ({sensor.range:.4g})"


def _stuck(stream: Stream, sensor: ListedSensor) -> str:
    """Since when it has been stuck, and where; empty where its noise may let it repeat for as long.

    A temperature may stand still within a step for minutes. But noise moves a reading, wherever in a step it stands,
    and one that stays for longer than chance allows does not show it.
    """
    most = run_by_chance(sensor.noise, sensor.resolution)
    for column in stream.values.reshape(len(stream.time), -1).T:
        begin, count = longest_run(column)
        if count > most:
            return (
                f"stuck at {column[begin]:.4g} {sensor.unit} from {stream.time[begin]:.1f} s on: {count} equal ones "
                f"where noise ({sensor.noise:.4g}) and resolution ({sensor.resolution:.4g}) leave {most:.0f} at most"
            )
    return ""
