"""What a schema cannot say of a machine description: whether its parts fit one another."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

BASE = "base"
"""Name of the body at the root of every tree; it is not listed."""

Place = list[str | int]


def contradictions(section: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Where a section that is valid by the schema contradicts itself, and what would be right."""
    yield from _wrong_ranges(section)
    axes = section.get("axes", section.get("travel", {}))
    for name, row in section.get("errors", {}).items():
        if name[2] not in axes:
            yield ["errors", name], f"there is no axis {name[2]}; the axes are {', '.join(axes)}"
        yield from _wrong_table(name, row.get("table"))
    if "bodies" in section:
        yield from _wrong_tree(section)


def _wrong_ranges(section: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    places: dict[tuple[str, ...], Any] = {("axes", x, "travel"): row["travel"] for x, row in _axes(section)}
    places |= {("travel", letter): travel for letter, travel in section.get("travel", {}).items()}
    for place, (lowest, highest) in places.items():
        if lowest >= highest:
            yield list(place), f"[{lowest}, {highest}] is no travel; expected the lowest position first"
    low, high = section.get("limits", {}).get("temperature", (0.0, 1.0))
    if low >= high:
        yield ["limits", "temperature"], f"[{low}, {high}] is no range; expected the lowest temperature first"
    for letter, row in _axes(section):
        length = math.hypot(*row["direction"])
        if abs(length - 1.0) > 1e-9:
            yield ["axes", letter, "direction"], f"{row['direction']} has length {length:.9g}; expected a unit vector"


def _axes(section: Mapping[str, Any]) -> list[tuple[str, Any]]:
    return list(section.get("axes", {}).items())


def _wrong_table(name: str, table: Mapping[str, Any] | None) -> Iterator[tuple[Place, str]]:
    if table is None:
        return
    positions = table["positions"]
    if any(after <= before for before, after in itertools.pairwise(positions)):
        yield ["errors", name, "table", "positions"], f"{positions} do not rise; expected rising positions"
    for column in ("values", "forward", "backward"):
        if column in table and len(table[column]) != len(positions):
            yield (
                ["errors", name, "table", column],
                f"{len(table[column])} values at {len(positions)} positions; expected one for each",
            )


def _wrong_tree(section: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    axes, seen, moved = section["axes"], {BASE: None}, dict[str, str]()
    for index, row in enumerate(section["bodies"]):
        place: Place = ["bodies", index]
        if row["name"] in seen:
            yield [*place, "name"], f"there is already a body '{row['name']}'; expected a name of its own"
        if row["parent"] not in seen:
            yield [*place, "parent"], f"no body '{row['parent']}' stands above; expected one of {', '.join(seen)}"
        axis = row.get("axis")
        if axis in moved:
            yield [*place, "axis"], f"axis {axis} moves '{moved[axis]}' already; expected one body for each axis"
        for key in ([] if axis is None else [axis], row.get("squareness", {})):
            for letter in key:
                if letter not in axes:
                    yield [*place], f"there is no axis {letter}; the axes are {', '.join(axes)}"
        if row.get("squareness") and (axis is None or axis in row["squareness"]):
            yield [*place, "squareness"], "expected angles from this body's own axis to other axes"
        seen[row["name"]] = None
        moved |= {axis: row["name"]} if axis else {}
    for letter in axes:
        if letter not in moved:
            yield ["axes", letter], f"axis {letter} moves no body; expected a body with axis: {letter}"
    for key in ("tool", "workpiece"):
        if section[key] not in seen:
            yield [key], f"there is no body '{section[key]}'; expected one of {', '.join(seen)}"
    monitored = section.get("monitored")
    if monitored is not None and axes.get(monitored, {}).get("kind") != "rotary":
        rotary = ", ".join(letter for letter, row in axes.items() if row["kind"] == "rotary") or "null"
        yield ["monitored"], f"'{monitored}' is no rotary axis; expected {rotary}"
