"""The offset of a tool by body, for people and for programs: text, CSV, JSON, page and picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.machine_poses import Poses
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.budget import BodyPart, OffsetBudget
from rotary_error_monitor.machine.characteristic import body_numbers
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import (
    Tone,
    about,
    images,
    made_by,
    paragraph,
    section,
    table,
    verdict,
    whole_page,
)
from rotary_error_monitor.report.result_files import contents_of, csv_of
from rotary_error_monitor.units import MICRO, without_rounding_error

COMPONENTS = ("dx_um", "dy_um", "dz_um", "da_urad", "db_urad", "dc_urad")
HEAD = ("x, µm", "y, µm", "z, µm", "a, µrad", "b, µrad", "c, µrad")

MOST_ROWS = 20
"""Poses that are printed: what a terminal shows without scrolling; files have all."""

NONE_STATED = "the file states no uncertainty (sections uncertainty and calibration, repeatability of axes)"


def offset_text(machine: MachineDescription, poses: Poses, budget: OffsetBudget) -> str:
    """Tables for a terminal: one pose in full, or the poses of a program one by one and its bodies over all."""
    lines = _one_pose(machine, poses, budget) if len(poses) == 1 else _program(machine, poses, budget)
    return "\n".join([*lines, *(f"note: {note}" for note in notes_of(machine, poses, budget))])


def notes_of(machine: MachineDescription, poses: Poses, budget: OffsetBudget) -> list[str]:
    """What somebody should know who reads the figures."""
    found = []
    unknown = []
    for axis, direction in zip(machine.axes, poses.direction.T, strict=True):
        count = int(np.count_nonzero(direction == 0))
        if count and _has_directions(machine, axis.letter):
            unknown.append(axis.letter if count == len(poses) else f"{axis.letter} at {count} of {len(poses)} poses")
    if unknown:
        found.append(
            f"the direction of travel of {', '.join(unknown)} is not known; the mean of both directions is taken there"
        )
    if budget.uncertainty is None:
        found.append(NONE_STATED)
    else:
        repeated = ", ".join(axis.letter for axis in machine.axes if axis.repeatability)
        parts = [
            *(["the file's section uncertainty"] if machine.uncertainty else []),
            *([f"calibration of {', '.join(_without_places(machine))}"] if machine.calibrated else []),
            *([f"repeatability of {repeated}"] if repeated else []),
        ]
        found.append(f"the uncertainty is by {'; '.join(parts)}; errors of which nothing is stated count as exact")
    return found


def _without_places(machine: MachineDescription) -> list[str]:
    """Names of calibrated parts."""
    return list(dict.fromkeys(name.removesuffix(".shift") for name in machine.calibrated))


def _has_directions(machine: MachineDescription, letter: str) -> bool:
    """Whether an axis's errors depend on the direction of travel."""
    tables = [error.table for name, error in machine.errors.items() if name[2] == letter and error.table is not None]
    return machine.axis(letter).reversal != 0 or any(each.forward != each.backward for each in tables)


def pose_words(machine: MachineDescription, poses: Poses, number: int) -> str:
    """A pose as people write it: `X 100 mm, C 45°`."""
    words = [
        f"{axis.letter} {value * 1e3:g} mm" if axis.kind == "linear" else f"{axis.letter} {math.degrees(value):g}°"
        for axis, value in zip(machine.axes, poses.positions[number], strict=True)
    ]
    return f"{', '.join(words)}, {poses.temperature[number]:g} °C"


def _row(name: str, values: Array) -> str:
    return f"{name:<32}" + "".join(f"{_rounded(value, 4):11.4f}" for value in values)


def _rounded(value: float, digits: int) -> float:
    """Value in µm or µrad; what rounds to zero has no sign."""
    return round(value * MICRO, digits) + 0.0


def _head(name: str) -> str:
    return f"{name:<32}" + "".join(f"{word:>11}" for word in HEAD)


def part_names(machine: MachineDescription, part: BodyPart) -> tuple[str, str]:
    """Names of the two parts of a body."""
    number = body_numbers(machine)[part.body.name]
    motion = f"error motion of {part.body.axis}" if part.body.axis else ""
    return f"{number} {part.body.name}: location", f"{number} {part.body.name}: {motion}"


def _totals(budget: OffsetBudget) -> Iterator[tuple[str, Array]]:
    yield "exact", budget.exact
    yield "first order", budget.first_order
    yield "exact less first order", budget.difference
    if budget.uncertainty is not None:
        yield "standard uncertainty", budget.uncertainty


def _one_pose(machine: MachineDescription, poses: Poses, budget: OffsetBudget) -> Iterator[str]:
    yield f"{machine.name} at {pose_words(machine, poses, 0)}: offset of the tool as the workpiece sees it"
    yield _head("")
    for name, values in _totals(budget):
        yield _row(name, values[0])
    yield "by body, in first order"
    for part in budget.parts:
        location, motion = part_names(machine, part)
        yield _row(location, part.location[0])
        if part.body.axis:
            yield _row(motion, part.motion[0])
    yield _row("sum", budget.first_order[0])


def _program(machine: MachineDescription, poses: Poses, budget: OffsetBudget) -> Iterator[str]:
    yield f"{machine.name}, {len(poses)} poses: offset of the tool as the workpiece sees it, exact"
    yield _head("pose")
    for number, values in enumerate(budget.exact[:MOST_ROWS]):
        yield _row(f"{number + 1}", values)
    if len(poses) > MOST_ROWS:
        yield f"… and {len(poses) - MOST_ROWS} more; -o OUT.csv has all"
    yield _head("largest amount")
    for name, values in _totals(budget):
        yield _row(name, np.abs(values).max(axis=0))
    yield "largest amount by body, in first order"
    for part in budget.parts:
        location, motion = part_names(machine, part)
        yield _row(location, np.abs(part.location).max(axis=0))
        if part.body.axis:
            yield _row(motion, np.abs(part.motion).max(axis=0))


