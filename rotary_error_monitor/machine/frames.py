"""Where the bodies of a machine and the rotor of a stage stand, each in the frame of what carries it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.machine import MachineDescription

STAGE, ROTOR = "stage", "rotor"


@dataclass(frozen=True)
class Frame:
    """A frame that stands in another.

    Attributes:
        name, parent: of the frame and of the one that carries it.
        shift: (3,) its origin, m, in the frame of the parent.
        orientation: (4,) unit quaternion x, y, z, w that turns the parent's axes to its own.
    """

    name: str
    parent: str
    shift: NDArray[np.float64]
    orientation: NDArray[np.float64]


def body_frames(machine: MachineDescription, positions: Mapping[str, float]) -> list[Frame]:
    """Each body of the ideal machine (Tp Ts of Pan et al. 2013, Equation 9), a parent before its children.

    Args:
        machine: its bodies and axes.
        positions: m or rad by axis; a body whose axis has none, and what it carries, is left out.
    """
    axes, placed, frames = {axis.letter: axis for axis in machine.axes}, {"base"}, []
    for body in machine.bodies:
        axis = None if body.axis is None else axes[body.axis]
        if body.parent not in placed or (axis is not None and axis.letter not in positions):
            continue
        placed.add(body.name)
        standing, shift = Rotation.from_rotvec(body.pose.rotation), np.array(body.pose.shift)
        if axis is not None:
            motion = positions[axis.letter] * np.array(axis.direction)
            if axis.kind == "linear":
                shift = shift + standing.apply(motion)
            else:
                standing = standing * Rotation.from_rotvec(motion)
        frames.append(Frame(body.name, body.parent, shift, standing.as_quat()))
    return frames


def stage_frame(machine: MachineDescription, ring_height: float, ring_azimuth: float) -> Frame | None:
    """The stage in the stator of the monitored axis; None where no axis is monitored.

    Args:
        machine: its bodies and axes.
        ring_height: height of the monitored body's origin above the ring, m.
        ring_azimuth: angle from the machine's x to the stage's x about the axis, rad.
    """
    for body in machine.bodies:
        if body.axis is not None and body.axis == machine.monitored:
            standing = Rotation.from_rotvec(body.pose.rotation)
            shift = np.array(body.pose.shift) - standing.apply([0.0, 0.0, ring_height])
            return Frame(STAGE, body.parent, shift, (standing * Rotation.from_rotvec([0, 0, ring_azimuth])).as_quat())
    return None


def rotor_frame(theta: float, components: NDArray[np.float64]) -> Frame:
    """The rotor in the stage at an angle (rad), displaced by its error motion (6,), m and rad."""
    turned = Rotation.from_rotvec(components[3:]) * Rotation.from_rotvec([0.0, 0.0, theta])
    return Frame(ROTOR, STAGE, components[:3], turned.as_quat())
