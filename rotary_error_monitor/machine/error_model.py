"""Where the tool is against where it should be, as the workpiece sees it.

An offset is a row of six: x, y, z of the tool tip (m) and the rotation vector a, b, c (rad) of R_actual R_ideal^T, both
in the frame of the workpiece, from H = T_workpiece^-1 T_tool of the machine as it is against that of the ideal machine.
(Pan et al. 2013, Equations 13-15, take the difference in the base: the same where the workpiece stands on the base.)

The live error components of the monitored axis come in the frame of its stator, as the read heads there see them; they
replace the description's components of that axis, which are told in the moved frame (see `kinematics`). A component
that is NaN, not observable, is taken from the description.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.kernel import PoseRows, chosen_kernel
from rotary_error_monitor.machine.kinematics import MachineModel, stand, turns
from rotary_error_monitor.machine.transforms import chain, compose, cross, inverse, rotate, rotation_vector


class CheckedPoses(NamedTuple):
    """Checked input, poses last: positions and direction (m, n), temperature (n,), monitored (6, n)."""

    positions: Array
    direction: Array | None
    temperature: Array | None
    monitored: Array | None


def predict_tool_offset(
    model: MachineModel,
    positions: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    monitored: ArrayLike | None = None,
    exact: bool = True,
    ideal: Array | None = None,
) -> Array:
    """(n, 6) offset of the machine as it is against the ideal machine, m and rad.

    Each row depends on its own pose alone, bit for bit, however many poses are evaluated together.

    Args:
        model: the machine.
        positions: (n, axes) commanded, m or rad, columns as `model.letters`.
        direction: (n, axes) sign of the travel by which each position was reached; 0 or no array: unknown.
        temperature: (n,) or one number, °C; none: the reference temperature.
        monitored: (n, 6) live error components of the monitored axis in its stator's frame: along, then about x, y, z.
        exact: product of exact transforms; else the sum of the errors' first-order effects.
        ideal: (3, 4, n) tool in workpiece of the ideal machine at these positions, where it is known from before.

    Raises:
        InputError: a shape does not fit the machine, or a number is not finite.
    """
    rows = arrange_rows(model, positions, direction, temperature, monitored)
    if exact and (kernel := chosen_kernel()) is not None:
        known = None if ideal is None else np.ascontiguousarray(ideal, dtype=np.float64)
        if (found := kernel.offsets(model, rows, ideal=known)) is not None:
            return found
    poses = check_rows(rows)
    errors = actual_errors(model, poses)
    if not exact:
        return first_order_offset(model, poses.positions, errors)
    if ideal is None:
        ideal = stand(model, poses.positions, None).tool_in_workpiece()
    return offset_between(stand(model, poses.positions, errors).tool_in_workpiece(), ideal)


def monitored_jacobian(model: MachineModel, positions: ArrayLike) -> Array:
    """(n, 6, 6) derivative of the offset (rows) by the monitored axis's components (columns), in first order.

    Raises:
        InputError: no axis of the machine is monitored, or positions do not fit it.
    """
    axis = _monitored_axis(model)
    q = check_poses(model, positions).positions
    ideal = stand(model, q, None)
    on_tool = axis in model.tool_axes
    branch, axes = (ideal.tool, model.tool_axes) if on_tool else (ideal.workpiece, model.workpiece_axes)
    stator = chain(branch.steps[axes.index(axis)], model.ideal.axes[:, :, axis])
    back = inverse(ideal.workpiece.end)
    lever = ideal.tool.end[:, 3] - stator[:, 3]
    jacobian = np.zeros((6, 6, q.shape[1]))
    for i in range(3):
        jacobian[:3, i] = jacobian[3:, 3 + i] = rotate(back, stator[:, i])
        jacobian[:3, 3 + i] = rotate(back, cross(stator[:, i], lever))
    return np.ascontiguousarray(np.moveaxis(jacobian if on_tool else -jacobian, -1, 0))


def described_components(
    model: MachineModel,
    positions: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
) -> Array:
    """(n, 6) components of the monitored axis as the description has them, in its stator's frame like live ones.

    Raises:
        InputError: no axis of the machine is monitored, or a shape does not fit it.
    """
    poses = check_poses(model, positions, direction, temperature)
    axis = _monitored_axis(model)
    errors = model.components.at(poses.positions, poses.direction, poses.temperature)
    turn = turns(model, poses.positions)[:, :, model.rotary.tolist().index(axis), None]
    turned = rotate(turn, _shift_and_rotation(errors[:, axis]))
    return np.ascontiguousarray(np.moveaxis(turned, -1, 0).swapaxes(1, 2).reshape(-1, 6))


def stated_deviations(model: MachineModel) -> Array:
    """(6,) standard uncertainty of the described components, as stated (`errors.linear`, `errors.angular`), or zero."""
    stated = [model.uncertainty.get("errors.linear", 0.0)] * 3 + [model.uncertainty.get("errors.angular", 0.0)] * 3
    return np.array(stated)


def propagate_covariance(
    model: MachineModel, positions: ArrayLike, covariance: ArrayLike, described: ArrayLike | None = None
) -> Array:
    """(n, 6, 6) covariance of the offset from that (n, 6, 6) of the monitored axis's components.

    A component whose variance is NaN is not observable and comes from the description: it counts with the standard
    uncertainty `described` (6,), by default that which the description states, uncorrelated.

    Raises:
        InputError: shapes do not fit, or no axis of the machine is monitored.
    """
    jacobian = np.moveaxis(monitored_jacobian(model, positions), 0, -1)
    given = np.moveaxis(np.asarray(covariance, dtype=np.float64), 0, -1)
    if given.shape != jacobian.shape:
        raise InputError(f"covariance of shape {given.shape[::-1]}; expected ({jacobian.shape[-1]}, 6, 6)")
    stated = stated_deviations(model) if described is None else np.asarray(described, dtype=np.float64)
    known = np.where(np.isnan(given), np.diag(np.square(stated))[:, :, None], given)
    half = _product(jacobian, known)
    return np.ascontiguousarray(np.moveaxis(_product(half, np.swapaxes(jacobian, 0, 1)), -1, 0))


def check_poses(
    model: MachineModel,
    positions: ArrayLike,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
) -> CheckedPoses:
    """The input as arrays with poses last.

    Raises:
        InputError: a shape does not fit the machine, or a number is not finite.
    """
    return check_rows(arrange_rows(model, positions, direction, temperature))


def arrange_rows(
    model: MachineModel,
    positions: ArrayLike,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    monitored: ArrayLike | None = None,
) -> PoseRows:
    """The input as arrays with poses first, each in one piece; whether numbers are finite is not looked at.

    Raises:
        InputError: a shape does not fit the machine.
    """
    q = np.ascontiguousarray(positions, dtype=np.float64)
    axes = len(model.letters)
    if q.ndim != 2 or q.shape[1] != axes:
        raise InputError(f"positions of shape {q.shape}; expected (n, {axes}): {', '.join(model.letters)} in m or rad")
    count = len(q)
    if monitored is not None:
        _monitored_axis(model)
    return PoseRows(
        q,
        None if direction is None else _rows("direction", direction, (count, axes)),
        None if temperature is None else _rows("temperature", temperature, (count,)),
        None if monitored is None else _rows("monitored", monitored, (count, 6)),
    )


def check_rows(rows: PoseRows) -> CheckedPoses:
    """The same with poses last.

    Raises:
        InputError: a number is not finite (NaN only in `monitored`).
    """
    return CheckedPoses(
        _columns("positions", rows.positions),
        None if rows.direction is None else _columns("direction", rows.direction),
        None if rows.temperature is None else _columns("temperature", rows.temperature),
        None if rows.monitored is None else _columns("monitored", rows.monitored, nan=True),
    )


def actual_errors(model: MachineModel, poses: CheckedPoses) -> Array:
    """(6, m, n) error components of all axes in the frames of the moved bodies, the monitored ones live."""
    errors = model.components.at(poses.positions, poses.direction, poses.temperature)
    if poses.monitored is not None:
        axis = _monitored_axis(model)
        turn = turns(model, poses.positions)[:, :, model.rotary.tolist().index(axis), None]
        described = rotate(turn, _shift_and_rotation(errors[:, axis]))
        live = _shift_and_rotation(poses.monitored)
        live = rotate(inverse(turn), np.where(np.isnan(live), described, live))
        errors[:3, axis], errors[3:, axis] = live[:, 0], live[:, 1]
    return errors


def offset_between(actual: Array, ideal: Array) -> Array:
    """(n, 6) offset of one tool in its workpiece (3, 4, n) against another."""
    turned = rotation_vector(compose(actual[:, :3], inverse(ideal)))
    return np.ascontiguousarray(np.concatenate([actual[:, 3] - ideal[:, 3], turned]).T)


def first_order_offset(model: MachineModel, positions: Array, errors: Array) -> Array:
    """(n, 6) offset in first order: each error moves the tool as a rigid body about where it acts (m, rad)."""
    ideal = stand(model, positions, None)
    tip = ideal.tool.end[:, 3]
    shift, rotation = np.zeros((3, positions.shape[1])), np.zeros((3, positions.shape[1]))
    for sign, branch, axes, end in (
        (1.0, ideal.tool, model.tool_axes, model.small.tool),
        (-1.0, ideal.workpiece, model.workpiece_axes, model.small.workpiece),
    ):
        parts = [(branch.end, end)]
        for before, after, axis in zip(branch.steps, branch.steps[1:], axes, strict=False):
            parts.append((chain(before, model.ideal.axes[:, :, axis]), model.small.axes[:, axis]))
            parts.append((after, errors[:, axis]))
        for frame, small in parts:
            moved = rotate(frame[:, :, None], sign * _shift_and_rotation(small))
            rotation += moved[:, 1]
            shift += moved[:, 0] + cross(moved[:, 1], tip - frame[:, 3])
    back = inverse(ideal.workpiece.end)
    return np.ascontiguousarray(np.concatenate([rotate(back, shift), rotate(back, rotation)]).T)


def _shift_and_rotation(small: Array) -> Array:
    """(3, 2, n) view of (6, n) error components: their shift and their rotation vector side by side."""
    return small.reshape(2, 3, -1).swapaxes(0, 1)


def _monitored_axis(model: MachineModel) -> int:
    if model.monitored is None:
        raise InputError("live error components for a machine without monitored axis; mark one rotary axis `monitored`")
    return model.monitored


def _rows(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if np.ndim(values) == 0 and len(shape) == 1:
        array = np.full(shape, values, dtype=np.float64)
    if array.shape != shape:
        raise InputError(f"{name} of shape {array.shape}; expected {shape}")
    return array


def _columns(name: str, rows: Array, *, nan: bool = False) -> Array:
    wrong = np.isinf(rows) if nan else ~np.isfinite(rows)
    if wrong.any():
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise InputError(f"{name} at {place} is {rows[place]}; expected finite numbers")
    # Columns in one piece: numpy may take another way through strided memory, with other last bits of sin and cos.
    return np.ascontiguousarray(rows.T)


def _product(a: Array, b: Array) -> Array:
    """(6, 6, n) product of matrices, summed in one order for any n."""
    product: Array = a[:, 0, None] * b[None, 0]
    for k in range(1, a.shape[1]):
        product = product + a[:, k, None] * b[None, k]
    return product
