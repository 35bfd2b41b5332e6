"""Listed sensors that say the same again and again: a broken cable, a probe out of range, an amplifier that hangs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.repeated_readings import runs_of
from rotary_error_monitor.twin.recording import FEWEST_SAMPLES, SignalStream, StageRecording

SAME = 100
"""Equal samples after which a sensor is stuck: where noise is half a step or more, one sample is some number of steps
with a probability of 0.68 at most, so many in a row with one of 10^-16."""

FINE = 0.5
"""Noise, in steps of a reading, below which a probe at rest says the same again and again."""


def without_stuck(stage: StageDescription, recording: StageRecording) -> StageRecording:
    """The recording without the samples of listed sensors that are stuck, and a remark that says so."""
    streams, remarks = dict[str, SignalStream](recording.streams), list(recording.remarks)
    for name, sensor in stage.sensors.items():
        if name not in streams or sensor.noise < FINE * sensor.resolution:
            continue
        stream = streams[name]
        stuck = np.logical_or.reduce([_in_long_runs(column) for column in stream.values.T])
        if not stuck.any():
            continue
        remarks.append(_told(name, stream, stuck, sensor))
        _leave(streams, name, ~stuck)
    return StageRecording(recording.start_ns, streams, tuple(remarks))


def _leave(streams: dict[str, SignalStream], name: str, kept: NDArray[np.bool_]) -> None:
    if np.count_nonzero(kept) < FEWEST_SAMPLES:
        del streams[name]
    else:
        streams[name] = SignalStream(streams[name].time[kept], streams[name].values[kept])


def _in_long_runs(values: Array) -> NDArray[np.bool_]:
    """(n,) which samples are among `SAME` or more equal ones."""
    _, lengths = runs_of(values)
    return np.repeat(lengths >= SAME, lengths)


def _told(name: str, stream: SignalStream, stuck: NDArray[np.bool_], sensor: ListedSensor) -> str:
    values, count = stream.values[stuck][0], np.count_nonzero(stuck)
    beyond = ", the end of its range" if np.any(np.abs(values) >= sensor.range) else ""
    since, told = float(stream.time[stuck][0]), ", ".join(f"{1e6 * value:.4g}" for value in values)
    return f"{name}: stuck at {told} µ{sensor.unit}{beyond} from {since:.1f} s on; {count} equal samples are left out"
