"""The commanded rotation is scipy's cubic through angles and speeds, without its coefficients."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from rotary_error_monitor.twin import commanded
from rotary_error_monitor.twin.commanded import CommandCurve


@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_hermite_spline(seed, monkeypatch):
    monkeypatch.setattr(commanded, "_AT_ONCE", 37)
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 300))
    time = np.cumsum(rng.uniform(0.001, 0.003, count))
    angle, speed = np.cumsum(rng.normal(size=count)), 100 * rng.normal(size=count)
    known = CubicHermiteSpline(time, angle, speed)
    found = CommandCurve(time, angle, speed)
    # Anywhere, in any order, on the samples themselves, and beyond them.
    wanted = np.concatenate([rng.uniform(time[0] - 0.01, time[-1] + 0.01, 500), time])
    for shape in ((-1,), (1, -1), (-1, 1)):
        at = wanted.reshape(shape)
        np.testing.assert_allclose(found.angle(at), known(at), rtol=1e-12, atol=1e-12 * np.abs(angle).max())
        # The slope of a cubic is a difference of angles over an interval of milliseconds.
        slope, straight = known.derivative()(at), np.interp(at, time, speed)
        before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, count - 2)
        turns_back = (speed[before] * speed[before + 1] > 0) & (slope * speed[before] <= 0)
        slope = np.where(turns_back & (at >= time[0]) & (at <= time[-1]), straight, slope)
        within = ~turns_back | ((at >= time[0]) & (at <= time[-1]))
        np.testing.assert_allclose(found.speed(at)[within], slope[within], rtol=1e-9, atol=1e-9 * np.abs(speed).max())


@pytest.mark.parametrize("seed", range(8))
def test_a_stage_that_starts_does_not_turn_back_first(seed):
    """Between a sample at rest and the next the cubic overshoots: the direction of travel is that of both ends."""
    rng = np.random.default_rng(seed)
    time, begin, jerk = np.arange(0, 1, 0.002), rng.uniform(0.2, 0.4), 10 ** rng.uniform(0, 4)
    since = np.maximum(time - begin, 0.0)
    found = CommandCurve(time, jerk * since**4 / 24, jerk * since**3 / 6)
    fine = np.linspace(begin + 0.004, 0.99, 5000)
    assert (found.speed(fine) > 0).all()
    assert np.abs(found.speed(fine) - jerk * (fine - begin) ** 3 / 6).max() < jerk * 0.002**3 / 6


def test_what_is_no_time_has_no_angle():
    found = CommandCurve(np.arange(3.0), np.zeros(3), np.zeros(3))
    np.testing.assert_array_equal(found.angle(np.array([0.5, np.nan])), [0.0, np.nan])
    assert found.angle(np.zeros(0)).shape == (0,)
