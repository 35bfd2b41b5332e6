"""The machine by other means: pytransform3d's SE(3), one pose at a time, straight from the description."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from pytransform3d.rotations import compact_axis_angle_from_matrix, matrix_from_compact_axis_angle
from pytransform3d.transformations import concat, invert_transform, transform_from

from rotary_error_monitor.description.machine import DIRECTIONS, ErrorComponent, MachineDescription

Array = NDArray[np.float64]


def matrix(shift: Array, rotation: Array) -> Array:
    """(4, 4) by pytransform3d, which multiplies in the opposite order of reading only in `concat`."""
    return transform_from(matrix_from_compact_axis_angle(rotation), shift)


def component(error: ErrorComponent, position: float, travel: tuple[float, float], direction: float) -> float:
    u = np.interp(position, travel, (-1.0, 1.0))
    value = float(np.polyval(error.poly[::-1], u)) if error.poly else 0.0
    for wave in error.harmonic:
        value += wave.cos * np.cos(wave.order * position) + wave.sin * np.sin(wave.order * position)
    if error.table is not None:
        forward = np.interp(position, error.table.positions, error.table.forward)
        backward = np.interp(position, error.table.positions, error.table.backward)
        value += {1.0: forward, -1.0: backward, 0.0: (forward + backward) / 2}[direction]
    return float(value)


def place(
    machine: MachineDescription,
    name: str,
    pose: dict[str, tuple[float, float]],
    dt: float,
    live: Array | None,
    *,
    ideal: bool,
) -> Array:
    """(4, 4) of a body in the base: the product of Tp dTp Ts dTs from the base to it."""
    if name == "base":
        return np.eye(4)
    body = machine.body(name)
    parts = [matrix(np.array(body.pose.shift), np.array(body.pose.rotation))]
    if not ideal:
        parts.append(matrix(np.array(body.location_error.shift), np.array(body.location_error.rotation)))
    if body.axis:
        axis = machine.axis(body.axis)
        position, direction = pose[axis.letter]
        along = np.array(axis.direction)
        linear = axis.kind == "linear"
        motion = matrix(along * position * linear, along * position * (not linear))
        errors = np.array(
            [
                component(machine.errors.get(f"E{d}{axis.letter}", ErrorComponent()), position, axis.travel, direction)
                for d in DIRECTIONS
            ]
        )
        errors[slice(0, 3) if linear else slice(3, 6)] += along * (
            axis.expansion * dt * position - axis.reversal / 2 * direction
        )
        if ideal:
            parts.append(motion)
        elif axis.letter == machine.monitored and live is not None:
            parts += [matrix(live[:3], live[3:]), motion]  # in the stator's frame: before the motion
        else:
            parts += [motion, matrix(errors[:3], errors[3:])]
    above = place(machine, body.parent, pose, dt, live, ideal=ideal)
    for part in parts:
        above = concat(part, above)
    return above


@pytest.fixture
def independent_offset() -> Callable[..., Array]:
    """(6,) offset of one pose: positions and directions (m,), temperature above reference, live components (6,)."""

    def offset(
        machine: MachineDescription, positions: Array, directions: Array, dt: float = 0.0, live: Array | None = None
    ) -> Array:
        pose = dict(zip(machine.letters, zip(positions, directions, strict=True), strict=True))
        seen = []
        for ideal in (False, True):
            tool, workpiece = (
                place(machine, name, pose, dt, live, ideal=ideal) for name in (machine.tool, machine.workpiece)
            )
            seen.append(invert_transform(workpiece) @ tool)
        turned = compact_axis_angle_from_matrix(seen[0][:3, :3] @ seen[1][:3, :3].T)
        return np.concatenate([seen[0][:3, 3] - seen[1][:3, 3], turned])

    return offset
