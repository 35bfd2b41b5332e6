"""The corrections of a five-axis program pass the bridge's limits without lag."""

import math

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics
from rotary_error_monitor.linuxcnc_controller.protocol import LinkSettings
from rotary_error_monitor.linuxcnc_controller.shaping import ShapedCourse
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine

TABLE = RotaryTableKinematics((0.0, 0.0, 0.0), (0.020, 0.010))
PERIOD_NS = NANOSECONDS // 100
LINEAR, ROTARY = slice(0, 3), slice(3, 5)
LIMITS = LinkSettings().course_limits((False, False, False, True, True))


def program_corrections(count=1000):
    """(count, 5) corrections, 100 a second: the table turns 10 rad in 10 s and tilts, the tool goes round on it."""
    u = np.linspace(0, 1, count)
    turn = 2 * math.pi * u
    axes = np.column_stack([
        0.06 * np.cos(turn), 0.06 * np.sin(turn), 0.04 + 0.01 * np.sin(2 * turn), 0.4 + 0.2 * np.sin(turn), 10.0 * u,
    ])  # fmt: skip
    joints = np.array([TABLE.to_joints(row) for row in axes])
    machine = load_machine("xyzac_trt")
    directions = np.sign(np.gradient(joints, axis=0))
    directions[directions == 0] = 1
    return solve_axis_corrections(
        arrange_machine(machine), joints, direction=directions, temperature=np.full(count, 22.0)
    ).corrections


def follow(corrections, look_ns):
    """What is still to go, (n, 5), and the positions, (n, 5), when the next correction comes."""
    course = ShapedCourse(LIMITS, corrections[0])
    to_go, now_ns = [], 0
    course.advance(0)
    for index, target in enumerate(corrections):
        course.aim(target)
        while now_ns + look_ns <= (index + 1) * PERIOD_NS:
            now_ns += look_ns
            course.advance(now_ns)
        to_go.append(course.to_go)
    return np.array(to_go)


@pytest.mark.parametrize("rate", [100, 125, 250, 1000])
def test_each_correction_of_a_program_is_in_place_before_the_next_comes(rate):
    """But for the jumps where an axis reverses and its backlash with it, which take some looks more."""
    corrections = program_corrections()
    steps = np.abs(np.diff(corrections, axis=0))
    assert np.percentile(steps[:, LINEAR], 99) > 5e-8, "a program that asks for something"
    behind = np.abs(follow(corrections, NANOSECONDS // rate))
    in_time = behind[:, LINEAR].max(axis=1) < 1e-8
    in_time &= behind[:, ROTARY].max(axis=1) < 1e-7
    jumps = (steps[:, LINEAR].max(axis=1) > 1e-6) | (steps[:, ROTARY].max(axis=1) > 1e-5)
    assert np.count_nonzero(~in_time) <= 5 * np.count_nonzero(jumps)
    assert in_time.mean() > 0.98
