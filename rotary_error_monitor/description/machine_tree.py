"""Whether bodies and axes of a machine make a tree that holds together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from rotary_error_monitor.description.machine_parts import Axis, BodySection
from rotary_error_monitor.description.quantities import LARGEST_TILT
from rotary_error_monitor.description.sections import Place

BASE = "base"
"""Name of the body at the root of every tree; it is not listed."""

_STAGE_AXIS = (0.0, 0.0, 1.0)
"""Direction of a monitored axis in its stator's frame: its error motion comes as the stage sees it, whose z it is."""


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
