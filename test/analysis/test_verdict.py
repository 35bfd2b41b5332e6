"""Verdicts by the decision rule of ISO 14253-1: an uncertainty is never in favour of whoever claims something."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rotary_error_monitor.analysis.motion import analyse_motion
from rotary_error_monitor.analysis.verdict import Conformity, judge
from rotary_error_monitor.description.error_motion_limits import (
    ErrorMotionLimits,
    limits_from_file,
    limits_from_words,
)
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError


@pytest.fixture(scope="module")
def segments(estimated):
    return analyse_motion(estimated(0), load_stage(), (0.0, 0.016))


def worst(segments, quantity, name):
    values = [
        signal.values[name]
        for s in segments
        for signal in s.signals
        if signal.quantity == quantity and name in signal.values
    ]
    return max(v.value + v.expanded for v in values), max(v.value - v.expanded for v in values)


@pytest.mark.parametrize(("quantity", "name"), [("radial", "synchronous"), ("tilt", "fundamental")])
def test_within_beyond_and_between(segments, quantity, name):
    above, below = worst(segments, quantity, name)
    assert below < above
    for limit, expected in (
        (1.001 * above, Conformity.WITHIN),
        (0.5 * (above + below), Conformity.OPEN),
        (0.999 * below, Conformity.BEYOND),
    ):
        outcome, (row,) = judge(segments, ErrorMotionLimits(**{f"{quantity}_{name}": limit}))
        assert (outcome, row.outcome) == (expected, expected)
        assert row.value is not None and row.where[1].startswith(quantity)


def test_the_worst_limit_decides_and_what_is_not_told_is_open(segments):
    good, bad = ErrorMotionLimits(radial_total=1e-3), ErrorMotionLimits(radial_total=1e-3, tilt_total=1e-9)
    assert judge(segments, good)[0] is Conformity.WITHIN
    assert judge(segments, bad)[0] is Conformity.BEYOND
    outcome, rows = judge(segments, replace(good, axial_total=1e-3))
    assert outcome is Conformity.OPEN and rows[1].value is None
    assert judge(segments, ErrorMotionLimits()) == (Conformity.NO_LIMITS, ())
    assert judge((), good)[0] is Conformity.OPEN
    assert [
        outcome.exit_code for outcome in (Conformity.WITHIN, Conformity.NO_LIMITS, Conformity.BEYOND, Conformity.OPEN)
    ] == [
        *(0, 0),
        *(10, 11),
    ]


def test_limits_in_words():
    found = limits_from_words(["radial_synchronous_um=2", "tilt_total_arcsec=10", "axial_fundamental_nm=50"])
    assert found.radial_synchronous == pytest.approx(2e-6)
    assert found.tilt_total == pytest.approx(10 * 4.84813681e-6)
    assert set(found.stated) == {"radial_synchronous", "tilt_total", "axial_fundamental"}


@pytest.mark.parametrize(("unit", "power"), [("um", "e-6"), ("nm", "e-9")])
def test_a_limit_is_the_number_nearest_to_what_was_written(unit, power):
    """So that results hold 2e-05 for 20 µm, not 1.9999999999999998e-05."""
    for number in range(1, 1000):
        (value,) = limits_from_words([f"radial_total_{unit}={number / 10}"]).stated.values()
        assert value == float(f"{number / 10}{power}")


@pytest.mark.parametrize(
    "word",
    [
        *("radial_synchronous=2", "radial_um=2", "radial_total_urad=2", "tilt_total_um=2", "radial_fundamental_um=1"),
        *("radial_total_um=0", "radial_total_um=-1", "radial_total_um=nan", "radial_total_um=two", "radial_total_um"),
    ],
)
def test_a_word_that_is_no_limit_is_named_with_what_is_right(word):
    with pytest.raises(InputError, match=r"--limits .*expected NAME_UNIT=NUMBER above 0, such as radial"):
        limits_from_words([word])


def test_a_limit_out_of_range_or_twice_is_refused():
    with pytest.raises(InputError, match="radial_total is stated twice"):
        limits_from_words(["radial_total_um=1", "radial_total_nm=900"])
    with pytest.raises(InputError, match=r"largest value in m, at most 10 mm"):
        limits_from_words(["radial_total_um=20000"])


def test_limits_of_a_file(tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text("error_motion_limits:\n  radial_total: 2.0e-6\n")
    assert limits_from_file(path).stated == {"radial_total": 2e-6}
    path.write_text("error_motion_limits:\n  radial_total: 2.0\n")
    with pytest.raises(InputError, match=r"limits.yaml:2: error_motion_limits.radial_total: .*at most 10 mm"):
        limits_from_file(path)
    path.write_text("stage: {}\n")
    assert limits_from_file(path, needed=False) == ErrorMotionLimits()
    with pytest.raises(InputError, match="'error_motion_limits' is a required property"):
        limits_from_file(path)
