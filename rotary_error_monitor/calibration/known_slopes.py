"""What the error components that a machine file has do to the line of a linear axis, as a tracker sees it.

The line through what a reflector went along has in it the slope of the axis' straightness and, by Abbe's lever, of its
angular errors, and it lies as the errors at zero of what carries the axis turn it. Where the file has these already,
squareness is what is left: the file as a whole then makes the line that was seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.metrology.axis_fits import LineFit

CROSSING = 1e-3
"""Distance, m, within which lines of one reflector cross where all their axes are at zero: far more than errors."""

BESIDE = 0.1
"""How far from the tip a reflector may stand for what is told of it, m."""

PLACES = 21
"""Places within the travel at which the points may lie that are looked at where nothing tells."""


@dataclass(frozen=True)
class KnownSlope:
    """What the file's errors do to the line of an axis.

    Attributes:
        slope: (3,) change of its direction in the base, rad.
        doubt: standard uncertainty of a component by where on the travel the points lie, rad; 0 where that is known.
        begin: position of the first point, m.
        departures: (n, 3) by how much they displace the reflector at each point, in the base, m.
        is_placed: whether the lines of other axes tell it; else the points lie about the middle of the travel.
        lever: largest change of a component for a reflector that stands `BESIDE` from the tip, rad.
    """

    slope: Array
    doubt: float
    begin: float
    departures: Array
    is_placed: bool
    lever: float


def known_slopes(
    machine: MachineDescription, lines: Mapping[str, LineFit], tracks: Mapping[str, Array], reflector: Array
) -> dict[str, KnownSlope]:
    """What the file's errors make of the lines of linear axes, by letter.

    The place of a reflector with all axes at zero is where its lines cross; where they do not, points lie about the
    middle of the travel, and what else they may lie at counts as uncertainty.

    Args:
        machine: as the file has it.
        lines: of linear axes, in the tracker's frame.
        tracks: (n, 3) points of each, in the order of its positive direction, m.
        reflector: (3,) where it stands in the frame of the tool, or of the workpiece where the axis carries that, m.
    """
    zero = _crossing(lines)
    found = {}
    for letter, line in lines.items():
        steps = (tracks[letter] - tracks[letter][0]) @ line.direction
        low, high = machine.axis(letter).travel
        spare = max(0.0, high - low - float(steps.max()))
        begin, is_placed = low + spare / 2, False
        if zero is not None:
            there = float((tracks[letter][0] - zero) @ line.direction)
            is_placed = low - CROSSING <= there <= low + spare + CROSSING
            begin = there if is_placed else begin
        slope = line_slope(machine, letter, begin + steps, reflector)
        doubt = 0.0
        if not is_placed and spare > 0:
            others = [
                line_slope(machine, letter, low + part + steps, reflector) for part in np.linspace(0, spare, PLACES)
            ]
            doubt = float(np.sqrt(np.mean(np.square(np.array(others) - slope), axis=0)).max())
        beside = [line_slope(machine, letter, begin + steps, reflector + BESIDE * unit) for unit in np.eye(3)]
        departures = known_departures(machine, letter, begin + steps, reflector)
        found[letter] = KnownSlope(
            slope, doubt, begin, departures, is_placed, float(np.abs(np.array(beside) - slope).max())
        )
    return found


def line_slope(machine: MachineDescription, letter: str, positions: Array, reflector: Array) -> Array:
    """(3,) by how much the components of the file turn the line that a reflector goes along, in the base, rad."""
    ideal, actual = _paths(machine, letter, positions, reflector)
    one, other = (np.polyfit(positions, path, 1)[0] for path in (actual, ideal))
    return np.asarray(one / np.linalg.norm(one) - other / np.linalg.norm(other), dtype=np.float64)


def known_departures(machine: MachineDescription, letter: str, positions: Array, reflector: Array) -> Array:
    """(n, 3) by how much the file's components displace a reflector at positions (n,) of an axis, in the base, m."""
    ideal, actual = _paths(machine, letter, positions, reflector)
    return actual - ideal


def _paths(machine: MachineDescription, letter: str, positions: Array, reflector: Array) -> tuple[Array, Array]:
    """(n, 3) where a reflector goes without and with error components, location errors in both, in the base, m.

    `positions` (n,) of the axis, m, reached from below; the others at zero or at the end of travel nearest to it.
    """
    model, number = arrange_machine(machine), machine.letters.index(letter)
    at = np.tile(np.array([[axis.home] for axis in machine.axes]), (1, len(positions)))
    at[number] = positions
    ways = np.zeros_like(at)
    ways[number] = 1.0
    paths = []
    for errors in (np.zeros((6, *at.shape)), model.components.at(at, ways, None)):
        stance = stand(model, at, errors)
        end = stance.workpiece.end if number in model.workpiece_axes else stance.tool.end
        paths.append((end[:, 3] + np.einsum("ijn,j->in", end[:, :3], reflector)).T)
    return paths[0], paths[1]


def _crossing(lines: Mapping[str, LineFit]) -> Array | None:
    """(3,) where all lines cross, m; None where they do not, for they are of several reflectors or poses."""
    if len(lines) < 2:
        return None
    across = [np.eye(3) - np.outer(line.direction, line.direction) for line in lines.values()]
    points = [line.point for line in lines.values()]
    place = np.linalg.solve(sum(across, np.zeros((3, 3))), sum(p @ q for p, q in zip(across, points, strict=True)))
    away = [float(np.linalg.norm(p @ (place - q))) for p, q in zip(across, points, strict=True)]
    return np.asarray(place, dtype=np.float64) if max(away) < CROSSING else None
