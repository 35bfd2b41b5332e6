"""Whether bodies and axes of a machine make a tree that holds together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

from rotary_error_monitor.description.machine_parts import Axis, BodySection, Vector
from rotary_error_monitor.description.quantities import LARGEST_TILT
from rotary_error_monitor.description.sections import Place

BASE = "base"
"""Name of the body at the root of every tree; it is not listed."""

_STAGE_AXIS = (0.0, 0.0, 1.0)
"""Direction of a monitored axis in its stator's frame: its error motion comes as the stage sees it, whose z it is."""

FLATTEST = 0.02
"""Part of a unit cube that three linear axes span at least: with less one of them goes far for little of an offset."""


class Tree(Protocol):
    """What a section states of a tree, as `TreeSection` has it."""

    @property
    def axes(self) -> Mapping[str, Axis]:
        """By their letters."""

    @property
    def bodies(self) -> tuple[BodySection, ...]:
        """A parent before its children."""

    @property
    def tool(self) -> str:
        """Name of the body that holds the tool."""

    @property
    def workpiece(self) -> str:
        """Name of the body that holds the workpiece."""

    @property
    def spindle(self) -> str | None:
        """Name of the body whose z is the axis of the spindle."""

    @property
    def monitored(self) -> str | None:
        """Letter of the axis whose error motion is measured live."""


def wrong_tree(section: Tree) -> Iterator[tuple[Place, str]]:
    """Where a section contradicts itself, and what would be right."""
    axes, seen, moved = section.axes, {BASE: None}, dict[str, str]()
    for index, row in enumerate(section.bodies):
        place: Place = ("bodies", index)
        if row.name in seen:
            yield (*place, "name"), f"there is already a body '{row.name}'; expected a name of its own"
        if row.parent not in seen:
            yield (*place, "parent"), f"no body '{row.parent}' stands above; expected one of {', '.join(seen)}"
        if row.axis in moved:
            yield (
                (*place, "axis"),
                f"axis {row.axis} moves '{moved[row.axis]}' already; expected one body for each axis",
            )
        for letter in (*filter(None, [row.axis]), *row.squareness):
            if letter not in axes:
                yield place, f"there is no axis {letter}; the axes are {', '.join(axes)}"
        if row.squareness and (row.axis is None or row.axis in row.squareness):
            yield (*place, "squareness"), "expected angles from this body's own axis to other axes"
        elif axes.keys() >= {*row.squareness}:
            angle = max(abs(part) for part in row.whole_location_error(axes).rotation)
            if angle > LARGEST_TILT:
                yield (
                    (*place, "squareness"),
                    f"the angles and the location error add up to {angle * 1e3:.4g} mrad; expected at most 10 mrad",
                )
        seen[row.name] = None
        moved |= {row.axis: row.name} if row.axis else {}
    for letter in axes:
        if letter not in moved:
            yield ("axes", letter), f"axis {letter} moves no body; expected a body with axis: {letter}"
    for key, name in (("tool", section.tool), ("workpiece", section.workpiece)):
        if name not in seen:
            yield (key,), f"there is no body '{name}'; expected one of {', '.join(seen)}"
    if section.spindle is not None and section.spindle not in {*seen} - {BASE}:
        names = ", ".join(row.name for row in section.bodies)
        yield ("spindle",), f"there is no body '{section.spindle}'; expected one of {names}"
    for row in section.bodies:
        if row.name == section.spindle and row.axis is not None:
            yield ("spindle",), f"axis {row.axis} moves '{row.name}'; expected a body of its own, fixed on that one"
    rotary = [letter for letter, axis in axes.items() if axis.kind == "rotary"]
    if section.monitored is not None and section.monitored not in rotary:
        yield ("monitored",), f"'{section.monitored}' is no rotary axis; expected {', '.join(rotary) or 'null'}"
    elif section.monitored is not None and axes[section.monitored].direction != _STAGE_AXIS:
        yield (
            ("axes", section.monitored, "direction"),
            f"{list(axes[section.monitored].direction)} is not the z of the stage that monitors this axis, so that its"
            " error motion would be taken for another; expected [0, 0, 1], with the body turned by pose.rotation",
        )
    yield from _wrong_chain(section)


def _wrong_chain(section: Tree) -> Iterator[tuple[Place, str]]:
    """What makes a tree that holds together no machine: nothing that moves as stated between tool and workpiece."""
    rows = {row.name: row for row in section.bodies}
    if not {section.tool, section.workpiece, *(row.parent for row in section.bodies)} <= {*rows, BASE}:
        return
    if section.tool == section.workpiece:
        yield ("tool",), f"'{section.tool}' is the workpiece as well; expected the body that holds the tool"
        return
    up = {name: _above(rows, name) for name in (section.tool, section.workpiece)}
    tool, workpiece = up[section.tool], up[section.workpiece]
    chain = [row for row in tool if row not in workpiece][::-1] + [row for row in workpiece if row not in tool]
    letters = [row.axis for row in chain if row.axis in section.axes]
    if section.monitored in section.axes and section.monitored not in letters:
        yield (
            ("monitored",),
            f"axis {section.monitored} moves the tool against the workpiece nowhere: it carries neither, or both; "
            f"expected one of {', '.join(filter(None, letters)) or 'the axes between them'}",
        )
    yield from _flat_axes(section, rows, chain)


def _flat_axes(
    section: Tree, rows: Mapping[str, BodySection], chain: Sequence[BodySection]
) -> Iterator[tuple[Place, str]]:
    """Three linear axes that lie in one plane, with no rotary one between them that would turn them out of it."""
    moving = [row for row in chain if row.axis is not None and row.axis in section.axes]
    kinds = [section.axes[row.axis or ""].kind for row in moving]
    along = [row for row, kind in zip(moving, kinds, strict=True) if kind == "linear"]
    first = kinds.index("linear") if along else 0
    if len(along) != 3 or "rotary" in kinds[first : len(kinds) - kinds[::-1].index("linear")]:
        return
    (a, b, c), (d, e, f), (g, h, i) = (_direction(rows, row, section.axes) for row in along)
    if abs(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) < FLATTEST:
        letters = ", ".join(row.axis or "" for row in along)
        yield ("axes", along[-1].axis or "", "direction"), f"{letters} lie in one plane; expected axes that span space"


def _above(rows: Mapping[str, BodySection], name: str) -> list[BodySection]:
    """A body and those that carry it, up to the base."""
    found: list[BodySection] = []
    while name in rows and rows[name] not in found:
        found.append(rows[name])
        name = rows[name].parent
    return found


def _direction(rows: Mapping[str, BodySection], row: BodySection, axes: Mapping[str, Axis]) -> Vector:
    """Direction of the axis of a body in the frame of the base, with all axes at zero."""
    direction = axes[row.axis or ""].direction
    for each in _above(rows, row.name):
        direction = _turned(direction, each.pose.rotation)
    return direction


def _turned(vector: Vector, rotation: Vector) -> Vector:
    """A vector turned by a rotation vector, rad (Rodrigues' formula)."""
    angle = math.hypot(*rotation)
    if angle == 0.0:
        return vector
    x, y, z = (part / angle for part in rotation)
    u, v, w = vector
    cos, sin, along = math.cos(angle), math.sin(angle), (x * u + y * v + z * w) * (1.0 - math.cos(angle))
    return (
        u * cos + (y * w - z * v) * sin + x * along,
        v * cos + (z * u - x * w) * sin + y * along,
        w * cos + (x * v - y * u) * sin + z * along,
    )
