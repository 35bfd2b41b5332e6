"""A machine arranged for evaluation, and where its bodies stand: T = Tp ΔTp Ts ΔTs (Pan et al. 2013, Equation 9).

Within T the location error ΔTp acts before the motion Ts and the error motion ΔTs after it, so that ΔTs is told in the
frame of the moved body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import Body, Displacement, MachineDescription
from rotary_error_monitor.machine.components import ErrorComponents, arrange_components
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.machine.transforms import (
    Array,
    compose,
    cross,
    inverse,
    rotate,
    rotation_by,
)


@dataclass(frozen=True)
class Fixtures:
    """What stands still between the axes: the product of Tp (and ΔTp) of the bodies from one axis to the next.

    Attributes:
        rotation, shift: (3, 3, m, 1) and (3, m, 1) before each of the m axes, from the axis before it in its branch.
        tool_rotation, tool_shift: (3, 3, 1) and (3, 1) from the last axis of the tool's branch to the tool.
        workpiece_rotation, workpiece_shift: likewise for the workpiece.
    """

    rotation: Array
    shift: Array
    tool_rotation: Array
    tool_shift: Array
    workpiece_rotation: Array
    workpiece_shift: Array


@dataclass(frozen=True)
class SmallFixtures:
    """First order of the location errors ΔTp: (6, m, 1) before each axis, (6, 1) at tool and workpiece.

    Each is a shift and a rotation vector in the frame in which the axis moves (in which tool or workpiece stands).
    """

    axes: Array
    tool: Array
    workpiece: Array


@dataclass(frozen=True)
class MachineModel:
    """A machine arranged for evaluation at many poses at once; made once by `arrange_machine`.

    Attributes:
        letters: axes in the order of the columns of positions.
        tool_axes, workpiece_axes: their numbers along the two branches, from the base.
        rotary: numbers of the rotary axes.
        direction: (3, m, 1) unit vector of each axis; `linear_direction` is zero for rotary axes.
        turn, turn_twice: (3, 3, r, 1) cross-product matrix of each rotary axis and its square.
        monitored: number of the monitored axis.
        ideal, actual: fixtures without and with location errors; `small` these errors in first order.
        components: error components of the axes.
        uncertainty: standard uncertainty of the description's parameters by name.
    """

    letters: tuple[str, ...]
    tool_axes: tuple[int, ...]
    workpiece_axes: tuple[int, ...]
    rotary: NDArray[np.intp]
    direction: Array
    linear_direction: Array
    turn: Array
    turn_twice: Array
    monitored: int | None
    ideal: Fixtures
    actual: Fixtures
    small: SmallFixtures
    components: ErrorComponents
    uncertainty: dict[str, float]


@dataclass(frozen=True)
class Frames:
    """Where one branch stands in the base at n poses.

    Attributes:
        rotation, shift: (3, 3, k + 1, n) and (3, k + 1, n): before the first and after each of the branch's k axes.
        end_rotation, end_shift: (3, 3, n) and (3, n) of tool or workpiece.
    """

    rotation: Array
    shift: Array
    end_rotation: Array
    end_shift: Array


def arrange_machine(machine: MachineDescription) -> MachineModel:
    """The model of a machine as described."""
    numbers = {letter: number for number, letter in enumerate(machine.letters)}
    tool, workpiece = branches(machine)
    direction = np.array([axis.direction for axis in machine.axes]).T[:, :, None]
    rotary = np.array([i for i, axis in enumerate(machine.axes) if axis.kind == "rotary"], dtype=np.intp)
    turn = _cross_matrix(direction[:, rotary])
    linear_direction = direction.copy()
    linear_direction[:, rotary] = 0.0
    return MachineModel(
        letters=machine.letters,
        tool_axes=tuple(numbers[body.axis] for body in tool if body.axis),
        workpiece_axes=tuple(numbers[body.axis] for body in workpiece if body.axis),
        rotary=rotary,
        direction=direction,
        linear_direction=linear_direction,
        turn=turn,
        turn_twice=compose(turn, turn),
        monitored=numbers[machine.monitored] if machine.monitored else None,
        ideal=_fixtures(tool, workpiece, numbers, with_errors=False),
        actual=_fixtures(tool, workpiece, numbers, with_errors=True),
        small=_small_fixtures(tool, workpiece, numbers),
        components=arrange_components(machine),
        uncertainty=dict(machine.uncertainty),
    )


def turns(model: MachineModel, positions: Array) -> Array:
    """(3, 3, r, n) rotation Ts of each rotary axis at positions (m, n)."""
    angle = positions[model.rotary]
    half = np.sin(0.5 * angle)
    rotation: Array = np.sin(angle) * model.turn + (2.0 * half * half) * model.turn_twice
    for i in range(3):
        rotation[i, i] += 1.0
    return rotation


def motions(model: MachineModel, positions: Array, errors: Array | None) -> tuple[Array, Array]:
    """(3, 3, m, n) and (3, m, n): each axis's own Ts ΔTs at positions (m, n), ΔTs from errors (6, m, n) if given."""
    turned = turns(model, positions)
    shift = model.linear_direction * positions
    if errors is None:
        rotation = np.zeros((3, 3, *positions.shape))
        for i in range(3):
            rotation[i, i] = 1.0
        rotation[:, :, model.rotary] = turned
        return rotation, shift
    rotation, error_shift = rotation_by(errors[3:]), errors[:3].copy()
    if len(model.rotary):
        rotation[:, :, model.rotary] = compose(turned, rotation[:, :, model.rotary])
        error_shift[:, model.rotary] = rotate(turned, error_shift[:, model.rotary])
    return rotation, shift + error_shift


