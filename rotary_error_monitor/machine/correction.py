"""Axis corrections that put the tool where the ideal machine has it.

Sought is δq so that the machine as it is, at q + δq, puts the tool where the ideal machine at q has it: the rotary axes
turn the tool axis back as far as they can, the linear axes then bring the tool tip back. The spin about the tool axis
is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import (
    CheckedPoses,
    actual_errors,
    arrange_rows,
    check_rows,
    offset_between,
)
from rotary_error_monitor.machine.kernel import chosen_kernel
from rotary_error_monitor.machine.kinematics import MachineModel, axis_columns, stand
from rotary_error_monitor.machine.transforms import cross, dot, length

MOST_STEPS = 12
LAST_STEP = 1e-8
"""A pose is solved once its step is no longer than this, m or rad; the next would be a thousandth of it at most."""


@dataclass(frozen=True)
class SolvedCorrections:
    """Corrections to add to the commanded positions of n poses.

    Attributes:
        corrections: (n, axes) δq, m or rad.
        converged: (n,) the search ended within its steps; where it did not, corrections are not to be used.
        position_spanned: (n,) the linear axes reach every offset of the tool tip.
        direction_spanned: (n,) the rotary axes reach every direction of the tool axis; where they do not (a singular
            pose, fewer than two rotary axes), the direction is corrected only as far as they do.
        offset: (n, 6) offset without corrections, the same as by `predict_tool_offset`.
    """

    corrections: Array
    converged: NDArray[np.bool_]
    position_spanned: NDArray[np.bool_]
    direction_spanned: NDArray[np.bool_]
    offset: Array

    def at(self, chosen: NDArray[np.int64]) -> SolvedCorrections:
        """The same at some of the poses."""
        return SolvedCorrections(
            self.corrections[chosen],
            self.converged[chosen],
            self.position_spanned[chosen],
            self.direction_spanned[chosen],
            self.offset[chosen],
        )


@dataclass(frozen=True)
class _Axes:
    """Axes that null a vector by least squares: orthogonal basis and triangle (Gram-Schmidt) of their columns."""

    numbers: tuple[int, ...]
    basis: tuple[Array, ...]
    triangle: dict[tuple[int, int], Array]
    rank: NDArray[np.int64]

    def null(self, vector: Array) -> list[Array]:
        """(n,) step of each axis that takes most of `vector` (3, n) away; an axis that adds nothing stays."""
        steps: list[Array] = []
        for i in reversed(range(len(self.numbers))):
            part = -dot(self.basis[i], vector)
            for j, step in zip(range(len(self.numbers) - 1, i, -1), steps, strict=True):
                part = part - self.triangle[i, j] * step
            steps.append(part / self.triangle[i, i])
        return steps[::-1]


def solve_axis_corrections(
    model: MachineModel,
    positions: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    monitored: ArrayLike | None = None,
    least_reach: float = 0.02,
) -> SolvedCorrections:
    """Corrections of the axes at n poses; arguments and their errors as for `predict_tool_offset`.

    Newton's method with the ideal machine's Jacobian at each pose; a pose is done when its own step is small, whatever
    the others do.

    `least_reach` says how far the tool axis must turn (rad) for one rad of a rotary axis, beyond what other rotary axes
    do, for that axis to be used: it keeps an axis from turning far for little near a singular pose.

    Raises:
        InputError: `least_reach` is not between 0 and 1, a shape does not fit, or a number is not finite.
    """
    if not 0.0 < least_reach < 1.0:
        raise InputError(f"least_reach {least_reach}; expected a number between 0 and 1 such as 0.02")
    rows = arrange_rows(model, positions, direction, temperature, monitored)
    kernel = chosen_kernel()
    found = None if kernel is None else kernel.corrections(model, rows, least_reach, MOST_STEPS, LAST_STEP)
    if found is not None:
        converged, position_spanned, direction_spanned = found.flags.T
        return SolvedCorrections(found.corrections, converged, position_spanned, direction_spanned, found.offset)
    return _search(model, check_rows(rows), least_reach)


def _search(model: MachineModel, poses: CheckedPoses, least_reach: float) -> SolvedCorrections:
    """The search in numpy."""
    stance = stand(model, poses.positions, None)
    ideal = stance.tool_in_workpiece()
    shift, rotation = axis_columns(model, stance)
    turning = tuple(model.rotary.tolist())
    moving = tuple(i for i in range(len(model.letters)) if i not in turning)
    rotary = _orthogonal(turning, cross(rotation, ideal[:, 2, None]), least_reach)
    linear = _orthogonal(moving, shift, least_reach)

    def seen(positions: Array) -> Array:
        moved = poses._replace(positions=positions)
        return stand(model, positions, actual_errors(model, moved)).tool_in_workpiece()

    actual = seen(poses.positions)
    offset = offset_between(actual, ideal)
    delta = np.zeros_like(poses.positions)
    active = np.ones(delta.shape[1], dtype=bool)
    for _ in range(MOST_STEPS):
        away = actual[:, 3] - ideal[:, 3]
        step = np.zeros_like(delta)
        for axis, turn in zip(turning, rotary.null(actual[:, 2] - ideal[:, 2]), strict=True):
            step[axis] = turn
            away = away + shift[:, axis] * turn
        for axis, move in zip(moving, linear.null(away), strict=True):
            step[axis] = move
        delta = np.where(active, delta + step, delta)
        active &= (np.abs(step) > LAST_STEP).any(axis=0)
        if not active.any():
            break
        actual = seen(poses.positions + delta)
    corrections = np.ascontiguousarray(delta.T)
    return SolvedCorrections(corrections, ~active, linear.rank == 3, rotary.rank == 2, offset)


def remaining_offset(
    model: MachineModel,
    positions: ArrayLike,
    corrections: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    monitored: ArrayLike | None = None,
) -> Array:
    """(n, 6) offset of the machine as it is, corrected by `corrections` (n, axes), against the ideal machine (m, rad).

    Raises:
        InputError: a shape does not fit the machine, or a number is not finite.
    """
    rows = arrange_rows(model, positions, direction, temperature, monitored)
    added_rows = arrange_rows(model, corrections)
    if len(added_rows.positions) != len(rows.positions):
        raise InputError(
            f"{len(added_rows.positions)} corrections for {len(rows.positions)} positions; expected one for each"
        )
    if (kernel := chosen_kernel()) is not None:
        found = kernel.offsets(model, rows, added=added_rows.positions)
        if found is not None:
            return found
    poses, added = check_rows(rows), check_rows(added_rows).positions
    moved = poses._replace(positions=poses.positions + added)
    actual = stand(model, moved.positions, actual_errors(model, moved))
    return offset_between(actual.tool_in_workpiece(), stand(model, poses.positions, None).tool_in_workpiece())


def _orthogonal(numbers: tuple[int, ...], columns: Array, least: float) -> _Axes:
    """Axes with what their columns (3, axes, n) add to those before them; shorter than `least` counts as nothing."""
    basis: list[Array] = []
    triangle: dict[tuple[int, int], Array] = {}
    rank = np.zeros(columns.shape[-1], dtype=np.int64)
    for i, axis in enumerate(numbers):
        rest = columns[:, axis]
        for j in range(i):
            triangle[j, i] = dot(basis[j], rest)
            rest = rest - triangle[j, i] * basis[j]
        size = length(rest)
        used = size > least
        triangle[i, i] = np.where(used, size, 1.0)
        basis.append(np.where(used, rest / triangle[i, i], 0.0))
        rank += used
    return _Axes(numbers, tuple(basis), triangle, rank)
