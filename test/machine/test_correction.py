"""Corrections applied to the exact model leave nothing where the axes span the error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.correction import remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

Array = NDArray[np.float64]
MACHINES = ("pan2013", "xyzac_trt")


def poses(machine: MachineDescription, count: int) -> tuple[Array, dict[str, Array]]:
    rng = np.random.default_rng(11)
    travel = np.array([axis.travel for axis in machine.axes])
    positions = rng.uniform(travel[:, 0], travel[:, 1], (count, len(travel)))
    live = rng.normal(size=(count, 6)) * [2e-6, 2e-6, 2e-6, 2e-5, 2e-5, 2e-5]
    return positions, {
        "direction": rng.choice([-1.0, 1.0], positions.shape),
        "temperature": rng.uniform(15.0, 30.0, count),
        "monitored": live,
    }


def turned_tool_axis(machine: MachineDescription, positions: Array, offset: Array) -> Array:
    """(n,) angle by which an offset turns the tool axis as the ideal machine has it."""
    axis = stand(arrange_machine(machine), np.ascontiguousarray(positions.T), None).tool_in_workpiece()[:, 2].T
    return np.linalg.norm(np.cross(offset[:, 3:], axis), axis=1)


@pytest.mark.parametrize("name", MACHINES)
def test_nothing_is_left_where_the_axes_span_the_error(name: str) -> None:
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, conditions = poses(machine, 1000)
    before = predict_tool_offset(model, q, **conditions)
    solved = solve_axis_corrections(model, q, **conditions)
    left = remaining_offset(model, q, solved.corrections, **conditions)

    assert solved.converged.all()
    assert solved.position_spanned.all()
    np.testing.assert_array_equal(solved.offset, before)
    assert np.abs(left[:, :3]).max() <= 1e-9
    spanned = solved.direction_spanned
    np.testing.assert_array_equal(spanned, np.abs(np.sin(q[:, machine.letters.index("A")])) > 0.02)
    assert turned_tool_axis(machine, q, left)[spanned].max() <= 1e-9
    assert np.abs(before[:, :3]).max() > 1e-5
    assert turned_tool_axis(machine, q, before).max() > 1e-5


@pytest.mark.parametrize("name", MACHINES)
def test_a_singular_pose_is_flagged_and_turned_no_further_than_it_helps(name: str) -> None:
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, conditions = poses(machine, 200)
    q[:, machine.letters.index("A")] = np.linspace(-1e-3, 1e-3, 200)
    before = predict_tool_offset(model, q, **conditions)
    solved = solve_axis_corrections(model, q, **conditions)
    left = remaining_offset(model, q, solved.corrections, **conditions)
    assert not solved.direction_spanned.any()
    assert solved.converged.all()
    assert np.abs(left[:, :3]).max() <= 1e-9
    np.testing.assert_array_equal(solved.corrections[:, machine.letters.index("C")], 0.0)
    assert np.all(turned_tool_axis(machine, q, left) <= turned_tool_axis(machine, q, before) + 1e-9)


def test_an_ideal_machine_needs_no_correction() -> None:
    machine = load_machine("xyzac_trt")
    ideal = replace(
        machine,
        errors={},
        axes=tuple(replace(axis, reversal=0.0, expansion=0.0) for axis in machine.axes),
        bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies),
    )
    q, _ = poses(machine, 50)
    solved = solve_axis_corrections(arrange_machine(ideal), q)
    np.testing.assert_allclose(solved.corrections, 0.0, atol=1e-14)


def test_a_positioning_error_is_taken_back_by_its_axis() -> None:
    machine = load_machine("pan2013")
    bare = replace(
        machine,
        errors={},
        axes=tuple(replace(axis, reversal=0.0) for axis in machine.axes),
        bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies),
    )
    scaled = bare.with_error("EXX", poly=[0.0, 3e-5])
    q, _ = poses(machine, 50)
    solved = solve_axis_corrections(arrange_machine(scaled), q)
    slope = 3e-5 / 3.0
    np.testing.assert_allclose(solved.corrections[:, 0], -slope * q[:, 0] / (1.0 + slope), atol=1e-13)
    np.testing.assert_allclose(solved.corrections[:, 1:], 0.0, atol=1e-13)


def test_linear_axes_alone_correct_position_and_leave_the_direction() -> None:
    machine = load_machine("xyzac_trt")
    grinder = replace(
        machine,
        axes=machine.axes[:3],
        bodies=tuple(body for body in machine.bodies if body.name in ("saddle", "carriage", "ram", "tool")),
        errors={name: error for name, error in machine.errors.items() if name[2] in "XYZ"},
        workpiece="base",
        monitored=None,
    )
    model = arrange_machine(grinder)
    q = poses(grinder, 50)[0]
    solved = solve_axis_corrections(model, q)
    left = remaining_offset(model, q, solved.corrections)
    assert solved.position_spanned.all()
    assert not solved.direction_spanned.any()
    assert np.abs(left[:, :3]).max() <= 1e-9
    assert np.abs(left[:, 3:]).max() > 1e-6


def test_two_linear_axes_correct_what_they_reach() -> None:
    machine = load_machine("xyzac_trt")
    lathe = replace(
        machine,
        axes=(machine.axis("X"), machine.axis("Z")),
        bodies=(
            replace(machine.body("carriage"), parent="base"),
            machine.body("ram"),
            machine.body("tool"),
        ),
        errors={name: error for name, error in machine.errors.items() if name[2] in "XZ"},
        workpiece="base",
        monitored=None,
    )
    model = arrange_machine(lathe)
    q = poses(lathe, 50)[0]
    solved = solve_axis_corrections(model, q)
    left = remaining_offset(model, q, solved.corrections)
    assert solved.converged.all()
    assert not solved.position_spanned.any()
    assert np.abs(left[:, [0, 2]]).max() <= 1e-9
    assert np.abs(left[:, 1]).max() > 1e-7


def test_a_search_that_does_not_end_is_flagged() -> None:
    machine = load_machine("xyzac_trt")
    wild = machine.with_error("EXX", poly=[0.0, 0.5])  # twice its own travel: no step brings it nearer
    solved = solve_axis_corrections(arrange_machine(wild), np.full((1, 5), 0.2))
    assert not solved.converged.any()


@given(start=st.integers(0, 199), count=st.integers(1, 200), name=st.sampled_from(MACHINES))
@settings(max_examples=30, deadline=None)
def test_corrections_do_not_depend_on_the_batch(start: int, count: int, name: str) -> None:
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, conditions = poses(machine, 200)
    q[::7, machine.letters.index("A")] *= 0.01
    whole = solve_axis_corrections(model, q, **conditions)
    part = slice(start, start + count)
    some = {key: value[part] for key, value in conditions.items()}
    np.testing.assert_array_equal(solve_axis_corrections(model, q[part], **some).corrections, whole.corrections[part])
    np.testing.assert_array_equal(
        remaining_offset(model, q[part], whole.corrections[part], **some),
        remaining_offset(model, q, whole.corrections, **conditions)[part],
    )


def test_wrong_input_is_named() -> None:
    model = arrange_machine(load_machine("xyzac_trt"))
    with pytest.raises(InputError, match="least_reach 0; expected a number between 0 and 1"):
        solve_axis_corrections(model, np.zeros((1, 5)), least_reach=0)
    with pytest.raises(InputError, match="3 corrections for 2 positions"):
        remaining_offset(model, np.zeros((2, 5)), np.zeros((3, 5)))
