"""Values at ticks against closed forms: polynomials are exact, noise falls as the gain says, chunks do not matter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels import FORMS, computing_by, is_built

from rotary_error_monitor.metrology.error_motion import bend_variance
from rotary_error_monitor.signals.resampling import count_decided, resample, tick_times

PERIOD = 1_000_000
GAP = 20_000_000


def sampled(rate: float, duration: float, offset_ns: int = 0) -> np.ndarray:
    step = round(1e9 / rate)
    return offset_ns + step * np.arange(round(duration * rate), dtype=np.int64)


@pytest.mark.parametrize(("rate", "degree"), [(250.0, 3), (400.0, 3), (50_000.0, 2), (10_000.0, 2)])
def test_polynomials_come_back_exactly(rate, degree):
    times = sampled(rate, 0.4, offset_ns=37_000)
    ticks = tick_times(30, 300, PERIOD)

    def motion(t_ns):
        t = t_ns * 1e-9
        return 2.0 + 3.0 * t + 40.0 * t**2 + (500.0 * t**3 if degree == 3 else 0.0)

    result = resample(times, motion(times)[:, None], ticks, PERIOD, GAP)
    assert result.valid.all()
    np.testing.assert_allclose(result.values[:, 0], motion(ticks), atol=1e-12)


@pytest.mark.parametrize("rate", [250.0, 3_000.0, 10_000.0, 50_000.0])
def test_gain_is_the_variance_that_noise_gets(rate):
    generator = np.random.default_rng(4)
    times = sampled(rate, 8.0)
    noise = generator.normal(size=len(times))
    ticks = tick_times(100, 7_800, PERIOD)
    result = resample(times, noise[:, None], ticks, PERIOD, GAP)
    assert result.valid.all()
    ratio = np.mean(result.values[:, 0] ** 2 / result.gain)
    assert ratio == pytest.approx(1.0, abs=0.12 if rate < 1000 else 0.06)


def test_a_dense_stream_is_averaged():
    times = sampled(50_000.0, 0.1)
    result = resample(times, np.zeros((len(times), 1)), tick_times(10, 50, PERIOD), PERIOD, GAP)
    np.testing.assert_allclose(result.gain, 9 / 4 / 45, rtol=0.15)  # a quadratic at the middle of 45 even samples


def test_brisk_acceleration_is_held_where_a_straight_line_errs():
    times = sampled(250.0, 1.0)
    acceleration = 50.0

    def motion(t_ns):
        return 0.5 * acceleration * (t_ns * 1e-9) ** 2

    ticks = tick_times(100, 800, PERIOD)
    result = resample(times, motion(times)[:, None], ticks, PERIOD, GAP)
    line = np.interp(ticks, times, motion(times))
    assert np.abs(line - motion(ticks)).max() > 5e-5
    assert np.abs(result.values[:, 0] - motion(ticks)).max() < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_what_interpolation_cannot_follow_is_told_whatever_the_distances_of_samples(seed):
    """Third differences of even samples; of the same signal by stamps that scatter about the same."""
    draw = np.random.default_rng(seed)
    even = 10_000_000 * np.arange(200, dtype=np.int64)
    ticks = 5_000_000 * np.arange(20, 380, dtype=np.int64)
    speed, bent = draw.uniform(1, 6), draw.uniform(10, 90)

    def bend(times, cubic):
        t = times * 1e-9
        values = (speed * t + 0.7 * t**2 + cubic * t**3)[:, None]
        found = resample(times, values, ticks, 5_000_000, 40_000_000)
        assert found.valid.all()
        return found.bend[:, 0]

    np.testing.assert_allclose(bend(even, bent), 6 * bent * 0.01**3, rtol=1e-5)
    scattered = even + np.rint(draw.uniform(-2.4e6, 2.4e6, len(even))).astype(np.int64)
    assert bend(scattered, 0.0).max() < 1e-9, "of a parabola there is none; its samples differ by 0.02 rad"
    assert (np.abs(bend(scattered, bent) / (6 * bent * 0.01**3) - 1) < 1.0).all()


@pytest.mark.parametrize("scatter", [0.0, 0.24])
@pytest.mark.parametrize("seed", range(5))
def test_what_interpolation_cannot_follow_bounds_what_it_misses(seed, scatter):
    """Motion whose speed goes up and down in ramps, by samples 10 ms apart: closed form between them."""
    draw = np.random.default_rng(seed)
    moments, levels = np.cumsum(draw.uniform(0.03, 0.4, 40)), draw.uniform(-6, 6, 40)
    fine = np.arange(0.0, moments[-1], 1e-5)
    speeds = np.interp(fine, moments, levels)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * 1e-5)])
    times = 10_000_000 * np.arange(int(moments[-1] * 100), dtype=np.int64)
    times = times + np.rint(draw.uniform(-scatter, scatter, len(times)) * 1e7).astype(np.int64)
    ticks = 1_000_000 * np.arange(50, int(moments[-1] * 1000) - 60, dtype=np.int64)
    found = resample(times, np.interp(times * 1e-9, fine, angle)[:, None], ticks, 1_000_000, 40_000_000)
    missed = np.abs(found.values[:, 0] - np.interp(ticks * 1e-9, fine, angle))[found.valid]
    bound = 6 * np.sqrt(bend_variance(np.column_stack([0 * found.bend[:, 0], found.bend[:, 0]])))[found.valid]
    assert found.valid.mean() > 0.95
    assert np.mean(missed > bound + 1e-8) <= 0.002
    assert np.median(bound) < 2e-4, "an uncertainty that bounds something"


@pytest.mark.parametrize("rate", [8_900.0, 10_000.0, 13_000.0, 50_000.0])
@pytest.mark.parametrize("place", range(5))
def test_one_sample_that_is_missing_costs_no_tick(rate, place):
    """Wherever in a cell it stood: of 11 samples one is lost, and cells are of another number."""
    times = sampled(rate, 0.4, offset_ns=37_000)
    times = np.delete(times, np.arange(place, len(times), 11))
    ticks = tick_times(30, 300, PERIOD)
    result = resample(times, (2.0 + 40.0 * (times * 1e-9) ** 2)[:, None], ticks, PERIOD, GAP)
    assert result.valid.all()
    np.testing.assert_allclose(result.values[:, 0], 2.0 + 40.0 * (ticks * 1e-9) ** 2, atol=1e-12)


def test_a_missing_block_leaves_no_value_and_no_neighbour_is_made_up():
    times = sampled(50_000.0, 0.1)
    hole = (times >= 40_000_000) & (times < 45_000_000)
    times = times[~hole]
    ticks = tick_times(0, 100, PERIOD)
    result = resample(times, times[:, None] * 1.0, ticks, PERIOD, GAP)
    np.testing.assert_array_equal(np.flatnonzero(~result.valid), [40, 41, 42, 43, 44])
    assert (result.values[~result.valid] == 0).all()


def test_sparse_samples_across_a_gap_are_not_joined():
    times = np.concatenate([sampled(250.0, 0.2), 600_000_000 + sampled(250.0, 0.2)])
    ticks = tick_times(0, 800, PERIOD)
    valid = resample(times, np.zeros((len(times), 1)), ticks, PERIOD, GAP).valid
    inside = ticks[valid]
    assert not ((inside > 196_000_000) & (inside < 600_000_000)).any()
    assert ((inside < 196_000_000).sum(), (inside > 600_000_000).sum()) == (188, 188)


@settings(deadline=None, max_examples=40)
@given(st.sampled_from([250.0, 2_000.0, 9_000.0, 50_000.0]), st.lists(st.integers(1, 90), min_size=1, max_size=8))
def test_bits_do_not_depend_on_the_chunks(rate, sizes):
    generator = np.random.default_rng(7)
    times = sampled(rate, 0.3, offset_ns=11_000)
    values = np.column_stack([1e3 + np.cumsum(generator.normal(size=len(times))), generator.normal(size=len(times))])
    ticks = tick_times(20, 250, PERIOD)
    whole = resample(times, values, ticks, PERIOD, GAP)
    start = 0
    while start < len(ticks):
        for size in sizes:
            part = ticks[start : start + size]
            if len(part):
                chunk = resample(times, values, part, PERIOD, GAP)
                for name in ("values", "gain", "travel", "valid"):
                    expected = getattr(whole, name)[start : start + size]
                    np.testing.assert_array_equal(getattr(chunk, name), expected)
            start += size


@settings(deadline=None, max_examples=60)
@given(st.sampled_from([250.0, 3_000.0, 20_000.0]), st.integers(5, 2_000))
def test_a_decided_tick_never_changes_when_more_samples_come(rate, known):
    times = sampled(rate, 0.5, offset_ns=3_000)
    known = min(known, len(times))
    values = np.sin(times * 1e-8)[:, None]
    ticks = tick_times(1, 480, PERIOD)
    decided = count_decided(times[:known], 1, 480, PERIOD)
    early = resample(times[:known], values[:known], ticks[:decided], PERIOD, GAP)
    late = resample(times, values, ticks[:decided], PERIOD, GAP)
    np.testing.assert_array_equal(early.values, late.values)
    np.testing.assert_array_equal(early.valid, late.valid)


@given(
    st.sampled_from([200, 500, 1000, 2000, 4000, 7000]),
    st.lists(st.integers(1, 12), min_size=3, max_size=30),
    st.integers(0, 1) | st.integers(0, 999_999),
)
def test_what_is_decided_does_not_change_with_the_samples_that_follow(rate, sizes, phase_ns):
    """Samples come in blocks of any size; a tick that counts as decided has the value that all samples together give,
    also where a sample stands exactly at the tick."""
    period_ns, max_gap_ns = 1_000_000, 20_000_000
    times = phase_ns + np.arange(sum(sizes), dtype=np.int64) * (1_000_000_000 // rate)
    values = np.sin(1e-7 * times)[:, None]
    first, count = int(times[0]) // period_ns, int(times[-1] - times[0]) // period_ns
    ticks = tick_times(first, count, period_ns)
    whole = resample(times, values, ticks, period_ns, max_gap_ns)
    for there in np.cumsum(sizes).tolist():
        decided = count_decided(times[:there], first, count, period_ns)
        part = resample(times[:there], values[:there], ticks[:decided], period_ns, max_gap_ns)
        np.testing.assert_array_equal(part.valid, whole.valid[:decided])
        np.testing.assert_array_equal(part.values, whole.values[:decided])


@pytest.mark.parametrize("form", [form for form in FORMS if form == "numpy" or is_built()])
@pytest.mark.parametrize("distance", [19_999_999, 20_000_000, 25_000_000])
@pytest.mark.parametrize("start", [0, 1_824_678_226_114_000_123])
def test_samples_as_far_apart_as_is_joined_give_a_value_at_each_tick(form, distance, start):
    """Rounding of their distance from a tick made it more than the limit at three ticks of four."""
    times = start + np.arange(12, dtype=np.int64) * distance
    ticks = tick_times((start + 2 * distance) // PERIOD, 8 * distance // PERIOD, PERIOD)
    values = np.sin(times * 1e-8)[:, None]
    with computing_by(form):
        assert resample(times, values, ticks, PERIOD, distance).valid.all()
        assert not resample(times, values, ticks, PERIOD, distance - 1).valid.any()
