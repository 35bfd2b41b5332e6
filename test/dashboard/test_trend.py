"""The trend of the day against the obvious way: all values kept, the largest of each minute looked for."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.dashboard.trend import MINUTES, DayTrend

MINUTE = 60_000_000_000
START = 1_700_000_000_000_000_000


@pytest.mark.parametrize("seed", range(8))
def test_the_largest_of_each_minute(seed):
    rng = np.random.default_rng(seed)
    pauses = np.where(rng.random(4000) < 0.01, rng.integers(0, 200, 4000) * MINUTE, rng.integers(0, 2 * MINUTE, 4000))
    times, values = START + np.cumsum(pauses), rng.normal(size=4000)
    trend = DayTrend(["a", "b"])
    for time, value in zip(times, values, strict=True):
        trend.note("a", value, int(time))
    now = int(times[-1]) + int(rng.integers(0, 3 * MINUTE))
    first = now // MINUTE - MINUTES + 1
    expected = np.full(MINUTES, np.nan)
    for time, value in zip(times, values, strict=True):
        if time // MINUTE >= first:
            expected[time // MINUTE - first] = np.fmax(expected[time // MINUTE - first], value)
    np.testing.assert_array_equal(trend.series("a", now), expected)
    assert np.isnan(trend.series("b", now)).all()


def test_a_day_of_silence_leaves_nothing():
    trend = DayTrend(["a"])
    trend.note("a", 1.0, START)
    assert np.isnan(trend.series("a", START + MINUTES * MINUTE)).all()


def test_a_clock_that_is_set_back_begins_anew():
    trend = DayTrend(["a"])
    trend.note("a", 9.0, START)
    trend.note("a", 1.0, START - 100 * MINUTE)
    values = trend.series("a", START - 100 * MINUTE)
    assert values[-1] == 1.0
    assert np.isnan(values[:-1]).all()


def test_what_is_not_finite_is_left_out():
    trend = DayTrend(["a"])
    trend.note("a", np.nan, START)
    trend.note("a", np.inf, START)
    assert np.isnan(trend.series("a", START)).all()
