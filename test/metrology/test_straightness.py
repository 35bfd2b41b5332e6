"""Reference lines against closed forms and brute force; repeated runs with a known reversal part."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.straightness import (
    LineMethod,
    Run,
    combine_runs,
    estimate_straightness,
    fit_line,
)

METHODS: tuple[LineMethod, ...] = ("least_squares", "end_point", "minimum_zone")


def test_parabola_in_closed_form() -> None:
    x = np.linspace(-1.0, 1.0, 2001)
    profile = 3e-6 * x**2 + 2e-6 * x + 1e-6
    for method in METHODS:
        result = estimate_straightness(x, profile, method)
        assert result.line.slope == pytest.approx(2e-6, rel=1e-6)
        assert result.error == pytest.approx(3e-6, rel=1e-6)
    assert fit_line(x, profile, "end_point").heights(np.array([0.0]))[0] == pytest.approx(4e-6)
    assert fit_line(x, profile, "minimum_zone").heights(np.array([0.0]))[0] == pytest.approx(2.5e-6)
    assert fit_line(x, profile, "least_squares").heights(np.array([0.0]))[0] == pytest.approx(2e-6, rel=1e-3)


def narrowest_zone(x: np.ndarray, y: np.ndarray) -> float:
    """The narrowest zone touches two points on one side: try every pair."""
    widths = []
    for i, j in itertools.combinations(range(len(x)), 2):
        if x[i] != x[j]:
            widths.append(float(np.ptp(y - (y[j] - y[i]) / (x[j] - x[i]) * x)))
    return min(widths)


@settings(max_examples=100, deadline=None)
@given(st.integers(3, 12), st.integers(0, 2**32 - 1))
def test_minimum_zone_against_all_pairs(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.4, 0.0, count)
    y = 5e-6 * rng.normal(size=count)
    error = estimate_straightness(x, y, "minimum_zone").error
    assert error == pytest.approx(narrowest_zone(x, y), rel=1e-6)
    assert error <= estimate_straightness(x, y, "least_squares").error * (1 + 1e-9)
    assert error <= estimate_straightness(x, y, "end_point").error * (1 + 1e-9)


def test_least_squares_against_polyfit() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 1, 50), rng.normal(size=50)
    line = fit_line(x, y)
    slope, offset = np.polyfit(x, y, 1)
    np.testing.assert_allclose(line.heights(x), offset + slope * x)


@pytest.mark.parametrize("method", METHODS)
def test_a_straight_line_is_straight(method: LineMethod) -> None:
    x = np.array([0.0, 0.3, 0.31, 1.0])
    assert estimate_straightness(x, 1e-3 + 2e-3 * x, method).error < 1e-12
    assert estimate_straightness(x, np.zeros(4), method).error == 0.0


def runs(reversal: float, spread: float, seed: int) -> list[Run]:
    rng = np.random.default_rng(seed)
    made = []
    for number in range(10):
        direction = 1 if number % 2 == 0 else -1
        x = np.sort(rng.uniform(-0.8, -0.36, 440))[::direction]
        shape = 3e-6 * np.sin(8 * x) + 0.5 * direction * reversal * np.cos(20 * x)
        made.append(Run(x, shape + spread * rng.normal(size=x.size) + 1e-5 * rng.normal(), direction))
    return made


def test_runs_forward_and_back_show_reversal_and_repeatability() -> None:
    result = combine_runs(runs(reversal=0.4e-6, spread=60e-9, seed=1), spacing=10e-3)
    expected = 3e-6 * np.sin(8 * result.positions)
    # Twelve samples of the profile in a cell: its slope over the cell shows as 10 mm / sqrt(12) / sqrt(10) in a mean.
    tolerance = 4 * (60e-9 / math.sqrt(100) + 24e-6 * 10e-3 / math.sqrt(12 * 100))
    np.testing.assert_allclose(result.mean - result.mean.mean(), expected - expected.mean(), atol=tolerance)
    assert result.reversal is not None
    wave = 0.4e-6 * np.cos(20 * result.positions)
    np.testing.assert_allclose(result.reversal, wave - wave.mean(), atol=3 * tolerance)
    assert result.standard_uncertainty == pytest.approx(np.sqrt((result.spread**2).mean() / 10))


def test_repeatability_is_that_of_the_runs() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0, 1, 201)
    made = [Run(x, 100e-9 * rng.normal(size=x.size), 1) for _ in range(20)]
    result = combine_runs(made, spacing=0.01)
    # Two samples a cell.
    assert np.sqrt((result.spread**2).mean()) == pytest.approx(100e-9 / math.sqrt(2), rel=0.05)
    assert result.reversal is None
    assert result.largest_deviation > 3 * 70e-9


def test_bad_runs_are_refused() -> None:
    x = np.linspace(0, 1, 11)
    good = Run(x, np.zeros(11), 1)
    with pytest.raises(InputError, match="1 runs forward and 0 backward"):
        combine_runs([good])
    with pytest.raises(InputError, match=r"directions \[1, 2\]"):
        combine_runs([good, Run(x, np.zeros(11), 2)])
    with pytest.raises(InputError, match="share only"):
        combine_runs([good, Run(x + 2, np.zeros(11), 1)])
    hole = np.delete(x, [4, 5, 6])
    with pytest.raises(InputError, match="no sample from"):
        combine_runs([good, Run(hole, np.zeros(8), 1)], spacing=0.2)


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([0.0], [1.0], "make no profile"),
        ([0.0, 0.0], [1.0, 2.0], "make no profile"),
        ([0.0, 1.0], [1.0], "do not fit"),
        ([0.0, 1.0], [1.0, math.nan], "profile 1 is not finite"),
        ([math.inf, 1.0], [1.0, 1.0], "position 0 is not finite"),
    ],
)
def test_bad_profiles_are_refused(x: list[float], y: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_line(np.array(x), np.array(y))
