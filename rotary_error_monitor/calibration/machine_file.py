"""The machine file as a calibration leaves it: sections replaced, comments kept, and where each number is from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from rotary_error_monitor.calibration.yaml_document import (
    Provenance,
    Whole,
    YamlDocument,
    in_one_line,
    note_provenance,
    number,
    numbers,
    section_of,
)
from rotary_error_monitor.description.machine import (
    Axis,
    ErrorComponent,
    MachineDescription,
    load_machine,
    machine_from_mapping,
)
from rotary_error_monitor.description.machine_section import machine_mapping
from rotary_error_monitor.errors import InputError

Array = NDArray[np.float64]


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
        self._document = YamlDocument(path)
        if "bodies" not in self._document.content["machine"]:
            self._document.content["machine"] = _tree(self.machine)
        self._section: CommentedMap = self._document.content["machine"]

    @property
    def changed(self) -> MachineDescription:
        """The description as the changes so far make it."""
        return machine_from_mapping(self._section)

    def set_table(self, name: str, positions: Array, forward: Array, backward: Array | None) -> None:
        """Make the error component `name` the table of values measured; what it was before is gone.

        A reversal error of the axis is in the two columns of its own positioning error and leaves the axis.
        """
        table: dict[str, Any] = {"positions": numbers(positions)}
        if backward is None:
            table["values"] = numbers(forward)
        else:
            table |= {"forward": numbers(forward), "backward": numbers(backward)}
            self._section["axes"][name[2]].pop("reversal", None)
        self._renewed(name)["table"] = in_one_line(table)

    def set_slope(self, name: str, slope: float) -> None:
        """Beside its table, give the error component `name` a slope in m per m (or rad per m) over the axis."""
        low, high = self.machine.axis(name[2]).travel
        self._component(name)["poly"] = in_one_line([0.0, number(slope * (high - low) / 2)])

    def set_squareness(self, letter: str, other: str, angle: float) -> None:
        """Angle between two axes less 90 degrees, at the body that axis `letter` moves, rad."""
        body = self._body(self.machine.body_of(letter).name)
        if "squareness" not in body:
            body["squareness"] = in_one_line({})
        body["squareness"][other] = number(angle)

    def set_location(self, letter: str, shift: Array, rotation: Array) -> None:
        """Location error of the body that the axis moves, m and rad; it replaces a squareness there."""
        self._set_location(self.machine.body_of(letter).name, shift, rotation)

    def set_machine(self, machine: MachineDescription) -> None:
        """Polynomials, harmonics, location errors, reversal and expansion of an identified machine.

        Raises:
            InputError: its bodies or axes are not those of the file.
        """
        if [body.name for body in machine.bodies] != [body.name for body in self.machine.bodies]:
            raise InputError(f"the identified machine has other bodies than {self.path}")
        for name, component in machine.errors.items():
            if component != self.machine.errors.get(name):
                self._set_component(name, component)
        for new, old in zip(machine.bodies, self.machine.bodies, strict=True):
            if new.location_error != old.location_error:
                self._set_location(new.name, np.array(new.location_error.shift), np.array(new.location_error.rotation))
        for axis, before in zip(machine.axes, self.machine.axes, strict=True):
            self._set_axis(axis, before)

    def note(self, names: Sequence[str], provenance: Provenance) -> None:
        """Write down where sections are from, under `calibration`, by their names."""
        note_provenance(self._section, names, provenance)

    def save(self, path: Path) -> MachineDescription:
        """Write the file, whole or not at all, and give the description that is now in it.

        Raises:
            InputError: what was set breaks the schema of machine files; nothing is written then.
        """
        return self._document.save(path, load_machine)

    def _renewed(self, name: str) -> CommentedMap:
        """The component emptied, without the comment beside it: that told where the old number was from."""
        self._component(name)
        errors: CommentedMap = self._section["errors"]
        errors.ca.items.pop(name, None)
        errors[name] = CommentedMap()
        return self._component(name)

    def _component(self, name: str) -> CommentedMap:
        return section_of(section_of(self._section, "errors"), name)

    def _set_component(self, name: str, component: ErrorComponent) -> None:
        entry = self._renewed(name)
        if component.table is not None:
            table = {"positions": list(component.table.positions), "forward": list(component.table.forward)}
            entry["table"] = in_one_line({**table, "backward": list(component.table.backward)})
        if component.poly:
            entry["poly"] = in_one_line([number(value) for value in component.poly])
        if component.harmonic:
            rows = [{"order": w.order, "cos": number(w.cos), "sin": number(w.sin)} for w in component.harmonic]
            entry["harmonic"] = in_one_line(rows)

    def _body(self, name: str) -> CommentedMap:
        """The body that is about to change, without the comment beside it."""
        bodies: CommentedSeq = self._section["bodies"]
        at = next(k for k, body in enumerate(bodies) if body["name"] == name)
        bodies.ca.items.pop(at, None)
        found: CommentedMap = bodies[at]
        return found

    def _set_location(self, name: str, shift: Array, rotation: Array) -> None:
        body = self._body(name)
        body.pop("squareness", None)
        body["location_error"] = in_one_line({"shift": numbers(shift), "rotation": numbers(rotation)})

    def _set_axis(self, axis: Axis, before: Axis) -> None:
        entry = self._section["axes"][axis.letter]
        for key in ("reversal", "expansion"):
            if getattr(axis, key) != getattr(before, key):
                entry[key] = number(getattr(axis, key))


def _tree(machine: MachineDescription) -> CommentedMap:
    """The machine as a tree of bodies, a row in one line each, all numbers with all their digits."""
    content = _whole(machine_mapping(machine))
    for row in (*content["axes"].values(), *content["bodies"]):
        for key in ("expansion", "reversal", "pose", "location_error"):
            if key in row and not np.any(list(_numbers_in(row[key]))):
                del row[key]
    section = CommentedMap(content)
    for name in ("axes", "errors"):
        section[name] = CommentedMap({key: in_one_line(row) for key, row in content[name].items()})
    section["bodies"] = CommentedSeq([in_one_line(body) for body in content["bodies"]])
    return section


def _whole(value: Any) -> Any:  # noqa: ANN401 (YAML content)
    if isinstance(value, dict):
        return {key: _whole(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_whole(part) for part in value]
    return Whole(value) if isinstance(value, float) else value


def _numbers_in(value: Any) -> Iterator[float]:  # noqa: ANN401 (YAML content)
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _numbers_in(part)
    else:
        yield value
