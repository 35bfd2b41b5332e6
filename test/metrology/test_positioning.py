"""ISO 230-2 figures against published reports, by hand, and on awkward tables."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.positioning import (
    PositioningRuns,
    check_standard_test,
    estimate_deviations,
    estimate_positioning,
    find_outliers,
    find_outlying,
    remove_outliers,
)

REFERENCE = Path(__file__).parents[1] / "reference"
PRINTED_DIGIT = 1e-5
"""Of a report that does not state its own, mm."""

NAN = math.nan


def published(name: str) -> tuple[PositioningRuns, dict[str, Any]]:
    report = yaml.safe_load((REFERENCE / f"iso230_2_{name}.yaml").read_text(encoding="utf-8"))
    targets = np.array(report["targets"])
    forward, backward = (
        estimate_deviations(targets[:, None], np.array(report[key])) for key in ("forward", "backward")
    )
    return PositioningRuns(targets, forward, backward), report


@pytest.mark.parametrize("name", ["target_y", "slit_axis1", "psi_x"])
def test_published_reports_to_the_last_printed_digit(name: str) -> None:
    runs, report = published(name)
    figures = estimate_positioning(runs)
    assert figures.backward is not None
    assert figures.bidirectional is not None
    both = figures.bidirectional
    computed = {
        "mean_forward": figures.forward.mean,
        "mean_backward": figures.backward.mean,
        "mean": both.mean,
        "target_reversal_error": both.target_reversal_error,
        "spread_forward": figures.forward.spread,
        "spread_backward": figures.backward.spread,
        "repeatability_forward": figures.forward.target_repeatability,
        "repeatability_backward": figures.backward.target_repeatability,
        "target_repeatability": both.target_repeatability,
        "mean_reversal_error": both.mean_reversal_error,
        "reversal_error": both.reversal_error,
        "systematic_deviation_forward": figures.forward.systematic_deviation,
        "systematic_deviation_backward": figures.backward.systematic_deviation,
        "mean_deviation_range": both.mean_deviation_range,
        "accuracy_forward": figures.forward.accuracy,
        "accuracy_backward": figures.backward.accuracy,
        "accuracy": both.accuracy,
        "repeatability": both.repeatability,
        "systematic_deviation": both.systematic_deviation,
    }
    expected = report["printed"] | report["by_hand"]
    assert computed.keys() == expected.keys()
    # A report that prints all digits of its readings agrees to the last digit of its figures: half of it, by rounding.
    # The others round readings and figures to 1e-5 mm but compute from more digits: half a digit from the figure and,
    # at a bound of three standard deviations, 0.4 digits from five rounded readings in a mean or a standard deviation;
    # up to four times that in what holds four of them.
    weights = {"repeatability": 4, "target_repeatability": 4, "accuracy": 4}
    digit, rounded = report.get("digit", PRINTED_DIGIT), not report.get("whole_readings", False)
    for key, value in computed.items():
        weight = next((w for word, w in weights.items() if key.startswith(word)), 1)
        tolerance = digit * (0.5 + 0.4 * weight * rounded) * (1 + 1e-6)
        np.testing.assert_allclose(value, expected[key], rtol=0, atol=tolerance, err_msg=key)


def by_hand() -> PositioningRuns:
    """One cycle of the first target was not read, and the backward runs are one more than the forward ones."""
    forward = np.array([[1.0, 3.0, NAN], [4.0, 4.0, 7.0]])
    backward = np.array([[0.0, 0.0, 0.0], [2.0, 4.0, 3.0]])
    return PositioningRuns(np.array([0.0, 1.0]), forward, backward)


def test_missing_cycle_by_hand() -> None:
    figures = estimate_positioning(by_hand())
    assert figures.forward.mean.tolist() == [2.0, 5.0]
    np.testing.assert_allclose(figures.forward.spread, [math.sqrt(2), math.sqrt(3)])
    assert figures.forward.count.tolist() == [2, 3]
    assert figures.backward is not None
    np.testing.assert_allclose(figures.backward.spread, [0.0, 1.0])
    both = figures.bidirectional
    assert both is not None
    # The bidirectional mean is that of the two unidirectional means, not of all readings: (2 + 0) / 2, (5 + 3) / 2.
    assert both.mean.tolist() == [1.0, 4.0]
    assert both.target_reversal_error.tolist() == [2.0, 2.0]
    assert both.reversal_error == 2.0
    assert both.systematic_deviation == 5.0
    assert both.mean_deviation_range == 3.0
    first = 2 * math.sqrt(2) + 0 + 2
    second = 2 * math.sqrt(3) + 2 + 2
    np.testing.assert_allclose(both.target_repeatability, [max(first, 4 * math.sqrt(2)), second])
    lowest = min(2 - 2 * math.sqrt(2), 0.0)
    assert both.accuracy == pytest.approx(5 + 2 * math.sqrt(3) - lowest)


def test_repeatability_takes_the_unidirectional_one_where_it_is_larger() -> None:
    runs = PositioningRuns(
        np.array([0.0, 1.0]), np.array([[-1.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [0.0, 0.0]])
    )
    both = estimate_positioning(runs).bidirectional
    assert both is not None
    assert both.repeatability == pytest.approx(4 * math.sqrt(2))


def test_reversal_keeps_its_sign_only_in_the_mean() -> None:
    runs = PositioningRuns(np.array([0.0, 1.0]), np.array([[1.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [3.0, 3.0]]))
    both = estimate_positioning(runs).bidirectional
    assert both is not None
    assert both.reversal_error == 3.0
    assert both.mean_reversal_error == -1.0


def test_unidirectional_test_has_no_bidirectional_figures() -> None:
    runs = PositioningRuns(np.array([0.0, 1.0]), np.array([[0.0, 1.0], [0.0, 1.0]]), None)
    figures = estimate_positioning(runs)
    assert figures.backward is None
    assert figures.bidirectional is None
    assert any("one direction" in remark for remark in check_standard_test(runs))


def test_rotary_deviations_wrap() -> None:
    targets = np.deg2rad([0.0, 180.0, 360.0])
    readings = np.deg2rad([359.9999, -180.0002, 0.0003])
    deviations = np.rad2deg(estimate_deviations(targets, readings, rotary=True))
    np.testing.assert_allclose(deviations, [-0.0001, -0.0002, 0.0003], atol=1e-9)
    assert abs(estimate_deviations(targets[:1], readings[:1])[0]) > 6


@settings(max_examples=50, deadline=None)
@given(st.integers(2, 8), st.integers(2, 6), st.floats(-3, 3), st.integers(0, 2**32 - 1))
def test_figures_follow_units_and_offset(targets: int, cycles: int, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    forward, backward = rng.normal(size=(2, targets, cycles))
    grid = np.arange(targets, dtype=float)
    plain = estimate_positioning(PositioningRuns(grid, forward, backward)).bidirectional
    moved = estimate_positioning(PositioningRuns(grid, 1e-6 * (forward + offset), 1e-6 * (backward + offset)))
    assert plain is not None
    assert moved.bidirectional is not None
    for name in ("reversal_error", "repeatability", "systematic_deviation", "accuracy", "mean_deviation_range"):
        assert getattr(moved.bidirectional, name) == pytest.approx(1e-6 * getattr(plain, name), rel=1e-9, abs=1e-15)
    assert plain.accuracy >= plain.systematic_deviation >= plain.mean_deviation_range - 1e-12


def test_startup_reading_is_flagged_and_stays() -> None:
    runs, _ = published("slit_axis1")
    forward = runs.forward.copy()
    forward[1, 0] += 0.02
    disturbed = PositioningRuns(runs.targets, forward, runs.backward)
    outliers = find_outliers(disturbed)
    worst = outliers[0]
    assert (worst.target, worst.direction, worst.cycle, worst.startup) == (1, 1, 0, True)
    assert len(outliers) <= 2
    assert outliers[0].excess == pytest.approx(0.02, abs=0.002)
    assert estimate_positioning(disturbed).forward.repeatability > 0.03
    cleaned = remove_outliers(disturbed, outliers[:1])
    assert cleaned.forward[1, 0] != cleaned.forward[1, 0]
    assert estimate_positioning(cleaned).forward.repeatability == pytest.approx(0.0075, abs=1e-5)


def test_clean_tests_raise_few_false_alarms() -> None:
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(1000):
        forward, backward = 1e-6 * rng.normal(size=(2, 11, 5))
        alarms += bool(find_outliers(PositioningRuns(np.arange(11.0), forward, backward), false_alarm=0.05))
    assert alarms <= 75  # 5 % of 1000, and three standard deviations of that count


@pytest.mark.parametrize("cycles", [2, 3, 4, 5, 6, 10])
def test_many_targets_of_few_cycles_raise_few_false_alarms(cycles: int) -> None:
    """The median of three readings strays against the one that is farthest off."""
    alarms = 0
    for seed in range(400):
        readings = np.random.default_rng([seed, cycles]).normal(size=(200, cycles))
        alarms += bool(find_outlying([(1, readings)], false_alarm=0.05))
    assert alarms <= 33  # 5 % of 400, and three standard deviations of that count


def test_identical_readings_show_no_outlier_and_a_single_other_one_does() -> None:
    forward = np.zeros((3, 5))
    assert find_outliers(PositioningRuns(np.arange(3.0), forward, None)) == ()
    forward[1, 2] = 1e-6
    assert [(o.target, o.cycle) for o in find_outliers(PositioningRuns(np.arange(3.0), forward, None))] == [(1, 2)]


def test_departures_from_the_standard_are_said() -> None:
    remarks = check_standard_test(by_hand())
    assert any("2 targets; ISO 230-2 asks for at least 5" in remark for remark in remarks)
    assert any("unequal forward cycles: 2 to 3" in remark for remark in remarks)
    rotary = PositioningRuns(
        np.deg2rad(np.array([0.0, 95, 170, 290, 360])), np.zeros((5, 5)), np.zeros((5, 5)), rotary=True
    )
    assert any("at least 8" in remark for remark in check_standard_test(rotary))
    book = PositioningRuns(np.array([0.0, 0.11, 0.19, 0.31, 0.42]), np.zeros((5, 5)), np.zeros((5, 5)))
    assert check_standard_test(book) == ()


@pytest.mark.parametrize(
    ("targets", "forward", "message"),
    [
        ([0.0], [[1.0, 1.0]], "at least two"),
        ([0.0, 0.0], [[1.0, 1.0], [1.0, 1.0]], "0 m, then 0 m"),
        ([1.0, 0.5], [[1.0, 1.0], [1.0, 1.0]], "must ascend"),
        ([0.0, 1.0], [[1.0, 1.0]], "do not fit 2 targets"),
        ([0.0, 1.0], [[1.0, 1.0], [1.0, NAN]], r"target 1 m has 1 forward reading"),
    ],
)
def test_bad_tables_are_refused(targets: list[float], forward: list[list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PositioningRuns(np.array(targets), np.array(forward), None)


@pytest.mark.parametrize("resolution", [1e-6, 5e-6])
def test_a_coarse_instrument_makes_no_outliers(resolution: float) -> None:
    """Sound readings to steps of 1 to 20 standard deviations: the median distance of two may be 0."""
    flagged = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        means = rng.normal(0, 5 * resolution, 11)[:, None]
        scatter = resolution * rng.uniform(0.05, 1.0)
        both = [resolution * np.rint((means + scatter * rng.normal(size=(11, 5))) / resolution) for _ in range(2)]
        flagged.append(bool(find_outliers(PositioningRuns(np.arange(11) / 10, *both), false_alarm=1e-3)))
    assert np.mean(flagged) <= 0.05


@pytest.mark.parametrize("offset", [0.0, 3.3e-7])
def test_an_outlier_of_a_coarse_instrument_is_found(offset: float) -> None:
    """A mistake of ten steps, where the targets are whole numbers of steps or not."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        means = rng.normal(0, 5e-6, 11)[:, None]
        both = [
            1e-6 * np.rint((means + 2e-7 * rng.normal(size=(11, 5))) * 1e6) + offset * np.arange(11)[:, None]
            for _ in range(2)
        ]
        target, cycle = rng.integers(11), rng.integers(5)
        both[0][target, cycle] += 1e-5
        found = find_outliers(PositioningRuns(np.arange(11) / 10, *both), false_alarm=1e-3)
        assert [(each.target, each.cycle, each.direction) for each in found] == [(target, cycle, 1)]
        assert np.isfinite(found[0].ratio)
