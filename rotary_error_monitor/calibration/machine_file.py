"""The machine file as a calibration leaves it: sections replaced, all else kept, and where each number is from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.yaml_document import YamlDocument, number, numbers
from rotary_error_monitor.calibration.yaml_text import YamlRows
from rotary_error_monitor.description.machine import (
    MachineDescription,
    component_section,
    load_machine,
    machine_from_mapping,
    machine_mapping,
)
from rotary_error_monitor.description.machine_parts import Axis, ErrorComponent, Harmonic
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.sections import write
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.location_names import SPINDLE

SQUARENESS = "squareness"
"""Name under `calibration` of what a laser tracker or the poses say about linear axes."""


def location_name(letter: str) -> str:
    """Name under `calibration` of the location errors of a rotary axis or the spindle."""
    return f"location of {letter}"


class MachineFile:
    """A machine file that is being changed; nothing is on disk before `save`.

    A section of parameters, as a digital twin has it, becomes a tree of bodies: only that holds all that is calibrated.

    Attributes:
        path: the file that it was read from.
        machine: the description in it, before the changes.
    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            InputError: there is no such file, or it is no valid machine file.
        """
        if not path.is_file():
            raise InputError(
                f"{path}: no such file; calibrate a copy of your own, of config/machines/pan2013.yaml or so"
            )
        self.path = path
        self.machine: MachineDescription = load_machine(path)
        self._document = YamlDocument(path, "machine")
        if "bodies" not in self._document.content:
            notes = self._document.get("calibration")
            self._document.rewrite(_tree(self.machine, notes))

    @property
    def changed(self) -> MachineDescription:
        """The description as the changes so far make it."""
        return machine_from_mapping(self._document.content)

    def set_table(self, name: str, positions: Array, forward: Array, backward: Array | None) -> None:
        """Make the error component `name` the table of values measured; what it was before goes to the history.

        A reversal error of the axis is in the two columns of its own positioning error and leaves the axis.
        """
        table: dict[str, Any] = {"positions": numbers(positions)}
        if backward is None:
            table["values"] = numbers(forward)
        else:
            table |= {"forward": numbers(forward), "backward": numbers(backward)}
            self._document.remove(name, f"axes.{name[2]}.reversal", ("axes", name[2], "reversal"))
        self._document.set(name, f"errors.{name}", ("errors", name), YamlRows({"table": table}))

    def set_slope(self, name: str, slope: float) -> None:
        """Beside its table, give the error component `name` a slope in m per m (or rad per m) over the axis."""
        low, high = self.machine.axis(name[2]).travel
        poly = [0.0, number(slope * (high - low) / 2)]
        self._document.set(name, f"errors.{name}", ("errors", name, "poly"), poly)

    def set_squareness(self, letter: str, other: str, angle: float) -> None:
        """Angle between two axes less 90 degrees, at the body that axis `letter` moves, rad."""
        name = self.machine.body_of(letter).name
        place = ("bodies", self._body(name), "squareness", other)
        self._document.set(SQUARENESS, f"bodies.{name}.squareness.{other}", place, number(angle))

    def set_location(self, letter: str, shift: Array, rotation: Array) -> None:
        """Location error of the body of an axis, or of `spindle`, m and rad; it replaces a squareness there."""
        spindle = self.machine.spindle if letter == SPINDLE else None
        self._set_location(location_name(letter), spindle or self.machine.body_of(letter).name, shift, rotation)

    def set_machine(self, machine: MachineDescription) -> list[str]:
        """Polynomials, harmonics, location errors, reversal and expansion of an identified machine.

        Gives the names of the parts under `calibration` that are from this calibration now.

        Raises:
            InputError: its bodies or axes are not those of the file.
        """
        if [body.name for body in machine.bodies] != [body.name for body in self.machine.bodies]:
            raise InputError(f"the identified machine has other bodies than {self.path}")
        parts = ["machine"]
        for name, component in machine.errors.items():
            if component != self.machine.errors.get(name):
                parts.append(self._noted([name]))
                self._set_component(parts[-1], name, component)
        for new, old in zip(machine.bodies, self.machine.bodies, strict=True):
            if new.location_error != old.location_error:
                parts.append(self._noted([location_name(new.axis), SQUARENESS] if new.axis else []))
                error = new.location_error
                self._set_location(parts[-1], new.name, np.array(error.shift), np.array(error.rotation))
        for axis, before in zip(machine.axes, self.machine.axes, strict=True):
            self._set_axis(axis, before)
        return list(dict.fromkeys(parts))

    def noted_uncertainty(self, name: str) -> float | None:
        """Standard uncertainty of a part by its name under `calibration`, m or rad; None if none is noted."""
        value = self._document.get("calibration", name, "uncertainty")
        return None if value is None else float(value)

    def note(self, names: Sequence[str], provenance: Calibrated) -> None:
        """Write down where sections are from, under `calibration`, by their names, and what they were before."""
        for name in names:
            self._document.note(name, provenance)

    def save(self, path: Path, source: Path | None = None) -> MachineDescription:
        """Write the file, whole or not at all, and give the description that is now in it.

        Raises:
            InputError: what was set breaks the schema of machine files; it names the `source` of what was set, and
                nothing is written then.
        """
        return self._document.save(path, load_machine, source)

    def _noted(self, names: Sequence[str]) -> str:
        """Which of the parts has been calibrated by itself before and is now superseded, or the machine as a whole."""
        notes = self._document.get("calibration") or {}
        return next((name for name in names if name in notes), "machine")

    def _set_component(self, part: str, name: str, component: ErrorComponent) -> None:
        poly = tuple(map(number, component.poly))
        harmonic = tuple(Harmonic(w.order, number(w.cos), number(w.sin)) for w in component.harmonic)
        entry = write(component_section(replace(component, poly=poly, harmonic=harmonic)))
        self._document.set(part, f"errors.{name}", ("errors", name), YamlRows(entry))

    def _body(self, name: str) -> int:
        bodies = self._document.get("bodies")
        return next(k for k, body in enumerate(bodies) if body["name"] == name)

    def _set_location(self, part: str, name: str, shift: Array, rotation: Array) -> None:
        at = self._body(name)
        self._document.remove(part, f"bodies.{name}.squareness", ("bodies", at, "squareness"))
        error = {"shift": numbers(shift), "rotation": numbers(rotation)}
        self._document.set(part, f"bodies.{name}.location_error", ("bodies", at, "location_error"), error)

    def _set_axis(self, axis: Axis, before: Axis) -> None:
        for key in ("reversal", "expansion"):
            if getattr(axis, key) != getattr(before, key):
                place = ("axes", axis.letter, key)
                self._document.set("machine", ".".join(place), place, number(getattr(axis, key)))


def _tree(machine: MachineDescription, notes: dict[str, Any] | None) -> YamlRows:
    """The machine as a tree of bodies, a row in one line each, all numbers with all their digits."""
    content = machine_mapping(machine)
    for row in (*content["axes"].values(), *content["bodies"]):
        for key in ("expansion", "reversal", "pose", "location_error"):
            if key in row and not np.any(list(_numbers_in(row[key]))):
                del row[key]
    for name in ("axes", "bodies", "errors"):
        content[name] = YamlRows(content[name])
    if notes:
        content["calibration"] = YamlRows(notes)
    return YamlRows(content)


def _numbers_in(value: Any) -> Iterator[float]:  # noqa: ANN401 (YAML content)
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _numbers_in(part)
    else:
        yield value
