"""The watch over a stream and the message for /diagnostics."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from rotary_error_monitor.nodes.diagnostics import (
    Condition,
    Level,
    RateMeter,
    StreamWatch,
    diagnostic_array,
    status_name,
)
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

MS = 1_000_000


def block(start_ms: int, count: int = 5) -> SampleBlock:
    times = np.arange(start_ms, start_ms + count, dtype=np.int64) * MS
    return block_from_samples(times, ("angle",), np.zeros((count, 1)))


def watch() -> StreamWatch:
    return StreamWatch("/stage/head_a/samples", late_after=0.02, stale_after=0.5, began_ns=0)


def test_before_anything_arrives():
    stream = watch()
    first = stream.report(100 * MS)
    assert (first.level, first.message) == (Level.WARN, "nothing has arrived yet")
    assert first.figures["age_ms"] == "none"
    assert stream.report(600 * MS).level is Level.ERROR


def test_rate_and_age_of_a_stream_that_is_alive():
    stream = watch()
    for start in range(0, 1000, 5):
        stream.observe(block(start), (start + 5) * MS)
    report = stream.report(1000 * MS)
    assert (report.level, report.message) == (Level.OK, "alive")
    assert report.figures["rate_hz"] == 1000.0
    assert report.figures["age_ms"] == 1.0
    assert report.figures["lost_samples"] == 0


def test_lost_samples_are_counted_from_the_stamps():
    stream = watch()
    stream.observe(block(0), 5 * MS)
    stream.observe(block(12), 17 * MS)
    report = stream.report(17 * MS)
    assert report.figures["lost_samples"] == 7
    assert report.level is Level.WARN
    assert "7 samples lost" in report.message
    assert stream.report(18 * MS).level is Level.OK, "only what is new is a warning"


def test_blocks_of_one_sample_keep_the_period_of_longer_ones():
    stream = watch()
    stream.observe(block(0, 2), 2 * MS)
    stream.observe(block(2, 1), 3 * MS)
    stream.observe(block(5, 1), 6 * MS)
    assert stream.lost == 2


def test_late_and_refused():
    stream = watch()
    stream.observe(block(0), 30 * MS)
    stream.refuse("no finite number")
    report = stream.report(30 * MS)
    assert (report.figures["late_blocks"], report.figures["refused_messages"]) == (1, 1)
    assert report.message.endswith("refused: no finite number")


def test_samples_that_were_refused_of_whole_messages():
    stream = watch()
    stream.observe(block(0), 5 * MS)
    stream.refused_samples = Counter({"not finite": 2, "a spike": 0})
    report = stream.report(10 * MS)
    assert (report.level, report.message) == (Level.WARN, "alive; samples refused: 2 not finite")
    assert report.figures["refused_samples"] == 2
    stream.refused_samples["a spike"] += 1
    assert stream.report(10 * MS).message == "alive; samples refused: 1 a spike"
    assert stream.report(10 * MS).level is Level.OK, "only what is new is a warning"


def test_a_stream_goes_stale():
    stream = watch()
    stream.observe(block(0), 5 * MS)
    assert not stream.is_stale(504 * MS)
    assert stream.is_stale(505 * MS)
    report = stream.report(1004 * MS)
    assert (report.level, report.message) == (Level.ERROR, "stale: the last sample is 1 s old")


def test_message_names_node_and_part():
    message = diagnostic_array(
        Time(sec=1), "lvdt", "mock", [Condition("state", Level.WARN, "inactive", {"rate_hz": 249.99999, "n": 3})]
    )
    status = message.status[0]
    assert (status.name, status.hardware_id, status.level) == ("lvdt: state", "mock", b"\x01")
    assert {each.key: each.value for each in status.values} == {"rate_hz": "250", "n": "3"}


@pytest.mark.parametrize("pause_ms", [1, 10, 400])
def test_a_report_that_follows_at_once_keeps_the_rate(pause_ms):
    """A node speaks beside its turn where something has changed: between two such reports hardly a block comes."""
    stream = watch()
    for start in range(0, 1000, 5):
        stream.observe(block(start), (start + 5) * MS)
    stream.report(1000 * MS)
    assert stream.report((1000 + pause_ms) * MS).figures["rate_hz"] == 1000.0
    for start in range(1000, 2000, 5):
        stream.observe(block(start), (start + 5) * MS)
    assert stream.report(2000 * MS).figures["rate_hz"] == 1000.0
    assert stream.report(3000 * MS).figures["rate_hz"] == 0.0, "what is silent for a second has no rate"


def test_a_rate_after_a_clock_was_set_back():
    meter = RateMeter(10_000 * MS)
    meter.add(100)
    assert meter.rate(11_000 * MS) == 100.0
    meter.add(3)
    assert meter.rate(0) == 0.0
    meter.add(50)
    assert meter.rate(1000 * MS) == 50.0


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("lvdt: state", "lvdt: state"),
        ("error_estimator: /stage/head_a/samples", "error_estimator: stage.head_a.samples"),
        ("left/compensation: publishers of /left/joint_states", "left.compensation: publishers of left.joint_states"),
    ],
)
def test_names_hold_no_separator_of_trees(name, shown):
    assert status_name(name) == shown
