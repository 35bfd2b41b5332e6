"""The true machine against 4x4 matrices written out here, and against recordings made by another program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates, make_poses

Array = NDArray[np.float64]


def matrix(shift: Array | tuple[float, ...], rotation: Array | tuple[float, ...]) -> Array:
    """4x4 matrix by the exponential of the rotation vector's cross product."""
    x, y, z = rotation
    result = np.eye(4)
    result[:3, :3] = expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    result[:3, 3] = shift
    return result


def component(machine: MachineDescription, name: str, q: float, direction: float) -> float:
    row, axis = machine.errors.get(name), machine.axis(name[2])
    if row is None:
        return 0.0
    u = (q - sum(axis.travel) / 2) / ((axis.travel[1] - axis.travel[0]) / 2)
    total = sum(c * u**i for i, c in enumerate(row.poly))
    total += sum(w.cos * np.cos(w.order * q) + w.sin * np.sin(w.order * q) for w in row.harmonic)
    if row.table is not None:
        side = row.table.forward if direction > 0 else row.table.backward
        total += float(np.interp(q, row.table.positions, side))
    return float(total)


def written_out(machine: MachineDescription, positions: Array, directions: Array, warming: float, ideal: bool) -> Array:
    """Tool in the workpiece frame for one pose: Pan et al. 2013, Equation 9, body by body."""
    frames = {"base": np.eye(4)}
    for body in machine.bodies:
        frame = frames[body.parent] @ matrix(body.pose.shift, body.pose.rotation)
        if not ideal:
            frame = frame @ matrix(body.location_error.shift, body.location_error.rotation)
        if body.axis:
            axis, column = machine.axis(body.axis), machine.letters.index(body.axis)
            q, direction = positions[column], directions[column]
            path = q * np.array(axis.direction)
            frame = frame @ (matrix(path, (0, 0, 0)) if axis.kind == "linear" else matrix((0, 0, 0), path))
            if not ideal:
                errors = np.array([component(machine, f"E{d}{axis.letter}", q, direction) for d in "XYZABC"])
                errors["XYZABC".index(axis.letter)] += axis.expansion * warming * q - axis.reversal / 2 * direction
                frame = frame @ matrix(errors[:3], errors[3:])
        frames[body.name] = frame
    return np.asarray(np.linalg.inv(frames[machine.workpiece]) @ frames[machine.tool])


def random_poses(machine: MachineDescription, count: int) -> MachineStates:
    draw = np.random.default_rng(5)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    positions = draw.uniform(low, high, (count, len(low)))
    return make_poses(machine, positions, draw.choice([-1.0, 1.0], positions.shape), draw.uniform(18, 24, count))


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt"])
def test_tool_offset_is_that_of_the_matrices(name: str) -> None:
    machine = load_machine(name).with_axis("X", expansion=1.1e-5, reversal=4e-6)
    poses = random_poses(machine, 50)
    offset = MachinePlant(machine).tool_offset(poses)
    for i in range(50):
        pose = poses.positions[i], poses.directions[i], float(poses.warming[i])
        actual, should = (written_out(machine, *pose, ideal=ideal) for ideal in (False, True))
        np.testing.assert_allclose(offset[i, :3], actual[:3, 3] - should[:3, 3], rtol=0, atol=1e-13)
        turned = expm(cross(offset[i, 3:])) @ should[:3, :3]
        np.testing.assert_allclose(turned, actual[:3, :3], rtol=0, atol=1e-13)


def cross(vector: Array) -> Array:
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def test_corrections_and_monitored_components_move_the_true_tool() -> None:
    machine = load_machine("pan2013")
    poses = random_poses(machine, 20)
    plant = MachinePlant(
        replace(
            machine,
            errors={},
            bodies=tuple(replace(body, location_error=type(body.location_error)()) for body in machine.bodies),
            axes=tuple(replace(axis, reversal=0.0, expansion=0.0) for axis in machine.axes),
        )
    )
    np.testing.assert_allclose(plant.tool_offset(poses), 0, atol=1e-14)
    corrections = np.tile([1e-5, -2e-5, 3e-5, 0.0, 0.0], (20, 1))
    moved = plant.tool_offset(poses, corrections)
    np.testing.assert_allclose(moved, np.tile([1e-5, -2e-5, 3e-5, 0, 0, 0], (20, 1)), rtol=0, atol=1e-14)
    angular = np.zeros((20, 6))
    angular[:, 5] = 1e-4  # an angular positioning error of C is C turned further
    turned = np.zeros((20, 5))
    turned[:, machine.letters.index("C")] = 1e-4
    np.testing.assert_allclose(
        plant.tool_offset(poses, monitored=angular), plant.tool_offset(poses, turned), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt"])
def test_live_components_act_in_the_stator_as_the_machine_model_takes_them(name: str) -> None:
    """Two programs with one meaning: the rotor is displaced in its stator; axial motion, not seen, is as described."""
    machine = load_machine(name)
    poses = random_poses(machine, 50)
    live = np.random.default_rng(3).uniform(-1, 1, (50, 6)) * [1e-5, 1e-5, 0, 5e-5, 5e-5, 3e-5]
    live[:, 2] = np.nan
    predicted = predict_tool_offset(
        arrange_machine(machine),
        poses.positions,
        direction=poses.directions,
        temperature=poses.warming + machine.reference_temperature,
        monitored=live,
    )
    found = MachinePlant(machine).tool_offset(poses, monitored=live)
    # axial motion as described acts before or after the tilt: a product of two errors
    np.testing.assert_allclose(found, predicted, rtol=0, atol=5e-11)
    assert np.abs(found - MachinePlant(machine).tool_offset(poses)).max() > 1e-6


def test_wrong_shapes_are_refused_with_what_is_expected() -> None:
    machine = load_machine("pan2013")
    plant, poses = MachinePlant(machine), random_poses(machine, 3)
    with pytest.raises(InputError, match=r"corrections of shape \(3, 4\) do not fit 3 poses.*expected shape \(3, 5\)"):
        plant.tool_offset(poses, np.zeros((3, 4)))
    with pytest.raises(InputError, match=r"monitored of shape \(2, 6\)"):
        plant.tool_offset(poses, monitored=np.zeros((2, 6)))
    with pytest.raises(InputError, match="monitors no axis"):
        MachinePlant(replace(machine, monitored=None)).tool_offset(poses, monitored=np.zeros((3, 6)))