def offset_contents(
    machine: MachineDescription, poses: Poses, budget: OffsetBudget, outputs: Mapping[str, Path], source: str
) -> Iterator[tuple[Path, bytes]]:
    """Each file that was asked for, by its format, and its content; `source` is the file of poses, if there is one."""
    facts = {"machine": machine.name, **({"poses": source} if source else {}), "made by": made_by()}

    def drawn() -> tuple[list[Drawn], Callable[[Iterable[Drawn]], bytes]]:
        # what draws takes long to load
        from rotary_error_monitor.report.drawing import tiled
        from rotary_error_monitor.report.offset_figure import draw

        return draw(machine, budget), lambda pictures: tiled([[picture] for picture in pictures])

    def page(pictures: Iterable[Drawn]) -> str:
        return whole_page("Offset", machine.name, _sections(machine, poses, budget, facts, images(pictures)))

    return contents_of(
        outputs,
        lambda: _mapping(machine, poses, budget, facts),
        lambda: _csv(machine, poses, budget),
        drawn,
        page,
    )


def _pose_columns(machine: MachineDescription, poses: Poses) -> dict[str, Array]:
    """Columns of a table of poses, in its units."""
    columns = {
        f"{axis.letter}_{axis.shown[1]}": values * axis.shown[0]
        for axis, values in zip(machine.axes, poses.positions.T, strict=True)
    }
    columns |= {
        f"{letter}_direction": values for letter, values in zip(machine.letters, poses.direction.T, strict=True)
    }
    return {**columns, "temperature_degC": poses.temperature}


def _csv(machine: MachineDescription, poses: Poses, budget: OffsetBudget) -> bytes:
    """A row each pose; columns by what they hold, such as exact_dx_um and carriage_location_dx_um."""
    columns = _pose_columns(machine, poses)
    tables = {name.replace(" ", "_"): values for name, values in _totals(budget)}
    for part in budget.parts:
        tables[f"{part.body.name}_location"] = part.location
        if part.body.axis:
            tables[f"{part.body.name}_motion"] = part.motion
    for name, values in tables.items():
        columns |= {f"{name}_{component}": values[:, k] * MICRO for k, component in enumerate(COMPONENTS)}
    rows = np.stack(list(columns.values()), axis=1).tolist()
    return csv_of(columns, (map(without_rounding_error, row) for row in rows))


def _mapping(
    machine: MachineDescription, poses: Poses, budget: OffsetBudget, facts: Mapping[str, str]
) -> dict[str, Any]:
    columns = _pose_columns(machine, poses)

    def components(values: Array) -> dict[str, float]:
        return dict(zip(COMPONENTS, map(without_rounding_error, (values * MICRO).tolist()), strict=True))

    rows = [
        {
            "pose": {name: without_rounding_error(values[number]) for name, values in columns.items()},
            **{name.replace(" ", "_"): components(values[number]) for name, values in _totals(budget)},
            "bodies": {
                part.body.name: {
                    "location": components(part.location[number]),
                    **({"motion": components(part.motion[number])} if part.body.axis else {}),
                }
                for part in budget.parts
            },
        }
        for number in range(len(poses))
    ]
    return {"about": dict(facts), "notes": notes_of(machine, poses, budget), "poses": rows}


def _sections(
    machine: MachineDescription, poses: Poses, budget: OffsetBudget, facts: Mapping[str, str], pictures: str
) -> Iterator[str]:
    shift, turn = (np.linalg.norm(budget.exact[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
    where = "" if len(poses) == 1 else " at most"
    badge = f"{shift.max() * MICRO:.2f} µm, {turn.max() * MICRO:.2f} µrad"
    told = f"The tool is {shift.max() * MICRO:.2f} µm and {turn.max() * MICRO:.2f} µrad off{where}"
    at = pose_words(machine, poses, int(shift.argmax()))
    yield verdict(Tone.PLAIN, badge, f"{told}, at {at}.", notes_of(machine, poses, budget))
    yield pictures
    largest = [[name, *_cells(np.abs(values).max(axis=0))] for name, values in _totals(budget)]
    if len(poses) == 1:
        largest = [[name, *_cells(values[0])] for name, values in _totals(budget)]
    yield section("Offset" if len(poses) == 1 else "Largest amounts", table(["", *HEAD], largest))
    yield section(
        "By body, in first order",
        paragraph("Location errors and error motions add up to the offset in first order."),
        table(["body", *HEAD], list(_body_rows(machine, budget))),
    )
    if len(poses) > 1:
        rows = [[pose_words(machine, poses, k), *_cells(budget.exact[k])] for k in range(min(len(poses), MOST_PAGE))]
        yield section("Poses", table(["pose", *HEAD], rows))
    yield about(facts)


MOST_PAGE = 200
"""Poses in a page's table; CSV and JSON have all."""


def _body_rows(machine: MachineDescription, budget: OffsetBudget) -> Iterator[Sequence[str]]:
    one = len(budget.exact) == 1
    for part in budget.parts:
        location, motion = part_names(machine, part)
        for name, values in [(location, part.location)] + ([(motion, part.motion)] if part.body.axis else []):
            yield [name, *_cells(values[0] if one else np.abs(values).max(axis=0))]


def _cells(values: Array) -> list[str]:
    return [f"{_rounded(value, 3):.3f}" for value in values]
