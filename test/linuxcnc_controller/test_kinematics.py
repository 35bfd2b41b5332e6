"""Kinematics of the controller in closed form, and offsets that move the joints by exactly what was asked."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics, TrivialKinematics, solve_offsets

TABLE = RotaryTableKinematics((0.003, -0.005, 0.007), (0.020, 0.010), 0.047)
length = st.floats(-0.25, 0.25)
poses = st.tuples(length, length, length, st.floats(-1.75, 1.75), st.floats(-6.3, 6.3))
small = st.tuples(*[st.floats(-5e-4, 5e-4)] * 5)


def test_the_table_turns_the_workpiece_as_two_rotations_about_its_axes():
    axes = np.array([0.06, -0.02, 0.04, 0.5, 2.0])
    point, offset = np.array(TABLE.rotation_point), np.array([0.0, 0.020, 0.010 + 0.047])
    about_c = Rotation.from_rotvec([0, 0, axes[4]]).apply(axes[:3] - point)
    expected = Rotation.from_rotvec([axes[3], 0, 0]).apply(about_c - offset) + offset + point
    np.testing.assert_allclose(TABLE.to_joints(axes)[:3], expected, atol=1e-16)


@given(poses)
def test_axes_to_joints_and_back_is_where_one_was(axes):
    np.testing.assert_allclose(TABLE.to_axes(TABLE.to_joints(axes)), axes, rtol=0, atol=1e-15)


@given(poses, small)
def test_offsets_move_the_joints_by_exactly_the_corrections(axes, corrections):
    offsets = solve_offsets(TABLE, axes, corrections)
    moved = np.subtract(TABLE.to_joints(np.add(axes, offsets)), TABLE.to_joints(axes))
    np.testing.assert_allclose(moved, corrections, rtol=0, atol=1e-15)


def test_an_offset_acts_in_workpiece_coordinates():
    """A 30°, C 90°: 10 µm in X move joint Y by 8.66 µm and joint Z by 5 µm, as measured on LinuxCNC."""
    axes = (0.01, 0.02, 0.03, math.radians(30), math.radians(90))
    table = RotaryTableKinematics((0, 0, 0), (0.020, 0.010))
    moved = np.subtract(table.to_joints(np.add(axes, [1e-5, 0, 0, 0, 0])), table.to_joints(axes))
    np.testing.assert_allclose(moved, [0, 8.660e-6, 5.0e-6, 0, 0], atol=1e-9)


@given(small)
def test_without_a_table_offsets_are_the_corrections(corrections):
    np.testing.assert_allclose(solve_offsets(TrivialKinematics(), (0.1,) * 5, corrections), corrections, atol=1e-16)


@pytest.mark.parametrize("way", [TABLE.to_axes, TABLE.to_joints])
def test_a_table_machine_has_five_axes(way):
    with pytest.raises(InputError, match="3 positions, but a rotary table machine has X Y Z A C"):
        way((0.0, 0.0, 0.0))
