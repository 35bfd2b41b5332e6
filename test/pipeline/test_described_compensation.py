"""Compensation of a machine without monitored axis: the shipped grinder, corrected by its description alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from pushed_inputs import push_error_motion, push_joint_state

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.limits import CorrectionOutcome
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.metrology.guideway_compensation import count_reversals
from rotary_error_monitor.pipeline.compensation import CompensationSettings, Compensator, InputsUsed
from rotary_error_monitor.pipeline.corrections import CompensationOutput, OffsetReport
from rotary_error_monitor.signals.admission import LATE

GRINDER = load_machine("grinder_zhou2023")
START = 1_763_700_000_000_000_000
PERIOD = 10_000_000
FEED = 0.25
Y = GRINDER.letters.index("Y")


def straight(name: str, q: np.ndarray) -> np.ndarray:
    """Error component of the file, read by hand."""
    component, (low, high) = GRINDER.errors[name], GRINDER.axis(name[2]).travel
    table = component.table
    assert table is not None
    return np.interp(q, table.positions, table.forward) + component.poly[1] * (2 * q - low - high) / (high - low)


def pass_over(z: float, seconds: float = 5.0) -> list[tuple[int, dict[str, float]]]:
    """Joint states of one pass along X at 0.25 m/s."""
    steps = np.arange(round(seconds / (PERIOD * 1e-9)))
    return [(START + int(i) * PERIOD, {"X": -1.35 + FEED * i * PERIOD * 1e-9, "Z": z, "Y": 0.1}) for i in steps]


def run(compensator: Compensator, states: Sequence[tuple[int, Mapping[str, float]]]) -> list[CompensationOutput]:
    velocities = {"X": FEED, "Z": 0.0, "Y": 0.0}
    return [push_joint_state(compensator, stamp, positions, velocities) for stamp, positions in states]


def test_x_and_z_in_and_a_correction_of_y_out_that_never_reverses() -> None:
    states = pass_over(-0.4)
    found = [correction for each in run(Compensator(GRINDER), states) for correction in each.corrections]
    assert [correction.stamp_ns for correction in found] == [stamp for stamp, _ in states[1:]]
    values = np.array([correction.values for correction in found])
    x = np.array([positions["X"] for _, positions in states[1:]])
    y_scale = GRINDER.errors["EYY"].poly[1] * (2 * 0.1 / 0.55 - 1)
    expected = -(straight("EYX", x) + straight("EYZ", np.array(-0.4)) + y_scale)
    followed = np.array([correction.outcome == CorrectionOutcome.FOLLOWED for correction in found])
    assert followed[5:].all(), "after the start, which the rate limit slows"
    np.testing.assert_allclose(values[5:, Y], expected[5:], atol=1e-10)
    assert np.abs(np.delete(values, Y, axis=1)).max() < 1e-11, "X and Z are left alone"
    # rounding of the file's tables leaves steps of less than a picometre at the levelled places
    assert count_reversals(np.round(values[5:, [Y]], 11)) == 0
    reports = [correction.report for correction in found[5:] if correction.report is not None]
    assert len(reports) > 80
    assert max(abs(report.remaining[1]) for report in reports) < 1e-10
    assert max(abs(report.offset[1]) for report in reports) > 5e-6
    assert all(np.isnan(report.covariance).all() for report in reports), "the file states no uncertainty"


def reports_of(compensator: Compensator) -> list[OffsetReport]:
    found = [correction for each in run(compensator, pass_over(-0.4)) for correction in each.corrections]
    return [correction.report for correction in found if correction.report is not None]


def test_an_offset_is_as_uncertain_as_the_description_that_it_rests_on() -> None:
    """In closed form: the slopes of three components over the travel, and the values of two tables."""
    size = 3e-7
    compensator = Compensator(replace(GRINDER, uncertainty={"errors.linear": size}))
    found = [correction for each in run(compensator, pass_over(-0.4)) for correction in each.corrections]
    told = [(correction.stamp_ns, correction.report) for correction in found if correction.report is not None]
    assert len(told) > 80
    seconds = {}
    for stamp, report in told:
        x = -1.35 + FEED * (stamp - START) * 1e-9
        slopes = [(2 * x + 1.4) / 1.4, (2 * -0.4 + 0.8) / 0.8, 2 * 0.1 / 0.55 - 1]
        expected = size * math.sqrt(sum(slope**2 for slope in slopes) + 2)
        first = seconds.setdefault(stamp // 1_000_000_000, expected)  # it is found once a second
        assert math.sqrt(report.covariance[1, 1]) == pytest.approx(first, rel=1e-4)
        assert np.delete(np.diag(report.covariance), 1).max() < 1e-20
    assert compensator.deviation == pytest.approx(first, rel=1e-4)


def test_a_description_that_is_too_uncertain_holds() -> None:
    machine = replace(GRINDER, uncertainty={"location.linear": 2e-5})
    compensator = Compensator(machine)
    assert reports_of(compensator) == []
    assert "the tool's position is uncertain by" in compensator.hold


def test_offsets_stand_at_the_joint_states_own_times() -> None:
    states = pass_over(-0.4, 1.0)
    (first, *others) = run(Compensator(GRINDER), states)
    assert first.offsets == ()
    blocks = [block for each in others for block in each.offsets]
    assert [int(block.times_ns[0]) for block in blocks] == [stamp for stamp, _ in states[1:]]
    assert {float(block.column("joint_age")[0]) for block in blocks} == {0.0}


def test_it_holds_until_the_direction_of_travel_is_known() -> None:
    compensator = Compensator(GRINDER)
    states = pass_over(-0.4, 0.05)
    run(compensator, states[:1])
    assert "direction of travel" in compensator.hold
    assert compensator.held == 1
    run(compensator, states[1:2])
    assert compensator.hold == ""


def test_a_replay_repeats_what_was_used_live() -> None:
    """Live, two joint states were lost on their way and the temperature changed; the bag holds all of them."""
    states = pass_over(-0.4, 2.0)
    live = Compensator(GRINDER)
    found = run(live, states[:40])
    live.push_temperature(22.0)
    found += run(live, [*states[40:60], *states[62:]])
    used = {
        int(block.times_ns[0]): InputsUsed(
            int(block.times_ns[0]), float(block.column("directions")[0]), float(block.column("temperature")[0])
        )
        for each in found
        for block in each.offsets
    }
    again = run(Compensator(GRINDER, decisions=used), states)
    for one, other in zip(
        (each for each in found if each.offsets), (each for each in again if each.offsets), strict=True
    ):
        np.testing.assert_array_equal(one.offsets[0].rows, other.offsets[0].rows)
        np.testing.assert_array_equal(
            [correction.values for correction in one.corrections],
            [correction.values for correction in other.corrections],
        )
        assert one.offsets[0].stamp_ns == other.offsets[0].stamp_ns


def test_a_bag_that_begins_with_the_first_offset_repeats_it() -> None:
    """A recorder that came later than the compensation has missed the joint state before."""
    states = pass_over(-0.4, 0.2)
    live = [each.offsets[0] for each in run(Compensator(GRINDER), states)[1:]]
    columns = [(float(block.column("directions")[0]), float(block.column("temperature")[0])) for block in live]
    used = {stamp: InputsUsed(stamp, *column) for (stamp, _), column in zip(states[1:], columns, strict=True)}
    again = [each.offsets[0] for each in run(Compensator(GRINDER, decisions=used), states[1:])]
    np.testing.assert_array_equal([block.rows for block in live], [block.rows for block in again])


def test_limits_hold_as_for_any_machine() -> None:
    compensator = Compensator(GRINDER, CompensationSettings(linear_limits=(1e-6, 2e-6, 1.0)))
    found = [correction for each in run(compensator, pass_over(-0.4)) for correction in each.corrections]
    assert compensator.state.latched
    assert "axis Y" in compensator.state.reason
    assert all(abs(correction.values[Y]) <= 2e-6 for correction in found)


def test_old_or_incomplete_joint_states_are_refused() -> None:
    compensator = Compensator(GRINDER)
    states = pass_over(-0.4, 0.1)
    run(compensator, states)
    assert run(compensator, states[3:5]) == [CompensationOutput(), CompensationOutput()]
    assert compensator.joints.stream.admission.refused[LATE] == 2
    with pytest.raises(InputError, match="lacks axis Z"):
        push_joint_state(compensator, START + PERIOD * 99, {"X": 0.0, "Y": 0.0}, {})


def test_error_motion_belongs_to_no_axis_of_it() -> None:
    with pytest.raises(InputError, match="machine grinder_zhou2023 has no monitored axis"):
        push_error_motion(Compensator(GRINDER), ErrorMotion.unknown(1))
