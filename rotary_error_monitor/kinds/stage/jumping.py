"""Thermometers whose readings jump: somebody touched one, its plug was moved, its cable broke for a while."""

from __future__ import annotations

from dataclasses import replace

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import TEMPERATURE
from rotary_error_monitor.metrology.thermometer_course import thermometer_jumps
from rotary_error_monitor.twin.recording import StageRecording


def with_jumps_told(stage: StageDescription, recording: StageRecording) -> StageRecording:
    """The recording with a remark on each jump of a thermometer.

    The twin has the temperature without it (`metrology/thermometer_course.py`): a stage does not warm so fast.
    """
    told = []
    for name in (TEMPERATURE, *sorted(stage.thermometers.values())):
        if name in recording.streams:
            read = recording.streams[name]
            told += [
                f"{name}: jumps by {jump.size:+.2f} K at {jump.moment:.1f} s, faster than any stage warms; taken off"
                for jump in thermometer_jumps(read.time, read.values[:, 0])
            ]
    return replace(recording, remarks=(*recording.remarks, *told)) if told else recording
