"""The true machine: its tree of bodies evaluated with exact rotations, tool minus workpiece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Displacement, ErrorComponent
from rotary_error_monitor.errors import InputError


@dataclass(frozen=True)
class MachineStates:
    """What a machine is told and where it stands.

    Attributes:
        positions: (n, axes) commanded, in the order of the machine's axes, m or rad.
        directions: (n, axes) direction of travel the axis came from, +1 or -1, or between them within its play.
        warming: (n,) temperature above the reference, K.
    """

    positions: Array
    directions: Array
    warming: Array


@dataclass(frozen=True)
class FramePoses:
    """n poses of a frame: `p -> rotation p + shift`, shift (n, 3) m."""

    rotation: Rotation
    shift: Array

    def then(self, other: FramePoses) -> FramePoses:
        """The frame that stands at `other` in this frame."""
        return FramePoses(self.rotation * other.rotation, self.shift + self.rotation.apply(other.shift))

    def seen_from(self, other: FramePoses) -> FramePoses:
        """The frame as it stands in `other`; both are given in one frame."""
        back = other.rotation.inv()
        return FramePoses(back * self.rotation, back.apply(self.shift - other.shift))


class MachineFault:
    """Something about the true machine that its description does not say; a subclass overrides what it changes."""

    def over_poses(
        self, plant: MachinePlant, poses: MachineStates, corrections: Array | None, monitored: Array | None
    ) -> Array | None:
        """(n, 6) offset of the tool, where the size of the fault changes from pose to pose; None where it does not.

        The fault is among those of the plant; nothing else of it is asked then.
        """
        return None

    def describe(self, machine: MachineDescription) -> MachineDescription:
        """Parameters of the machine."""
        return machine

    def err(self, errors: Array, axis: Axis, column: int, poses: MachineStates) -> Array:
        """Error components (n, 6) of one axis, the `column`-th of the positions: shifts in m, rotations in rad."""
        return errors


@dataclass(frozen=True)
class MachinePlant:
    """A machine in the real world.

    Attributes:
        description: the machine as described, errors included.
        faults: what the description does not say.
    """

    description: MachineDescription
    faults: tuple[MachineFault, ...] = ()

    def tool_offset(
        self, poses: MachineStates, corrections: Array | None = None, monitored: Array | None = None
    ) -> Array:
        """Tool as it is minus as it should be, in the workpiece frame.

        Args:
            poses: what the axes are told.
            corrections: (n, axes) added to the positions by a compensation, m or rad; None for none.
            monitored: (n, 6) true error components exc eyc ezc eac ebc ecc of the monitored axis in its stator's
                frame, as heads there see them, in m and rad; they take the place of those of the description. Where
                one is NaN, and for None, that of the description holds.

        Returns:
            (n, 6) shift of the tool tip in m, and rotation vector of the tool in rad.

        Raises:
            InputError: shapes do not fit, or components are given but the machine monitors no axis.
        """
        self._check(poses, corrections, monitored)
        for fault in self.faults:
            whole = fault.over_poses(self, poses, corrections, monitored)
            if whole is not None:
                return whole
        should = self._chain(self.description, poses, None, None)
        moved = poses.positions if corrections is None else poses.positions + corrections
        machine = self.description
        for fault in self.faults:
            machine = fault.describe(machine)
        errors = self._errors(machine, MachineStates(moved, poses.directions, poses.warming))
        live = None
        if monitored is not None:
            live = np.where(np.isnan(monitored), 0.0, monitored)
            errors[machine.monitored or ""] = np.where(np.isnan(monitored), errors[machine.monitored or ""], 0.0)
        actual = self._chain(machine, poses, moved, errors, live)
        rotation = (actual.rotation * should.rotation.inv()).as_rotvec()
        return np.hstack([actual.shift - should.shift, rotation])

    def tool_axis(self, poses: MachineStates) -> Array:
        """(n, 3) unit vector along which the tool should point, in the workpiece frame."""
        return np.asarray(self._chain(self.description, poses, None, None).rotation.apply([0.0, 0.0, 1.0]))

    def _chain(
        self,
        machine: MachineDescription,
        poses: MachineStates,
        moved: Array | None,
        errors: dict[str, Array] | None,
        live: Array | None = None,
    ) -> FramePoses:
        """Tool in the workpiece frame; without `errors` as it should be.

        `live` displaces the rotor of the monitored axis as a rigid body in its stator, before it turns.
        """
        positions = poses.positions if moved is None else moved
        count = len(positions)
        base = FramePoses(Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))), np.zeros((count, 3)))
        placed = {"base": base}
        for body in machine.bodies:
            placement = placed[body.parent].then(_fixed(body.pose, count))
            if errors is not None:
                placement = placement.then(_fixed(body.location_error, count))
            if body.axis is not None:
                axis = machine.axis(body.axis)
                if live is not None and axis.letter == machine.monitored:
                    placement = placement.then(FramePoses(Rotation.from_rotvec(live[:, 3:]), live[:, :3]))
                placement = placement.then(_travelled(axis, positions[:, machine.letters.index(axis.letter)]))
                if errors is not None:
                    small = errors[axis.letter]
                    placement = placement.then(FramePoses(Rotation.from_rotvec(small[:, 3:]), small[:, :3]))
            placed[body.name] = placement
        return placed[machine.tool].seen_from(placed[machine.workpiece])

    def _errors(self, machine: MachineDescription, poses: MachineStates) -> dict[str, Array]:
        """Error components (n, 6) of each axis by its letter."""
        errors = {}
        for column, axis in enumerate(machine.axes):
            q, direction = poses.positions[:, column], poses.directions[:, column]
            rows = [machine.errors.get(f"E{letter}{axis.letter}", ErrorComponent()) for letter in DIRECTIONS]
            components = np.column_stack([_component(row, axis, q, direction) for row in rows])
            own = DIRECTIONS.index(axis.letter)
            components[:, own] += axis.expansion * poses.warming * q - axis.reversal / 2 * direction
            for fault in self.faults:
                components = fault.err(components, axis, column, poses)
            errors[axis.letter] = components
        return errors

    def _check(self, poses: MachineStates, corrections: Array | None, monitored: Array | None) -> None:
        count, axes = len(poses.positions), len(self.description.axes)
        shapes = {
            "positions": (poses.positions.shape, (count, axes)),
            "directions": (poses.directions.shape, (count, axes)),
            "warming": (poses.warming.shape, (count,)),
            "corrections": (None if corrections is None else corrections.shape, (count, axes)),
            "monitored": (None if monitored is None else monitored.shape, (count, 6)),
        }
        for name, (shape, expected) in shapes.items():
            if shape is not None and shape != expected:
                raise InputError(
                    f"{name} of shape {shape} do not fit {count} poses of machine {self.description.name} "
                    f"with the axes {', '.join(self.description.letters)}; expected shape {expected}"
                )
        if monitored is not None and self.description.monitored is None:
            raise InputError(f"machine {self.description.name} monitors no axis, but its components are given")


def make_poses(
    machine: MachineDescription,
    positions: Array,
    directions: Array | None = None,
    temperature: Array | float | None = None,
) -> MachineStates:
    """Poses from positions (n, axes), directions (n, axes; default +1) and temperature (default: the reference)."""
    count = len(positions)
    warm = machine.reference_temperature if temperature is None else temperature
    return MachineStates(
        np.asarray(positions, dtype=np.float64),
        np.ones_like(positions) if directions is None else directions,
        np.broadcast_to(np.asarray(warm, dtype=np.float64) - machine.reference_temperature, (count,)),
    )


def _fixed(displacement: Displacement, count: int) -> FramePoses:
    rotation = Rotation.from_rotvec(np.tile(displacement.rotation, (count, 1)))
    return FramePoses(rotation, np.tile(displacement.shift, (count, 1)))


def _travelled(axis: Axis, q: Array) -> FramePoses:
    path = np.outer(q, axis.direction)
    still = np.zeros_like(path)
    if axis.kind == "rotary":
        return FramePoses(Rotation.from_rotvec(path), still)
    return FramePoses(Rotation.from_rotvec(still), path)


def over_travel(axis: Axis, q: Array) -> Array:
    """Positions of an axis scaled to its travel: -1 at the low end, 1 at the high one."""
    low, high = axis.travel
    return (2 * q - low - high) / (high - low)


def _component(component: ErrorComponent, axis: Axis, q: Array, direction: Array) -> Array:
    """(n,) one error component at the positions `q` (n,), reached in `direction` (n,)."""
    u = over_travel(axis, q)
    total = np.polynomial.Polynomial(component.poly or (0.0,))(u)
    for wave in component.harmonic:
        total = total + np.hypot(wave.cos, wave.sin) * np.cos(wave.order * q - np.arctan2(wave.sin, wave.cos))
    if component.table is not None:
        rows: Sequence[float] = component.table.positions
        forward = np.interp(q, rows, component.table.forward)
        backward = np.interp(q, rows, component.table.backward)
        total = total + 0.5 * ((1.0 + direction) * forward + (1.0 - direction) * backward)
    return np.asarray(total, dtype=np.float64)
