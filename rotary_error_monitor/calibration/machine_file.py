"""The machine file as a calibration leaves it: sections replaced, comments kept, and where each number is from."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import RoundTripRepresenter

from rotary_error_monitor.description.machine import (
    Axis,
    ErrorComponent,
    MachineDescription,
    load_machine,
    machine_from_mapping,
)
from rotary_error_monitor.errors import InputError

Array = NDArray[np.float64]
DIGITS = 6
"""Significant digits of a number in a file: a part in a million of an error is far below any uncertainty."""


@dataclass(frozen=True)
class Provenance:
    """Where a section of a machine file is from.

    Attributes:
        date: day of the calibration.
        source: name of the file of measurements.
        sha256: its hash; of a folder, that of its files in the order of their names.
        uncertainty: standard uncertainty of the section's numbers, m or rad; None where each has its own.
        figures: further figures by name, such as those of ISO 230-2, in m or rad.
    """

    date: date
    source: str
    sha256: str
    uncertainty: float | None = None
    figures: Mapping[str, float] = field(default_factory=dict)


def hash_source(path: Path) -> str:
    """SHA-256 of a file, or of all files of a folder such as a bag.

    Raises:
        InputError: there is nothing to read.
    """
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    if not files:
        raise InputError(f"{path}: no such file or folder")
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


class MachineFile:
    """A machine file that is being changed; nothing is on disk before `save`.

    Attributes:
        path: the file that it was read from.
        machine: the description in it, before the changes.
    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            InputError: the file is no valid machine file, or holds a twin's parameters instead of a tree of bodies.
        """
        self.path = path
        self.machine: MachineDescription = load_machine(path)
        self._yaml = YAML()
        self._yaml.width = 120
        self._yaml.indent(mapping=2, sequence=4, offset=2)
        self._yaml.preserve_quotes = True
        self._yaml.representer.add_representer(float, _represent_float)
        self._document: CommentedMap = self._yaml.load(path.read_text(encoding="utf-8"))
        self._section: CommentedMap = self._document["machine"]
        if "bodies" not in self._section:
            raise InputError(
                f"{path}: the section 'machine' holds the parameters of a twin; calibrate a machine file with "
                "'bodies', such as config/machines/pan2013.yaml"
            )

    @property
    def changed(self) -> MachineDescription:
        """The description as the changes so far make it."""
        return machine_from_mapping(self._section)

    def set_table(self, name: str, positions: Array, forward: Array, backward: Array | None) -> None:
        """Make the error component `name` the table of values measured; what it was before is gone.

        A reversal error of the axis is in the two columns of its own positioning error and leaves the axis.
        """
        table: dict[str, Any] = {"positions": _numbers(positions)}
        if backward is None:
            table["values"] = _numbers(forward)
        else:
            table |= {"forward": _numbers(forward), "backward": _numbers(backward)}
            self._section["axes"][name[2]].pop("reversal", None)
        self._renewed(name)["table"] = _plain(table)

    def set_slope(self, name: str, slope: float) -> None:
        """Beside its table, give the error component `name` a slope in m per m (or rad per m) over the axis."""
        low, high = self.machine.axis(name[2]).travel
        self._component(name)["poly"] = _flow([0.0, _number(slope * (high - low) / 2)])

    def set_squareness(self, letter: str, other: str, angle: float) -> None:
        """Angle between two axes less 90 degrees, at the body that axis `letter` moves, rad."""
        body = self._body(self.machine.body_of(letter).name)
        if "squareness" not in body:
            body["squareness"] = _plain({})
        body["squareness"][other] = _number(angle)

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
        if "calibration" not in self._section:
            self._section["calibration"] = CommentedMap()
        for name in names:
            row: dict[str, Any] = {
                "date": provenance.date.isoformat(),
                "source": provenance.source,
                "sha256": provenance.sha256,
            }
            if provenance.uncertainty is not None:
                row["uncertainty"] = _number(provenance.uncertainty)
            if provenance.figures:
                row["figures"] = {key: _number(value) for key, value in provenance.figures.items()}
            self._section["calibration"][name] = _plain(row)

    def save(self, path: Path) -> MachineDescription:
        """Write the file, whole or not at all, and give the description that is now in it.

        Raises:
            InputError: what was set breaks the schema of machine files; nothing is written then.
        """
        text = io.StringIO()
        self._yaml.dump(self._document, text)
        draft = path.with_name(f".{path.name}.draft")
        try:
            draft.write_text(text.getvalue(), encoding="utf-8")
            machine = load_machine(draft)
            draft.replace(path)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error})") from error
        finally:
            draft.unlink(missing_ok=True)
        return machine

    def _renewed(self, name: str) -> CommentedMap:
        """The component emptied, without the comment beside it: that told where the old number was from."""
        self._component(name)
        errors: CommentedMap = self._section["errors"]
        errors.ca.items.pop(name, None)
        errors[name] = CommentedMap()
        return self._component(name)

    def _component(self, name: str) -> CommentedMap:
        if "errors" not in self._section:
            self._section["errors"] = CommentedMap()
        errors: CommentedMap = self._section["errors"]
        if name not in errors:
            errors[name] = CommentedMap()
        found: CommentedMap = errors[name]
        return found

    def _set_component(self, name: str, component: ErrorComponent) -> None:
        entry = self._renewed(name)
        if component.table is not None:
            table = {"positions": list(component.table.positions), "forward": list(component.table.forward)}
            entry["table"] = _plain({**table, "backward": list(component.table.backward)})
        if component.poly:
            entry["poly"] = _flow([_number(value) for value in component.poly])
        if component.harmonic:
            rows = [{"order": w.order, "cos": _number(w.cos), "sin": _number(w.sin)} for w in component.harmonic]
            entry["harmonic"] = _plain(rows)

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
        body["location_error"] = _plain({"shift": _numbers(shift), "rotation": _numbers(rotation)})

    def _set_axis(self, axis: Axis, before: Axis) -> None:
        entry = self._section["axes"][axis.letter]
        for key in ("reversal", "expansion"):
            if getattr(axis, key) != getattr(before, key):
                entry[key] = _number(getattr(axis, key))


def _represent_float(representer: RoundTripRepresenter, value: float) -> ScalarNode:
    """A number that every YAML reader takes for one: 1.0e-07, where Python writes 1e-07."""
    text = f"{value:.{DIGITS}g}"
    mantissa, mark, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    node: ScalarNode = representer.represent_scalar("tag:yaml.org,2002:float", f"{mantissa}{mark}{exponent}")
    return node


def _number(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _numbers(values: Array) -> list[float]:
    return [_number(float(value)) for value in values]


def _flow(values: list[Any]) -> CommentedSeq:
    sequence = CommentedSeq(values)
    sequence.fa.set_flow_style()
    return sequence


def _plain(value: Any) -> Any:  # noqa: ANN401 (YAML content)
    """The value as YAML in one line."""
    if isinstance(value, dict):
        mapping = CommentedMap({key: _plain(part) for key, part in value.items()})
        mapping.fa.set_flow_style()
        return mapping
    if isinstance(value, list):
        return _flow([_plain(part) for part in value])
    return value
