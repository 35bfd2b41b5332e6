"""Rotation to a monotone curve in closed form; grinding simulated on curves with the figures of Zhou et al. 2023."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.guideway_compensation import (
    VerticalAxis,
    WorkpieceCurve,
    compare_compensation,
    count_reversals,
    cut_curve,
    cut_workpiece,
    estimate_flatness,
    predict_corrections,
    predict_error_matrix,
    rotate_as_stated,
    rotate_monotone,
)

Array = NDArray[np.float64]


def curve(rng: np.random.Generator, length: float, error: float) -> tuple[Array, Array]:
    """A guideway of the given straightness error: a few long waves."""
    x = np.linspace(-length, 0.0, 701)
    y = sum(rng.normal() / k * np.cos(np.pi * k * x / length + rng.uniform(0, 2 * np.pi)) for k in range(1, 7))
    y = y - np.polyval(np.polyfit(x, y, 1), x)
    return x, y * error / np.ptp(y)


def vertical_axis(rng: np.random.Generator, reversal_error: float) -> VerticalAxis:
    """Positioning error of 1.2 µm in waves as short as the correction is long, so that all of it shows."""
    y = np.linspace(-1e-3, 1e-3, 8001)
    waves = sum(rng.normal() * np.cos(2 * np.pi * y / period + rng.uniform(0, 6.3)) for period in (20e-6, 50e-6, 2e-3))
    return VerticalAxis(reversal_error, y, waves * 1.2e-6 / np.ptp(waves))


def test_rotation_of_a_parabola_in_closed_form() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    # The steepest fall of (x - 0.3)^2 is at x = 0 with slope -0.6, its steepest rise at 1 with 1.4: rise by 0.6.
    rotated = rotate_monotone(x, 1e-6 * (x - 0.3) ** 2)
    assert rotated.rising
    assert rotated.angle == pytest.approx(0.6e-6, rel=2e-3)
    assert np.all(np.diff(rotated.errors) >= 0)
    falling = rotate_monotone(x, -1e-6 * (x - 0.3) ** 2)
    assert not falling.rising
    assert falling.angle == pytest.approx(-0.6e-6, rel=2e-3)
    assert np.all(np.diff(falling.errors) <= 0)


def test_monotone_curve_is_left_alone() -> None:
    x = np.array([0.0, 0.1, 0.5, 1.0])
    y = np.array([0.0, 1.0, 1.0, 3.0])
    rotated = rotate_monotone(x, y)
    assert rotated.angle == 0.0
    np.testing.assert_array_equal(rotated.errors, y)


@settings(max_examples=100, deadline=None)
@given(st.integers(3, 30), st.integers(0, 2**32 - 1))
def test_a_smaller_angle_would_not_do(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.01, 0.1, count))
    y = 1e-6 * rng.normal(size=count)
    rotated = rotate_monotone(x, y)
    steps = np.diff(rotated.errors)
    assert np.all(steps >= 0) if rotated.rising else np.all(steps <= 0)
    # All that was done is a slope.
    np.testing.assert_allclose(np.polyfit(x, rotated.errors - y, 1)[0], np.tan(rotated.angle), rtol=1e-6, atol=1e-15)
    for slope in np.linspace(-0.999, 0.999, 21) * abs(np.tan(rotated.angle)):
        less = np.diff(y + slope * x)
        assert less.min() < 0 < less.max() or rotated.angle == 0


def workpiece(rng: np.random.Generator) -> tuple[WorkpieceCurve, WorkpieceCurve]:
    """1400 mm x 500 mm on a grinder with the paper's figures: X 5.5 µm over 1400 mm, Z 5.8 µm over 800 mm."""
    parts = []
    for length, error, first, last, count in ((1.4, 5.5e-6, -1.4, 0.0, 281), (0.8, 5.8e-6, -0.65, -0.15, 101)):
        whole = curve(rng, length, error)
        parts.append(cut_workpiece(*whole, rotate_monotone(*whole), np.linspace(first, last, count)))
    return parts[0], parts[1]


@pytest.mark.parametrize("seed", range(8))
def test_rotated_curves_leave_the_same_whatever_the_reversal_error(seed: int) -> None:
    """Random guideways of the paper's figures, which went from 7.54 to 2.98 µm; positioning error 1.2 µm."""
    rng = np.random.default_rng(seed)
    x, z = workpiece(rng)
    axis = vertical_axis(rng, 0.0)
    results = [compare_compensation(x, z, replace(axis, reversal_error=size)) for size in (0.0, 1e-6, 3e-6)]
    for result in results:
        assert result.rotated.reversals == 0
        assert result.unrotated.reversals > 0
        # a range of 1.2 µm, which a tilt of the surface may make larger at its corners
        assert result.rotated.flatness <= 2 * 1.2e-6
    flatness = [result.rotated.flatness for result in results]
    assert np.ptp(flatness) <= 0.4e-6  # play shifts where the positioning error lies
    assert results[2].unrotated.flatness > results[0].unrotated.flatness + 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_perfect_vertical_axis_leaves_nothing(seed: int) -> None:
    x, z = workpiece(np.random.default_rng(seed))
    perfect = VerticalAxis(0.0, np.array([-1.0, 1.0]), np.zeros(2))
    result = compare_compensation(x, z, perfect)
    assert result.rotated.flatness < 1e-12
    assert result.unrotated.flatness < 1e-12


