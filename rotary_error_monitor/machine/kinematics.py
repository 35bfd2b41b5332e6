"""A machine arranged for evaluation, and where its bodies stand: T = Tp ΔTp Ts ΔTs (Pan et al. 2013, Equation 9).

Within T the location error ΔTp acts before the motion Ts and the error motion ΔTs after it, so that ΔTs is told in the
frame of the moved body.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Body, Displacement
from rotary_error_monitor.machine.components import ErrorComponents, arrange_components
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.machine.transforms import chain, compose, cross, inverse, rotate, rotation_by, transform

STILL: Array = np.eye(3, 4)[:, :, None]
"""(3, 4, 1) transform that moves nothing."""


@dataclass(frozen=True)
class Fixtures:
    """What stands still between the axes: the product of Tp (and ΔTp) of the bodies from one axis to the next.

    Attributes:
        axes: (3, 4, m, 1) transform before each of the m axes, from the axis before it in its branch.
        tool, workpiece: (3, 4, 1) transform from the last axis of the branch.
    """

    axes: Array
    tool: Array
    workpiece: Array


@dataclass(frozen=True)
class SmallFixtures:
    """First order of the location errors ΔTp: (6, m, 1) before each axis, (6, 1) at tool and workpiece.

    Each is a shift and a rotation vector in the frame in which the axis moves (in which tool or workpiece stands).
    """

    axes: Array
    tool: Array
    workpiece: Array


@dataclass(frozen=True, eq=False)
class MachineModel:
    """A machine arranged for evaluation at many poses at once; made once by `arrange_machine`. Equal is the same one.

    Attributes:
        letters: axes in the order of the columns of positions.
        tool_axes, workpiece_axes: their numbers along the two branches, from the base.
        rotary: numbers of the rotary axes, rising.
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
class Branch:
    """Where the axes of one branch stand in the base at n poses.

    Attributes:
        steps: (3, 4, n) transforms before the first axis (there (3, 4, 1)) and after each.
        end: (3, 4, n) transform of tool or workpiece.
    """

    steps: tuple[Array, ...]
    end: Array


@dataclass(frozen=True)
class Stance:
    """Where the two branches of a machine stand at n poses."""

    tool: Branch
    workpiece: Branch

    def tool_in_workpiece(self) -> Array:
        """(3, 4, n) transform T_workpiece^-1 T_tool: the tool as the workpiece sees it."""
        seen = self.tool.end.copy()
        seen[:, 3] -= self.workpiece.end[:, 3]
        return compose(inverse(self.workpiece.end), seen)


def arrange_machine(machine: MachineDescription) -> MachineModel:
    """The model of a machine as described."""
    numbers = {letter: number for number, letter in enumerate(machine.letters)}
    tool, workpiece = branches(machine)
    direction = np.array([axis.direction for axis in machine.axes]).T[:, :, None]
    rotary = np.array([i for i, axis in enumerate(machine.axes) if axis.kind == "rotary"], dtype=np.intp)
    turn = _cross_matrix(direction[:, rotary])
    linear_direction = direction.copy()
    linear_direction[:, rotary] = 0.0
    ideal, actual, small = _all_fixtures(tool, workpiece, machine.letters)
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
        ideal=ideal,
        actual=actual,
        small=small,
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


def stand(model: MachineModel, positions: Array, errors: Array | None) -> Stance:
    """Where the machine stands at positions (m, n).

    With `errors` (6, m, n) the machine as it is, location errors included; without, the ideal machine.
    """
    fixtures = model.ideal if errors is None else model.actual
    moved = chain(fixtures.axes, motions(model, positions, errors))
    return Stance(
        _follow([moved[:, :, axis] for axis in model.tool_axes], fixtures.tool, positions.shape[1]),
        _follow([moved[:, :, axis] for axis in model.workpiece_axes], fixtures.workpiece, positions.shape[1]),
    )


