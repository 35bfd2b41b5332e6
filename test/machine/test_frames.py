"""Frames of bodies, stage and rotor, chained from the base on, against the model's own kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.frames import body_frames, rotor_frame, stage_frame
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

MACHINES = ("xyzac_trt", "grinder_zhou2023", "pan2013")


def matrix(frame):
    """(4, 4) of a frame in its parent."""
    standing = np.eye(4)
    standing[:3, :3], standing[:3, 3] = Rotation.from_quat(frame.orientation).as_matrix(), frame.shift
    return standing


def in_base(frames):
    """(4, 4) of each frame in the base; a parent must stand before its children, as tf2 wants one tree."""
    placed = {"base": np.eye(4)}
    for frame in frames:
        placed[frame.name] = placed[frame.parent] @ matrix(frame)
    return placed


def turned(machine, rng):
    """The machine with each body leaning at random on its parent."""
    bodies = [replace(b, pose=replace(b.pose, rotation=tuple(rng.normal(size=3)))) for b in machine.bodies]
    return replace(machine, bodies=tuple(bodies))


@pytest.mark.parametrize("name", MACHINES)
def test_chained_they_put_tool_and_workpiece_where_the_ideal_machine_has_them(name):
    rng = np.random.default_rng()
    for _ in range(20):
        machine = turned(load_machine(name), rng)
        position = np.array([rng.uniform(*axis.travel) for axis in machine.axes])
        placed = in_base(body_frames(machine, dict(zip(machine.letters, position, strict=True))))
        there = stand(arrange_machine(machine), position[:, None], None)
        for body, branch in ((machine.tool, there.tool), (machine.workpiece, there.workpiece)):
            np.testing.assert_allclose(placed[body][:3], branch.end[:, :, 0], atol=1e-13)


def test_stage_and_rotor_turn_as_the_monitored_body_does():
    rng = np.random.default_rng()
    for _ in range(20):
        machine = turned(load_machine("xyzac_trt"), rng)
        positions = {letter: rng.uniform(-1, 1) for letter in machine.letters}
        height, azimuth = rng.uniform(-0.1, 0.1), rng.uniform(-3, 3)
        frames = [
            *body_frames(machine, positions),
            stage_frame(machine, height, azimuth),
            rotor_frame(positions["C"], np.zeros(6)),
        ]
        placed = in_base(frames)
        mounted = np.eye(4)
        mounted[:3, :3], mounted[2, 3] = Rotation.from_euler("z", azimuth).as_matrix(), -height
        np.testing.assert_allclose(placed["rotor"], placed["table"] @ mounted, atol=1e-13)


def test_error_motion_displaces_the_rotor_in_its_stator():
    frame = rotor_frame(0.5, np.array([1e-6, -2e-6, 3e-6, 4e-6, 5e-6, 6e-6]))
    np.testing.assert_array_equal(frame.shift, [1e-6, -2e-6, 3e-6])
    np.testing.assert_allclose(matrix(frame)[:3, 2], [5e-6, -4e-6, 1.0], atol=1e-10)
    np.testing.assert_allclose(np.arctan2(*matrix(frame)[[1, 0], 0]), 0.5 + 6e-6, atol=1e-10)


def test_what_an_unknown_joint_carries_is_left_out():
    machine = load_machine("xyzac_trt")
    assert [frame.name for frame in body_frames(machine, {"A": 0.1, "Y": 0.0, "X": 0.0})] == [
        "trunnion",
        "saddle",
        "carriage",
    ]
    assert stage_frame(load_machine("grinder_zhou2023"), 0.0, 0.0) is None
