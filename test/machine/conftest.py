"""The machine by other means: pytransform3d's SE(3), straight from the description, body by body."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from kernels import FORMS, computing_by, is_built
from numpy.typing import NDArray
from pytransform3d.batch_rotations import matrices_from_compact_axis_angles
from pytransform3d.trajectories import concat_many_to_many
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import ErrorComponent

Array = NDArray[np.float64]


def matrices(shift: Array, rotation: Array) -> Array:
    """(n, 4, 4) from shifts and rotation vectors (n, 3)."""
    result = np.tile(np.eye(4), (len(shift), 1, 1))
    result[:, :3, :3] = matrices_from_compact_axis_angles(rotation)
    result[:, :3, 3] = shift
    return result


def component(error: ErrorComponent, position: Array, travel: tuple[float, float], direction: Array) -> Array:
    """(n,) one error component at positions and directions (n,)."""
    u = np.interp(position, travel, (-1.0, 1.0))
    value = np.polyval(error.poly[::-1], u) if error.poly else np.zeros(len(position))
    for wave in error.harmonic:
        value = value + wave.cos * np.cos(wave.order * position) + wave.sin * np.sin(wave.order * position)
    if error.table is not None:
        forward = np.interp(position, error.table.positions, error.table.forward)
        backward = np.interp(position, error.table.positions, error.table.backward)
        mean = (forward + backward) / 2
        value = value + np.select([direction > 0, direction < 0], [forward, backward], mean)
    return value


def place(
    machine: MachineDescription,
    name: str,
    poses: dict[str, tuple[Array, Array]],
    dt: Array,
    live: Array | None,
    *,
    ideal: bool,
) -> Array:
    """(n, 4, 4) of a body in the base: the product of Tp dTp Ts dTs from the base to it."""
    if name == "base":
        return np.tile(np.eye(4), (len(dt), 1, 1))
    body = machine.body(name)
    fixed = [body.pose] if ideal else [body.pose, body.location_error]
    parts = [matrices(np.tile(f.shift, (len(dt), 1)), np.tile(f.rotation, (len(dt), 1))) for f in fixed]
    if body.axis:
        axis = machine.axis(body.axis)
        position, direction = poses[axis.letter]
        linear = axis.kind == "linear"
        along = np.outer(position, axis.direction)
        motion = matrices(along * linear, along * (not linear))
        errors = np.stack(
            [
                component(machine.errors.get(f"E{d}{axis.letter}", ErrorComponent()), position, axis.travel, direction)
                for d in DIRECTIONS
            ],
            axis=1,
        )
        errors[:, slice(0, 3) if linear else slice(3, 6)] += np.outer(
            axis.expansion * dt * position - axis.reversal / 2 * direction, axis.direction
        )
        if ideal:
            parts.append(motion)
        elif axis.letter == machine.monitored and live is not None:
            parts += [matrices(live[:, :3], live[:, 3:]), motion]  # in the stator's frame: before the motion
        else:
            parts += [motion, matrices(errors[:, :3], errors[:, 3:])]
    above = place(machine, body.parent, poses, dt, live, ideal=ideal)
    for part in parts:
        above = concat_many_to_many(part, above)
    return above


@pytest.fixture
def independent_offset() -> Callable[..., Array]:
    """(n, 6) offsets at positions and directions (n, m), temperatures above reference (n,), live components (n, 6)."""

    def offset(
        machine: MachineDescription, positions: Array, directions: Array, dt: Array, live: Array | None = None
    ) -> Array:
        poses = dict(zip(machine.letters, zip(positions.T, directions.T, strict=True), strict=True))
        seen = []
        for ideal in (False, True):
            tool, workpiece = (
                place(machine, name, poses, dt, live, ideal=ideal) for name in (machine.tool, machine.workpiece)
            )
            seen.append(concat_many_to_many(tool, np.linalg.inv(workpiece)))
        turned = Rotation.from_matrix(seen[0][:, :3, :3]) * Rotation.from_matrix(seen[1][:, :3, :3]).inv()
        return np.concatenate([seen[0][:, :3, 3] - seen[1][:, :3, 3], turned.as_rotvec()], axis=1)

    return offset


@pytest.fixture(params=FORMS, autouse=True, scope="module")
def form(request: pytest.FixtureRequest) -> Iterator[None]:
    """Each test of the model by both of its forms; where it was not compiled, by numpy."""
    if request.param == "compiled" and not is_built():
        pytest.skip("the machine model was not compiled")
    with computing_by(request.param):
        yield
