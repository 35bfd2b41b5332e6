"""Ideal kinematics of the controller: from its axes (tool in workpiece coordinates) to its joints (slides) and back.

Positions are tuples in m and rad, in the order of the axis letters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from rotary_error_monitor.errors import InputError

Position = tuple[float, ...]
"""One number for each axis or joint, m or rad."""

LETTERS = "XYZABCUVW"
ROTARY = "ABC"
XYZAC = ("X", "Y", "Z", "A", "C")


class Kinematics(Protocol):
    """How the positions of axes and joints of one controller belong together."""

    def to_joints(self, axes: Sequence[float]) -> Position:
        """Positions of the joints that put the tool at `axes`."""

    def to_axes(self, joints: Sequence[float]) -> Position:
        """Position of the tool for the joints at `joints`."""


@dataclass(frozen=True)
class TrivialKinematics:
    """Every axis is a joint (LinuxCNC's trivkins)."""

    def to_joints(self, axes: Sequence[float]) -> Position:
        """Positions of the joints: those of the axes."""
        return tuple(axes)

    def to_axes(self, joints: Sequence[float]) -> Position:
        """Positions of the axes: those of the joints."""
        return tuple(joints)


@dataclass(frozen=True)
class RotaryTableKinematics:
    """Table C on a trunnion A, tool on X, Y, Z (LinuxCNC's xyzac-trt-kins), axes in the order X Y Z A C.

    `p_machine = Rx(A) Rz(C) p_work` about their centres of rotation; positive angles turn the table positively.

    Attributes:
        rotation_point: where axis C meets the origin of the workpiece, m (pins x-, y-, z-rot-point).
        offset: from there to axis A, in y and z, m (pins y-offset, z-offset).
        tool_length: length of the tool that the controller compensates, m (pin tool-offset).
    """

    rotation_point: tuple[float, float, float]
    offset: tuple[float, float]
    tool_length: float = 0.0

    def to_joints(self, axes: Sequence[float]) -> Position:
        """Positions of the joints: the workpiece turned by C about its axis, then by A about the trunnion's.

        Raises:
            InputError: there are not five positions.
        """
        x, y, z, a, c = self._five(axes)
        px, py, pz = self.rotation_point
        dy, dz = self.offset[0], self.offset[1] + self.tool_length
        cos_a, sin_a, cos_c, sin_c = math.cos(a), math.sin(a), math.cos(c), math.sin(c)
        turned_x = cos_c * (x - px) - sin_c * (y - py)
        turned_y = sin_c * (x - px) + cos_c * (y - py) - dy
        turned_z = z - pz - dz
        return (
            turned_x + px,
            cos_a * turned_y - sin_a * turned_z + dy + py,
            sin_a * turned_y + cos_a * turned_z + dz + pz,
            a,
            c,
        )

    def to_axes(self, joints: Sequence[float]) -> Position:
        """Position of the tool on the workpiece: the way back.

        Raises:
            InputError: there are not five positions.
        """
        x, y, z, a, c = self._five(joints)
        px, py, pz = self.rotation_point
        dy, dz = self.offset[0], self.offset[1] + self.tool_length
        cos_a, sin_a, cos_c, sin_c = math.cos(a), math.sin(a), math.cos(c), math.sin(c)
        machine_y, machine_z = y - py - dy, z - pz - dz
        tilted_x = x - px
        tilted_y = cos_a * machine_y + sin_a * machine_z + dy
        tilted_z = -sin_a * machine_y + cos_a * machine_z + dz
        return (
            cos_c * tilted_x + sin_c * tilted_y + px,
            -sin_c * tilted_x + cos_c * tilted_y + py,
            tilted_z + pz,
            a,
            c,
        )

    @staticmethod
    def _five(positions: Sequence[float]) -> Sequence[float]:
        if len(positions) != len(XYZAC):
            raise InputError(f"{len(positions)} positions, but a rotary table machine has {' '.join(XYZAC)}")
        return positions


def solve_offsets(kinematics: Kinematics, axes: Sequence[float], corrections: Sequence[float]) -> Position:
    """Offsets of the axes that move the joints by exactly `corrections` while the program commands `axes`.

    The controller adds external offsets to the commanded axes and only then computes the joints, so an offset acts in
    workpiece coordinates. Exact, also where a correction of a rotary joint turns the workpiece under the tool: the
    offsets are where the corrected joints put the tool, less where the program put it.
    """
    corrected = [joint + correction for joint, correction in zip(kinematics.to_joints(axes), corrections, strict=True)]
    return tuple(there - here for there, here in zip(kinematics.to_axes(corrected), axes, strict=True))
