"""The offset of the tool from the workpiece, and what each body's errors make of it (Pan et al. 2013, Equations 9-15).

Within T = Tp ΔTp Ts ΔTs of a body its location error ΔTp moves the tool as a rigid body about the place where the body
is fitted, and its error motion ΔTs about the place to which its axis has gone. In first order these parts add up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import WHOLE_MACHINE, MachineDescription
from rotary_error_monitor.description.machine_parts import Body, Displacement
from rotary_error_monitor.machine.error_model import (
    CheckedPoses,
    actual_errors,
    check_poses,
    offset_between,
    predict_tool_offset,
)
from rotary_error_monitor.machine.kinematics import (
    STILL,
    MachineModel,
    Stance,
    arrange_machine,
    axis_columns,
    motions,
    stand,
)
from rotary_error_monitor.machine.pose_uncertainty import MIDDLE, position_uncertainty
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.machine.transforms import chain, cross, inverse, rotate, rotation_by, transform
from rotary_error_monitor.machine.uncertainty import calibrated_shifts, measured_apart, shifts_at_a_pose


@dataclass(frozen=True)
class BodyPart:
    """What the errors of one body make of the offset, in first order.

    Attributes:
        body: the body.
        location: (n, 6) by its location error ΔTp, m and rad.
        motion: (n, 6) by the error motion ΔTs of its axis; zero for a body that no axis moves.
    """

    body: Body
    location: Array
    motion: Array

    @property
    def both(self) -> Array:
        """(n, 6) sum of the two, m and rad."""
        return self.location + self.motion


@dataclass(frozen=True)
class OffsetBudget:
    """The offset at n poses: rows x, y, z (m), a, b, c (rad) of the tool as the workpiece sees it.

    Attributes:
        exact: (n, 6) by products of exact transforms.
        first_order: (n, 6) in first order of all errors.
        parts: of each body between the tool and the workpiece, the way to the tool first; they add up to `first_order`.
        covariance: (n, 6, 6) by the standard uncertainties that the description states; None where it states none.
    """

    exact: Array
    first_order: Array
    parts: tuple[BodyPart, ...]
    covariance: Array | None

    @property
    def difference(self) -> Array:
        """(n, 6) exact less first order, m and rad."""
        return self.exact - self.first_order

    @property
    def uncertainty(self) -> Array | None:
        """(n, 6) standard uncertainty, m and rad; None where the description states none."""
        if self.covariance is None:
            return None
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def estimate_budget(
    machine: MachineDescription,
    positions: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
) -> OffsetBudget:
    """Offset, its parts and its uncertainty at poses; arguments and errors as `predict_tool_offset`."""
    model = arrange_machine(machine)
    poses = check_poses(model, positions, direction, temperature)
    errors = actual_errors(model, poses)
    ideal = stand(model, poses.positions, None)
    exact = offset_between(stand(model, poses.positions, errors).tool_in_workpiece(), ideal.tool_in_workpiece())
    tool, workpiece = branches(machine)
    parts = (
        *_parts(model, poses, errors, ideal, tool, 1.0),
        *_parts(model, poses, errors, ideal, workpiece, -1.0),
    )
    first_order = sum((part.both for part in parts), np.zeros_like(exact))
    return OffsetBudget(exact, first_order, parts, offset_covariance(machine, positions, direction, temperature))


def offset_covariance(
    machine: MachineDescription,
    positions: ArrayLike,
    direction: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
) -> Array | None:
    """(n, 6, 6) covariance of the offset by what the description states; None where it states nothing.

    Each uncertain number is shifted by its standard uncertainty, uncorrelated (JCGM 101:2008, 5.10). What a calibration
    has measured counts with the uncertainty that it left, and not with that of its kind as well. An axis stands
    where it should but for its repeatability, which is four standard deviations (ISO 230-2:2014, 3.16).
    """
    stated = [shift for shift in shifts_at_a_pose(machine) if not measured_apart(machine, shift.name)]
    shifts, effects = (*stated, *calibrated_shifts(machine)), list[Array]()
    if shifts:

        def offset(each: MachineDescription) -> Array:
            return predict_tool_offset(arrange_machine(each), positions, direction=direction, temperature=temperature)

        middle = offset(machine)
        effects += [offset(each.machine) - middle for each in shifts]
    effects += _scatter(machine, positions)
    if WHOLE_MACHINE in machine.calibrated:  # of the distance, alike in three directions
        terms = machine.pose_terms or {MIDDLE: machine.calibrated[WHOLE_MACHINE]}
        part = position_uncertainty(machine, terms, positions) / math.sqrt(3.0)
        effects += [np.outer(part, np.eye(6)[k]) for k in range(3)]
    if not effects:
        return None
    return np.asarray(sum(effect[:, :, None] * effect[:, None, :] for effect in effects))


def _scatter(machine: MachineDescription, positions: ArrayLike) -> list[Array]:
    """(n, 6) what one standard deviation of each axis's repeatability makes of the offset."""
    if not any(axis.repeatability for axis in machine.axes):
        return []
    model = arrange_machine(machine)
    shift, turn = axis_columns(model, stand(model, check_poses(model, positions).positions, None))
    both = np.concatenate([shift, turn])
    return [
        np.ascontiguousarray(both[:, number].T) * axis.repeatability / 4
        for number, axis in enumerate(machine.axes)
        if axis.repeatability
    ]


def _parts(
    model: MachineModel, poses: CheckedPoses, errors: Array, ideal: Stance, bodies: tuple[Body, ...], sign: float
) -> Iterator[BodyPart]:
    """Parts of the bodies of one branch; `sign` is -1 for that of the workpiece."""
    count = poses.positions.shape[1]
    tip, back = ideal.tool.end[:, 3], sign * inverse(ideal.workpiece.end)
    moved = motions(model, poses.positions, None)
    frame = np.repeat(STILL, count, axis=2)

    def seen(small: Array) -> Array:
        """(n, 6) of a small displacement (6, n) in `frame`: it moves the tool as a rigid body about its origin."""
        shift, rotation = rotate(frame, small[:3]), rotate(frame, small[3:])
        shift = shift + cross(rotation, tip - frame[:, 3])
        return np.ascontiguousarray(np.concatenate([rotate(back, shift), rotate(back, rotation)]).T)

    for body in bodies:
        frame = chain(frame, _transform(body.pose))
        location = seen(np.repeat(_column(body.location_error), count, axis=1))
        motion = np.zeros_like(location)
        if body.axis is not None:
            axis = model.letters.index(body.axis)
            frame = chain(frame, moved[:, :, axis])
            motion = seen(errors[:, axis])
        yield BodyPart(body, location, motion)


def _column(displacement: Displacement) -> Array:
    return np.array([*displacement.shift, *displacement.rotation])[:, None]


def _transform(displacement: Displacement) -> Array:
    column = _column(displacement)
    return transform(rotation_by(column[3:]), column[:3])
