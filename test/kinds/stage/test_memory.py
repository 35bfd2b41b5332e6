"""What a diagnosis of a long recording holds grows with its length by little more than the rows that it works on."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import LongStageProblem
from rotary_error_monitor.noise.channels import noise_std
from rotary_error_monitor.sensors.library import instrument_of
from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import twin_of

RATE = 100.0
"""Samples a second of each sensor, Hz."""

CHANNELS = 9
"""Of rows: the command, four heads, two axes of autocollimator and LVDT each."""

MOST = 4.0
"""Numbers of 8 bytes for each row, beyond the samples: the rows before and after a fit, a part of one for what they are
expected to be and when they were, and what one test of structure makes of the rows of one instrument."""


def recorded(seconds: float, seed: int = 1) -> StageRecording:
    """What the shipped stage shows with its noise while it turns to and fro at two speeds."""
    stage, rng = load_stage(), np.random.default_rng(seed)
    time = np.arange(seconds * RATE) / RATE
    speed = np.where(time % 40 < 20, 2.0, -1.0)
    streams = {name: SignalStream(time, np.zeros((len(time), 1))) for name in ("head_a", "head_b", "head_c", "head_d")}
    streams |= {name: SignalStream(time, np.zeros((len(time), 2))) for name in ("autocollimator", "lvdt")}
    streams["command"] = SignalStream(time, np.stack([np.cumsum(speed) / RATE, speed], axis=1))
    streams["temperature"] = SignalStream(time[::100], 20.0 + 0.01 * rng.standard_normal((len(time[::100]), 1)))
    recording, std = StageRecording(0, streams), noise_std(stage)
    shown = twin_of(stage, recording).predict()
    noisy = {n: values + std[instrument_of(n)] * rng.standard_normal(values.shape) for n, values in shown.items()}
    return StageRecording(0, streams | {name: SignalStream(time, values) for name, values in noisy.items()})


def peak_of(recording: StageRecording) -> int:
    """Most memory, bytes, of a diagnosis without any known effect, beyond the samples."""
    tracemalloc.start()
    try:
        found = diagnose(LongStageProblem(load_stage(), recording, ()))
        assert found.verdict is Verdict.NO_GAP
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.long
def test_memory_grows_by_a_few_numbers_for_each_row():
    """Six and a half, where each channel has times of its own and all channels are tested together."""
    short, long = 80.0, 240.0
    rows = CHANNELS * (long - short) * RATE
    assert peak_of(recorded(long)) - peak_of(recorded(short)) < 8 * MOST * rows