@pytest.mark.parametrize("play", [0.1e-6, 0.3e-6])
def test_a_reversal_leaves_a_step_of_the_reversal_error(play: float) -> None:
    """A bow makes the axis reverse once in the middle: a step there, whose range about its line is its height."""
    x = np.linspace(-1.0, 1.0, 2001)
    bow = 20e-6 * x**2
    flat = WorkpieceCurve(np.linspace(0, 1, 5), np.zeros(5), np.zeros(5), rotate_monotone(x, bow))
    along = cut_workpiece(x, bow, rotate_monotone(x, bow), x)
    result = compare_compensation(along, flat, VerticalAxis(play, np.array([-1.0, 1.0]), np.zeros(2)))
    # on the way through the play the bow shows: x² up to play/20 µm, and the step is no sharp one
    assert result.unrotated.flatness == pytest.approx(play, rel=0.12)
    assert result.rotated.flatness < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_the_whole_guideway_is_rotated_and_then_cut(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions, errors = curve(rng, 0.8, 5.8e-6)
    rotated = rotate_monotone(positions, errors)
    part = cut_workpiece(positions, errors, rotated, np.linspace(-0.65, -0.15, 51))
    added = np.interp(part.positions, positions, rotated.errors - errors)
    np.testing.assert_allclose(part.rotated - part.errors, added, rtol=0, atol=1e-18)
    np.testing.assert_allclose(np.polyfit(part.positions, added, 1)[0], np.tan(rotated.angle), rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_curve_stated_with_its_rotation_stays(seed: int) -> None:
    """Also with the slope rounded to five digits, and turned further than it need be."""
    rng = np.random.default_rng(seed)
    positions, errors = curve(rng, 0.8, 5.8e-6)
    rotated = rotate_monotone(positions, errors)
    slope = float(f"{np.tan(rotated.angle):.5g}")
    for stated in (errors + slope * positions, errors + 1.3 * slope * positions):
        np.testing.assert_allclose(rotate_as_stated(positions, stated).errors, stated, rtol=0, atol=1e-10)
    again = rotate_as_stated(positions, errors + 0.2 * slope * positions)
    assert again.rising == rotated.rising
    np.testing.assert_allclose(np.diff(again.errors), np.diff(rotated.errors), rtol=0, atol=1e-15)


def test_play_by_hand() -> None:
    axis = VerticalAxis(2.0, np.array([-10.0, 10.0]), np.zeros(2))
    commands = np.array([[0.0], [1.0], [3.0], [2.5], [1.0], [0.0], [0.5]])
    reached = axis.follow(commands, rising=True)[:, 0]
    # Rising it stays 1 behind; after the turn at 3 it stands until the command is 1 below what it reached.
    np.testing.assert_allclose(reached, [-1.0, 0.0, 2.0, 2.0, 2.0, 1.0, 1.0])
    assert axis.follow(commands[:1], rising=False)[0, 0] == 1.0


def test_positioning_error_adds_at_the_position_reached() -> None:
    axis = VerticalAxis(0.0, np.array([0.0, 10.0]), np.array([0.0, 1.0]))
    np.testing.assert_allclose(axis.follow(np.array([[5.0]]), rising=True), [[5.5]])


def test_error_matrix_and_correction() -> None:
    np.testing.assert_array_equal(
        predict_error_matrix(np.array([1.0, 2.0]), np.array([10.0, 20.0, 30.0])), [[11, 21, 31], [12, 22, 32]]
    )
    line = np.array([0.0, 1.0])
    x = cut_workpiece(line, line, rotate_monotone(line, line), line)
    np.testing.assert_array_equal(predict_corrections(x, x), [[0.0, -1.0], [-1.0, -2.0]])


def test_flatness_about_the_least_squares_plane() -> None:
    x, z = np.linspace(0, 1.4, 8), np.linspace(0, 0.5, 6)
    plane = 1e-3 + 2e-3 * x[:, None] - 3e-3 * z[None, :]
    saddle = 1e-6 * (x - 0.7)[:, None] * (z - 0.25)[None, :]
    assert estimate_flatness(x, z, plane)[0] < 1e-15
    flatness, deviations = estimate_flatness(x, z, plane + saddle)
    assert flatness == pytest.approx(np.ptp(saddle), rel=1e-9)
    np.testing.assert_allclose(deviations, saddle, atol=1e-15)


def test_reversals_are_counted_along_each_pass() -> None:
    assert count_reversals(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])) == 3


def test_bad_curves_are_refused() -> None:
    with pytest.raises(InputError, match="must ascend"):
        rotate_monotone(np.array([0.0, 2.0, 1.0]), np.zeros(3))
    with pytest.raises(InputError, match="reaches beyond"):
        cut_curve(np.array([0.0, 1.0]), np.zeros(2), np.linspace(0.5, 1.5, 10))
