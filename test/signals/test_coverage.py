"""What a recording covers: begin, end, silences and missing samples of any stream, whatever its rate and blocks."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.signals.coverage import MessageSpans, absence_remarks, coverage_remarks

START = 1_763_700_000_000_000_000
SECOND = 1_000_000_000


def spans(period_ns, samples, size, lost=(), jitter=0.0):
    """Messages of a stream of `samples` samples in blocks of `size`, without those whose number is in `lost`."""
    found = MessageSpans()
    random = np.random.default_rng()
    for block in range(0, samples, size):
        if block // size in lost:
            continue
        times = START + period_ns * np.arange(block, block + size)
        if size == 1:
            found.add_stamp(int(times[0]) + round(jitter * period_ns * random.uniform(-1, 1)))
        else:
            found.add_block(block_from_samples(times, ["x"], np.zeros((size, 1))))
    return found


def covered(*arguments, **options):
    return spans(*arguments, **options).coverage()


@settings(max_examples=200, deadline=None)
@given(
    period=st.integers(10_000, 1_000_000_000),
    blocks=st.integers(30, 200),
    size=st.sampled_from([1, 2, 3, 50]),
    data=st.data(),
)
def test_every_lost_message_is_found(period, blocks, size, data):
    lost = data.draw(st.sets(st.integers(1, blocks - 2), max_size=blocks // 20))
    found = covered(period, blocks * size, size, lost)
    assert found.lost == size * len(lost)
    assert found.samples == size * (blocks - len(lost))
    assert (found.first_ns, found.last_ns) == (START, START + period * (blocks * size - 1))
    assert found.overlapping == 0
    runs = sum(1 for number in lost if number - 1 not in lost)
    assert len(found.silences) == len(found.missing) == runs
    assert found.period_ns == pytest.approx(period, abs=1.0)


def test_stamps_that_are_not_exact_hide_no_loss_and_make_none():
    assert covered(10_000_000, 5000, 1, jitter=0.2).lost == 0
    assert covered(10_000_000, 5000, 1, {7, 8, 9, 400}, jitter=0.2).lost == 4


def test_a_block_that_lacks_samples_inside():
    found = spans(1_000_000, 100, 10)
    torn = np.delete(np.arange(100, 120), [7, 8, 9])
    found.add_block(block_from_samples(START + 1_000_000 * torn, ["x"], np.zeros((17, 1))))
    covered = found.coverage()
    assert covered.lost == 3
    (text,) = coverage_remarks({"a": covered})
    assert text.startswith("a: 3 samples (2.5 %) are missing in 1 silence, the longest of 0.019 s")


def test_poses_at_any_time_have_no_rate():
    found = MessageSpans()
    for stamp in START + np.cumsum(np.random.default_rng().lognormal(0, 2, 200) * SECOND).astype(np.int64):
        found.add_stamp(int(stamp))
    covered = found.coverage()
    assert covered.period_ns == 0.0 and covered.lost == 0
    assert coverage_remarks({"poses": covered}) == ()


def test_messages_in_any_order_cover_the_same():
    found = spans(1_000_000, 1000, 10, {20, 21})
    order = np.random.default_rng().permutation(len(found.first_ns))
    parts = found.first_ns, found.last_ns, found.samples
    mixed = MessageSpans(*(array("q", [values[i] for i in order]) for values in parts))
    one, other = found.coverage(), mixed.coverage()
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, vars(other)[name])


def test_nothing_covers_nothing():
    assert MessageSpans().coverage() is None
    empty = MessageSpans()
    empty.add_block(block_from_samples(np.array([START]), ["x"], np.zeros((1, 1))))
    covered = empty.coverage()
    assert (covered.samples, covered.period_ns, covered.lost) == (1, 0.0, 0)
    assert coverage_remarks({}) == ()
    assert coverage_remarks({"a": covered}) == ()


def test_a_recording_without_fault_has_no_remark():
    """Instruments that start a second apart, a slow thermometer, a controller that jitters."""
    streams = {
        "head": covered(100_000, 300_000, 50),
        "joints": covered(10_000_000, 3000, 1, jitter=0.2),
        "temperature": covered(SECOND, 30, 1),
    }
    assert coverage_remarks(streams) == ()


def test_a_head_that_ends_halfway_and_one_that_begins_late():
    streams = {"a": covered(100_000, 400_000, 50), "b": covered(100_000, 200_000, 50)}
    assert coverage_remarks(streams) == ("b: no sample in the last 20.0 s of 40.0 s",)
    late = spans(100_000, 400_000, 50, range(4000))
    assert coverage_remarks(streams | {"b": late.coverage()}) == ("b: no sample in the first 20.0 s of 40.0 s",)


def test_streams_that_lack_the_same_are_named_together():
    streams = {name: covered(100_000, 400_000, 50, range(100, 500)) for name in "abc"}
    (text,) = coverage_remarks(streams)
    assert text == "a, b, c: 20000 samples (5 %) are missing in 1 silence, the longest of 2.000 s at 0.500 s"


def test_two_that_publish_one_stream_are_seen():
    found = spans(1_000_000, 1000, 10)
    other = spans(1_000_000, 1000, 10)
    for values, more in zip(vars(found).values(), vars(other).values(), strict=True):
        values.extend(more if values is found.samples else [value + 3_000_000 for value in more])
    (text,) = coverage_remarks({"a": found.coverage()})
    assert "199 messages begin before the one before has ended" in text


def test_what_is_absent_is_named():
    assert absence_remarks(("a", "b", "c"), {"a"}) == ("no sample at all of b, c",)
    assert absence_remarks(("a",), {"a"}) == ()
