"""What the errors that a machine file has make an instrument read, beside the error component that is measured.

An instrument beside an axis reads its angular errors too, by Abbe's lever, and its expansion. Where the file has these,
the component is what is left of the readings: the file as a whole then makes what was read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine

UNIT = 1e-6
"""Size of an error, m or rad, by which its direction is found: products of errors do not matter."""

BESIDE = 0.01
"""How far from where it is taken to be an instrument may read, for what is told of it, m."""


@dataclass(frozen=True)
class ReadingPlace:
    """Where and how warm an axis was while an instrument read.

    Attributes:
        others: positions of the other axes by letter, m or rad; those not named at zero, or the end of travel nearest.
        beside: (3,) from the tool's origin to where it read, in the frame of the tool, m.
        temperature: of the axis, °C; None: that of reference.
        whole: whether it read the tool against the workpiece, all errors in it, as a probe does; else only what
            changes with the axis.
    """

    others: Mapping[str, float] = field(default_factory=dict)
    beside: tuple[float, float, float] = (0.0, 0.0, 0.0)
    temperature: float | None = None
    whole: bool = False


def known_readings(
    machine: MachineDescription,
    letter: str,
    shares: Mapping[str, float],
    positions: Array,
    *,
    direction: float = 0.0,
    place: ReadingPlace | None = None,
) -> Array:
    """(n,) what the file makes an instrument read along an axis, without the components that it measures, m or rad.

    Args:
        machine: as the file has it.
        letter: of the axis.
        shares: of what is measured in each error component, by name: `EYX` alone, or the directions of an inclined one.
        positions: (n,) of the axis, m or rad.
        direction: in which they were reached, 0 if in both or unknown.
        place: where it read; the tool's origin, all other axes at zero, where none is given.
    """
    place = place or ReadingPlace()
    at = np.tile([place.others.get(axis.letter, axis.home) for axis in machine.axes], (len(positions), 1))
    ways, number = np.zeros_like(at), machine.letters.index(letter)
    at[:, number], ways[:, number] = positions, direction
    rest = _rest(_reading_at(machine, place.beside), letter, shares, whole=place.whole)
    off = predict_tool_offset(arrange_machine(rest), at, direction=ways, temperature=place.temperature)[:, :3]
    ideal = replace(
        _rest(rest, letter, shares, whole=False),
        errors={name: ErrorComponent(poly=(UNIT * share,)) for name, share in shares.items()},
        axes=tuple(replace(axis, expansion=0.0, reversal=0.0) for axis in machine.axes),
    )
    own = predict_tool_offset(arrange_machine(ideal), at)[:, :3] / UNIT
    return np.asarray((off * own).sum(axis=1) / (own**2).sum(axis=1), dtype=np.float64)


def largest_lever(
    machine: MachineDescription, letter: str, shares: Mapping[str, float], positions: Array, place: ReadingPlace
) -> float:
    """By how much readings would differ along the axis if the instrument read `BESIDE` from where it is taken to, m."""
    read = known_readings(machine, letter, shares, positions, place=place)
    moved = (place.beside + BESIDE * each for each in np.eye(3))
    others = [
        known_readings(machine, letter, shares, positions, place=replace(place, beside=(x, y, z))) for x, y, z in moved
    ]
    return max(float(np.ptp(other - read)) for other in others)


def _reading_at(machine: MachineDescription, beside: tuple[float, float, float]) -> MachineDescription:
    """The machine with its tool's origin where the instrument reads."""
    body = machine.body(machine.tool)
    # the pose is a place in the parent, so that what is told in the tool's own frame is turned into that
    turned = _turned(body.pose, beside)
    x, y, z = (old + each for old, each in zip(body.pose.shift, turned, strict=True))
    moved = replace(body, pose=replace(body.pose, shift=(x, y, z)))
    return replace(machine, bodies=tuple(moved if each is body else each for each in machine.bodies))


def _turned(pose: Displacement, vector: tuple[float, float, float]) -> Array:
    """(3,) a vector in the frame of a body, told in that of its parent (Rodrigues)."""
    turn, value = np.array(pose.rotation), np.array(vector)
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return value
    axis = turn / angle
    across = np.cross(axis, value)
    return np.asarray(value + np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(axis, across), dtype=np.float64)


def _rest(machine: MachineDescription, letter: str, shares: Mapping[str, float], *, whole: bool) -> MachineDescription:
    """The machine without the components measured and the play of the axis; with other axes ideal but for `whole`."""
    kept = {name: each for name, each in machine.errors.items() if name not in shares and (whole or name[2] == letter)}
    axes = tuple(
        replace(axis, reversal=0.0)
        if axis.letter == letter
        else axis
        if whole
        else replace(axis, reversal=0.0, expansion=0.0)
        for axis in machine.axes
    )
    bodies = machine.bodies if whole else tuple(replace(body, location_error=Displacement()) for body in machine.bodies)
    return replace(machine, errors=kept, axes=axes, bodies=bodies)
