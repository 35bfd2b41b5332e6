"""Which of the thermometers that a stage lists are of use in a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.twin.recording import StageRecording


def with_useful_inputs(stage: StageDescription, recording: StageRecording) -> tuple[StageDescription, StageRecording]:
    """Stage and recording without the listed inputs that were not recorded, or read beyond their range; remarks say so.

    Nothing can be known of what goes with the warming of such a place.
    """
    streams, remarks, inputs = dict(recording.streams), list(recording.remarks), dict(stage.inputs)
    for name, sensor in stage.inputs.items():
        if name in streams:
            most = float(np.max(np.abs(streams[name].values)))
            if most < sensor.range:
                continue
            told = f"{name}: read {most:.4g} {sensor.unit}, the end of its range or beyond ({sensor.range:.4g})"
            remarks.append(f"{told}; left out")
            del streams[name]
        del inputs[name]
    if len(inputs) == len(stage.inputs):
        return stage, recording
    return replace(stage, inputs=inputs), StageRecording(recording.start_ns, streams, tuple(remarks))
