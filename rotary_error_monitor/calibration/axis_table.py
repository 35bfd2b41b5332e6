"""How the measured axes of a machine lie beside each other, in the form of Pan et al. 2013, Table 2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rotary_error_monitor.calibration.axis_location import Origin, carries
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.location_names import AxisLine, nominal_lines
from rotary_error_monitor.metrology import axis_relations as relations
from rotary_error_monitor.metrology.axis_fits import LineFit
from rotary_error_monitor.metrology.axis_relations import Relation

SQUARE = 1e-6
"""Cosine below which nominal directions are square, sine below which they run alike, distance in m that is none."""

LINEAR_LENGTH, ROTARY_LENGTH = 0.5, 0.3
"""Lengths, m, over which the paper tells angles between linear axes, and of rotary ones."""


@dataclass(frozen=True)
class AxisRelation:
    """One row of the table.

    Attributes:
        item: squareness, perpendicularity, parallelism, coplanarity, concentricity or distance.
        axes: such as `X-Y`, `C-XY plane`, `spindle-A`.
        relation: what was found; rad where `length` is given, else m.
        length: over which an angle is told in mm, m; None for a distance.
        right: whether the angle is one to a right angle.
    """

    item: str
    axes: str
    relation: Relation
    length: float | None = None
    right: bool = False


def relate_axes(
    machine: MachineDescription, lines: Mapping[str, LineFit], origin: Origin | None
) -> tuple[AxisRelation, ...]:
    """Each relation that the nominal machine has between two of the axes whose lines are given.

    Args:
        machine: as the file has it; only its nominal geometry counts.
        lines: by letter, and `spindle`, in the machine's directions.
        origin: what ties their places to the machine's coordinates; None without a rotary axis or spindle.
    """
    known = [line for line in nominal_lines(machine) if line.name in lines]
    lines = {each.name: _as_nominal(lines[each.name], each) for each in known}
    linear, rotary = [line for line in known if line.linear], [line for line in known if not line.linear]
    found = [*_between_linear(linear, lines)]
    for own in rotary:
        found += [*_to_linear(own, linear, lines)]
    for second, first in combinations(rotary, 2):
        found += [*_between_rotary(machine, first, second, lines, origin)]
    return tuple(found)


def _as_nominal(line: LineFit, nominal: AxisLine) -> LineFit:
    """The line of a rotary axis running as the nominal one, whichever way its targets were taken."""
    return line.reversed() if not nominal.linear and line.direction @ nominal.direction < 0 else line


def _between_linear(linear: list[AxisLine], lines: Mapping[str, LineFit]) -> Iterator[AxisRelation]:
    for first, second in combinations(sorted(linear, key=lambda line: line.name), 2):
        if _is_square(first, second):
            square = relations.squareness(lines[first.name], lines[second.name])
            yield AxisRelation("squareness", f"{first.name}-{second.name}", square, LINEAR_LENGTH, True)


def _to_linear(own: AxisLine, linear: list[AxisLine], lines: Mapping[str, LineFit]) -> Iterator[AxisRelation]:
    """A rotary axis or the spindle to the plane of two linear axes, and to the one that it runs along."""
    across = [line for line in sorted(linear, key=lambda line: line.name) if _is_square(own, line)]
    for first, second in combinations(across, 2):
        if _is_square(first, second):
            lean = relations.perpendicularity(lines[own.name], lines[first.name], lines[second.name])
            plane = f"{own.name}-{first.name}{second.name} plane"
            yield AxisRelation("perpendicularity", plane, lean, ROTARY_LENGTH, True)
    for other in linear:
        if own.is_along(other.direction):
            lean = relations.parallelism(lines[own.name], lines[other.name])
            yield AxisRelation("parallelism", f"{own.name}-{other.name}", lean, ROTARY_LENGTH)


def _between_rotary(
    machine: MachineDescription,
    first: AxisLine,
    second: AxisLine,
    lines: Mapping[str, LineFit],
    origin: Origin | None,
) -> Iterator[AxisRelation]:
    """Two rotary axes, or one and the spindle; how far apart they are where one carries the other."""
    names, own, other = f"{first.name}-{second.name}", lines[first.name], lines[second.name]
    joined = carries(machine, second.name, first.name) or carries(machine, first.name, second.name)
    if _is_square(first, second):
        yield AxisRelation("squareness", names, relations.squareness(own, other), ROTARY_LENGTH, True)
        if joined:
            apart = float((first.point - second.point) @ np.cross(first.direction, second.direction))
            item = "coplanarity" if abs(apart) < SQUARE else "distance"
            yield AxisRelation(item, names, relations.coplanarity(own, other, apart))
    elif first.is_along(second.direction):
        yield AxisRelation("parallelism", names, relations.parallelism(own, other), ROTARY_LENGTH)
        if joined and origin is not None:
            at = origin.seen + first.point - origin.place
            away = float(np.linalg.norm(np.cross(first.point - second.point, second.direction)))
            if away < SQUARE:
                yield AxisRelation("concentricity", names, relations.concentricity(own, other, at))
            else:
                yield AxisRelation("distance", names, relations.distance_alike(own, other, at, away))


def _is_square(first: AxisLine, second: AxisLine) -> bool:
    return bool(abs(first.direction @ second.direction) < SQUARE)
