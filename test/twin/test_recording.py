"""Recordings from sample blocks, and what is wrong with some."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.twin.recording import SignalStream, StageRecording, record_stage, thinned

START = 1_700_000_000_000_000_000
FIELDS = {
    "head_a": ("angle",),
    "head_b": ("angle",),
    "autocollimator": ("tilt_x", "tilt_y"),
    "command": ("angle", "velocity"),
}


def blocks(names, count=600, offset_ns=0, values=None):
    times = START + offset_ns + np.arange(count, dtype=np.int64) * 4_000_000
    content = np.zeros((count, len(names))) if values is None else values
    half = count // 2
    return [block_from_samples(times[s], names, content[s]) for s in (slice(0, half), slice(half, None))]


@pytest.fixture
def streams():
    return {name: blocks(names) for name, names in FIELDS.items()}


def test_blocks_become_continuous_streams(streams):
    recording = record_stage(streams, ["a", "b"])
    assert recording.heads == ("head_a", "head_b")
    assert recording.sensors == ("autocollimator", "head_a", "head_b")
    assert recording.start_ns == START
    assert recording.duration == pytest.approx(599 * 0.004)
    assert recording.streams["command"].values.shape == (600, 2)
    assert recording.streams["command"].period == pytest.approx(0.004)


def test_missing_streams_are_all_named(streams):
    del streams["head_b"], streams["command"]
    with pytest.raises(InputError, match=r"lacks /stage/head_b/samples, /stage/command/samples; it has /stage/auto"):
        record_stage(streams, ["a", "b"])


def test_too_few_samples_are_an_error(streams):
    streams["head_a"] = blocks(("angle",), count=40)
    with pytest.raises(InputError, match=r"/stage/head_a/samples: only 40 samples; 200 are needed"):
        record_stage(streams, ["a", "b"])


def test_a_few_samples_that_are_not_finite_are_left_out_and_told(streams):
    values = np.zeros((600, 2))
    values[10:13, 0] = np.nan
    streams["autocollimator"] = blocks(FIELDS["autocollimator"], values=values)
    recording = record_stage(streams, ["a", "b"])
    assert len(recording.streams["autocollimator"].time) == 597
    assert recording.remarks == ("/stage/autocollimator/samples: 3 samples are not finite and were left out",)


def test_many_samples_that_are_not_finite_are_an_error(streams):
    streams["head_a"] = blocks(("angle",), values=np.full((600, 1), np.nan))
    with pytest.raises(InputError, match=r"head_a/samples: 600 of 600 samples are not finite"):
        record_stage(streams, ["a", "b"])


def test_clocks_that_do_not_overlap_are_an_error(streams):
    streams["head_a"] = blocks(("angle",), offset_ns=3_600_000_000_000)
    with pytest.raises(InputError, match=r"clocks of /stage/head_a/samples .* and /stage/command/samples .* overlap"):
        record_stage(streams, ["a", "b"])


def test_of_fast_sensors_some_samples_are_used_those_of_all_heads_together():
    """At 10,000 samples a second one in ten; slower sensors, command and what is measured stay as they are."""
    time = np.arange(20_000) * 1e-4
    lost = np.r_[0:7_003, 7_100:20_000]
    streams = {
        "head_a": SignalStream(time + 3e-5, np.sin(time)[:, None]),
        "head_b": SignalStream(time[lost] + 9e-5, np.cos(time[lost])[:, None]),
        "autocollimator": SignalStream(time[::10], np.zeros((2_000, 2))),
        "command": SignalStream(time, np.zeros((20_000, 2))),
    }
    recording = thinned(StageRecording(START, streams, ("before",)), 1000.0)
    assert recording.remarks == ("before", "one sample in 10 is used of head_a, head_b")
    assert recording.start_ns == START
    assert all(recording.streams[name] is streams[name] for name in ("autocollimator", "command"))
    a, b = recording.streams["head_a"], recording.streams["head_b"]
    assert len(a.time) == 2_000 and len(b.time) == pytest.approx(1_990, abs=1)
    np.testing.assert_allclose(np.diff(a.time), 1e-3)
    np.testing.assert_array_equal(a.values[:, 0], np.sin(time)[np.rint((a.time - 3e-5) * 1e4).astype(int)])
    # whatever is lost, a head's samples stay beside those of the others
    apart = np.abs(b.time[:, None] - a.time[None, :]).min(axis=1)
    assert np.count_nonzero(apart > 1.001e-4) <= 1


@pytest.mark.parametrize(("rate", "used"), [(900.0, 900.0), (1000.0, 1000.0), (1700.0, 850.0), (50_000.0, 1000.0)])
def test_a_sensor_is_used_at_no_more_than_the_rate(rate, used):
    time = np.arange(round(2 * rate)) / rate
    streams = {"head_a": SignalStream(time, time[:, None]), "command": SignalStream(time, np.zeros((len(time), 2)))}
    kept = thinned(StageRecording(START, streams), 1000.0).streams["head_a"]
    assert 1 / kept.period == pytest.approx(used)
    assert len(kept.time) == pytest.approx(2 * used, abs=1)