def axis_columns(model: MachineModel, ideal: Stance) -> tuple[Array, Array]:
    """What a small step of each axis does to the tool as the workpiece sees it, where the machine stands at `ideal`.

    Returns:
        (3, m, n) shift of the tool tip (m per m or rad) and (3, m, n) rotation (rad per rad).
    """
    tip = ideal.tool.end[:, 3]
    back = inverse(ideal.workpiece.end)
    shift = np.zeros((3, len(model.letters), tip.shape[-1]))
    rotation = np.zeros_like(shift)
    for sign, branch, axes in ((1.0, ideal.tool, model.tool_axes), (-1.0, ideal.workpiece, model.workpiece_axes)):
        for step, axis in zip(branch.steps[1:], axes, strict=True):
            direction = rotate(step, sign * model.direction[:, axis])
            if axis in model.rotary:
                rotation[:, axis] = direction
                direction = cross(direction, tip - step[:, 3])
            shift[:, axis] = direction
    return rotate(back[:, :, None], shift), rotate(back[:, :, None], rotation)


def motions(model: MachineModel, positions: Array, errors: Array | None) -> Array:
    """(3, 4, m, n): each axis's own Ts ΔTs at positions (m, n), ΔTs from errors (6, m, n) if given."""
    if errors is None:
        moved = np.zeros((3, 4, *positions.shape))
        for i in range(3):
            moved[i, i] = 1.0
        moved[:, :3, model.rotary] = turns(model, positions)
    else:
        moved = transform(rotation_by(errors[3:]), errors[:3])
        moved[:, :, model.rotary] = compose(turns(model, positions), moved[:, :, model.rotary])
    moved[:, 3] += model.linear_direction * positions
    return moved


def _follow(moved: list[Array], end: Array, count: int) -> Branch:
    if not moved:
        return Branch((STILL,), np.broadcast_to(end, (3, 4, count)))
    steps = [STILL]
    for transform_ in moved:
        steps.append(transform_ if len(steps) == 1 else chain(steps[-1], transform_))
    return Branch(tuple(steps), chain(steps[-1], end))


# Kept, here and below, because a fit arranges a machine for each parameter moved: most of them move no body.
@functools.lru_cache(maxsize=256)
def _all_fixtures(
    tool: tuple[Body, ...], workpiece: tuple[Body, ...], letters: tuple[str, ...]
) -> tuple[Fixtures, Fixtures, SmallFixtures]:
    """Those without and with location errors, and these errors in first order: as one, for bodies take long to hash."""
    ideal, actual = (_fixtures(tool, workpiece, letters, with_errors=errors) for errors in (False, True))
    return ideal, actual, _small_fixtures(tool, workpiece, letters)


def _fixtures(
    tool: tuple[Body, ...], workpiece: tuple[Body, ...], letters: tuple[str, ...], *, with_errors: bool
) -> Fixtures:
    axes = np.tile(STILL[:, :, None], (1, 1, len(letters), 1))
    ends = []
    for branch in (tool, workpiece):
        still = STILL
        for body in branch:
            still = chain(still, _fixed(body.pose))
            if with_errors:
                still = chain(still, _fixed(body.location_error))
            if body.axis:
                axes[:, :, letters.index(body.axis)] = still
                still = STILL
        ends.append(still)
    return Fixtures(*(_read_only(part) for part in (axes, *ends)))


@functools.lru_cache(maxsize=256)
def _fixed(displacement: Displacement) -> Array:
    """(3, 4, 1) transform of a displacement."""
    return _read_only(transform(rotation_by(_column(displacement.rotation)), _column(displacement.shift)))


def _small_fixtures(tool: tuple[Body, ...], workpiece: tuple[Body, ...], letters: tuple[str, ...]) -> SmallFixtures:
    axes = np.zeros((6, len(letters), 1))
    ends = []
    for branch in (tool, workpiece):
        small = np.zeros((6, 1))
        for body in branch:
            small = _seen_from(body.pose, small)
            small[:3] += _column(body.location_error.shift)
            small[3:] += _column(body.location_error.rotation)
            if body.axis:
                axes[:, letters.index(body.axis)] = small
                small = np.zeros((6, 1))
        ends.append(small)
    return SmallFixtures(*(_read_only(part) for part in (axes, *ends)))


def _read_only(array: Array) -> Array:
    """A copy that nobody can change: it is shared."""
    kept = array.copy()
    kept.flags.writeable = False
    return kept


def _seen_from(pose: Displacement, small: Array) -> Array:
    """A small displacement (6, 1) of a frame, told in a frame that stands at `pose` in it."""
    back = inverse(_fixed(pose))
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
