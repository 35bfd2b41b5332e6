"""What is known of a stream by its stamps, however its samples are cut into blocks."""

import numpy as np
import pytest

from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.signals.streams import SampleStream

START, STEP = 1_700_000_000_000_000_000, 10_000_000  # ns


def taken(samples, size, patience_ns=100_000_000):
    """A stream that took in the samples of these numbers in blocks of one size."""
    stream = SampleStream(("angle",), patience_ns)
    for begin in range(0, len(samples), size):
        part = np.array(samples[begin : begin + size])
        stream.push(block_from_samples(START + STEP * part, ("angle",), part[:, None].astype(float)))
    return stream


@pytest.mark.parametrize("size", [1, 2, 5])
def test_the_rate_does_not_depend_on_the_size_of_blocks(size):
    assert taken(range(40), size).rate == pytest.approx(100.0)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_lost_samples_are_counted_and_leave_the_rate_as_it_is(size):
    stream = taken([*range(20), *range(25, 45)], size)
    assert stream.lost == round(5 / size)
    assert stream.rate == pytest.approx(100.0)
    numbers = np.arange(2, 45)  # before, nothing tells that it had not begun earlier
    expected = [not 17 <= number < 27 for number in numbers]
    assert stream.is_whole(START + STEP * numbers, STEP).tolist() == expected


def test_single_samples_at_uneven_stamps_have_the_rate_of_most_of_them():
    """Two publishers, or a driver that sends in bursts: a short distance between two is not the stream's rate."""
    numbers = np.cumsum([1, 1, 1, 0.01, 1.99] * 8)
    stream = SampleStream(("angle",), 100_000_000)
    for number in numbers:
        time = np.array([START + round(STEP * number)])
        stream.push(block_from_samples(time, ("angle",), np.zeros((1, 1))))
    assert stream.rate == pytest.approx(100.0)
    assert stream.lost == 0


@pytest.mark.parametrize("step", [1, 3, 10])
def test_another_rate_of_single_samples_is_learnt(step):
    """Each of the first distances looks like a loss; after three of them it is how the stream is."""
    stream = taken([*range(20), *range(20 + step, 20 + 30 * step, step)], 1, 10**9)
    assert stream.rate == pytest.approx(100.0 / step)
    assert stream.lost <= 3 * step


@pytest.mark.parametrize("seed", range(5))
def test_samples_are_those_of_all_blocks_and_what_was_handed_out_stays(seed):
    """Against plain concatenation, over blocks of any size, trims, whole turns and beginnings anew."""
    rng = np.random.default_rng(seed)
    stream, time_ns = SampleStream(["angle"], 10**9), 0
    times, values = np.empty(0, np.int64), np.empty((0, 1))
    handed: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(300):
        count = int(rng.integers(1, 40))
        new = time_ns + 1000 * np.arange(1, count + 1)
        time_ns = int(new[-1])
        rows = rng.normal(size=(count, 1))
        stream.push(block_from_samples(new, ["angle"], rows))
        times, values = np.concatenate([times, new]), np.concatenate([values, rows])
        what = rng.random()
        if what < 0.5:
            before_ns = int(times[rng.integers(len(times))])
            first = max(int(np.searchsorted(times, before_ns)) - 3, 0)
            stream.trim(before_ns)
            times, values = times[first:], values[first:]
        elif what < 0.55:
            stream.clear()
            times, values = times[:0], values[:0]
        np.testing.assert_array_equal(stream.times_ns, times)
        np.testing.assert_array_equal(stream.values, values)
        handed.append((stream.times_ns, stream.times_ns.copy()))
        handed.append((stream.values, stream.values.copy()))
        if 0.55 < what < 0.6:
            stream.turn_by(1)
            values = values - 2 * np.pi
    for view, copy in handed:
        np.testing.assert_array_equal(view, copy)