def frames(model: MachineModel, positions: Array, errors: Array | None) -> tuple[Frames, Frames]:
    """Where the branches of tool and workpiece stand at positions (m, n).

    With `errors` (6, m, n) the machine as it is, location errors included; without, the ideal machine.
    """
    fixtures = model.ideal if errors is None else model.actual
    rotation, shift = motions(model, positions, errors)
    shift = fixtures.shift + rotate(fixtures.rotation, shift)
    rotation = compose(fixtures.rotation, rotation)
    tool = _follow(model.tool_axes, rotation, shift, fixtures.tool_rotation, fixtures.tool_shift)
    workpiece = _follow(model.workpiece_axes, rotation, shift, fixtures.workpiece_rotation, fixtures.workpiece_shift)
    return tool, workpiece


def tool_in_workpiece(tool: Frames, workpiece: Frames) -> tuple[Array, Array]:
    """(3, 3, n) and (3, n) of H = T_workpiece^-1 T_tool: the tool as the workpiece sees it."""
    back = inverse(workpiece.end_rotation)
    return compose(back, tool.end_rotation), rotate(back, tool.end_shift - workpiece.end_shift)


def axis_columns(model: MachineModel, positions: Array) -> tuple[Array, Array, Array]:
    """What a small step of each axis does to the tool as the ideal workpiece sees it.

    Returns:
        (3, m, n) shift of the tool tip (m per m or rad), (3, m, n) rotation (rad per rad), and (3, n) the tool axis.
    """
    tool, workpiece = frames(model, positions, None)
    back = inverse(workpiece.end_rotation)
    shift, rotation = np.zeros((3, *positions.shape)), np.zeros((3, *positions.shape))
    rotary = set(model.rotary.tolist())
    for sign, branch, axes in ((1.0, tool, model.tool_axes), (-1.0, workpiece, model.workpiece_axes)):
        for step, axis in enumerate(axes, start=1):
            direction = rotate(branch.rotation[:, :, step], sign * model.direction[:, axis])
            if axis in rotary:
                rotation[:, axis] = rotate(back, direction)
                direction = cross(direction, tool.end_shift - branch.shift[:, step])
            shift[:, axis] = rotate(back, direction)
    return shift, rotation, rotate(back, tool.end_rotation[:, 2])


def _follow(axes: tuple[int, ...], rotation: Array, shift: Array, end_rotation: Array, end_shift: Array) -> Frames:
    count = shift.shape[-1]
    turned = np.empty((3, 3, len(axes) + 1, count))
    moved = np.empty((3, len(axes) + 1, count))
    turned[:, :, 0], moved[:, 0] = np.eye(3)[:, :, None], 0.0
    for step, axis in enumerate(axes):
        before = turned[:, :, step]
        moved[:, step + 1] = moved[:, step] + rotate(before, shift[:, axis])
        turned[:, :, step + 1] = compose(before, rotation[:, :, axis])
    last = turned[:, :, -1]
    return Frames(turned, moved, compose(last, end_rotation), moved[:, -1] + rotate(last, end_shift))


def _fixtures(
    tool: tuple[Body, ...], workpiece: tuple[Body, ...], numbers: dict[str, int], *, with_errors: bool
) -> Fixtures:
    rotation, shift = np.tile(np.eye(3)[:, :, None, None], (1, 1, len(numbers), 1)), np.zeros((3, len(numbers), 1))
    ends = []
    for branch in (tool, workpiece):
        turned, moved = np.eye(3)[:, :, None], np.zeros((3, 1))
        for body in branch:
            for step in (body.pose, body.location_error) if with_errors else (body.pose,):
                moved = moved + rotate(turned, _column(step.shift))
                turned = compose(turned, rotation_by(_column(step.rotation)))
            if body.axis:
                axis = numbers[body.axis]
                rotation[:, :, axis], shift[:, axis] = turned, moved
                turned, moved = np.eye(3)[:, :, None], np.zeros((3, 1))
        ends.append((turned, moved))
    return Fixtures(rotation, shift, *ends[0], *ends[1])


def _small_fixtures(tool: tuple[Body, ...], workpiece: tuple[Body, ...], numbers: dict[str, int]) -> SmallFixtures:
    axes = np.zeros((6, len(numbers), 1))
    ends = []
    for branch in (tool, workpiece):
        small = np.zeros((6, 1))
        for body in branch:
            small = _seen_from(body.pose, small)
            small[:3] += _column(body.location_error.shift)
            small[3:] += _column(body.location_error.rotation)
            if body.axis:
                axes[:, numbers[body.axis]] = small
                small = np.zeros((6, 1))
        ends.append(small)
    return SmallFixtures(axes, *ends)


def _seen_from(pose: Displacement, small: Array) -> Array:
    """A small displacement (6, 1) of a frame, told in a frame that stands at `pose` in it."""
    back = inverse(rotation_by(_column(pose.rotation)))
    shift = small[:3] + cross(small[3:], _column(pose.shift))
    return np.concatenate([rotate(back, shift), rotate(back, small[3:])])


def _column(vector: tuple[float, float, float]) -> Array:
    return np.array(vector)[:, None]


def _cross_matrix(vector: Array) -> Array:
    """(3, 3, ..., n) matrices of which the product with w is the cross product of `vector` (3, ..., n) and w."""
    matrix = np.zeros((3, *vector.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[i, j] = -vector[k]
        matrix[j, i] = vector[k]
    return matrix
