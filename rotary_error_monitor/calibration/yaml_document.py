"""YAML files changed in place: comments and order kept, numbers written so that every reader takes them for numbers."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import RoundTripRepresenter

from rotary_error_monitor.errors import InputError

T = TypeVar("T")
DIGITS = 6
"""Significant digits of a number in a file: a part in a million of an error is far below any uncertainty."""


class Whole(float):
    """A number that is written with all its digits: it was not found by this calibration."""


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


class YamlDocument:
    """A YAML file that is being changed; nothing is on disk before `save`."""

    def __init__(self, path: Path) -> None:
        """Read the file, which has been found valid before."""
        self._yaml = YAML()
        self._yaml.width = 120
        self._yaml.indent(mapping=2, sequence=4, offset=2)
        self._yaml.preserve_quotes = True
        self._yaml.representer.add_representer(float, _represent_float)
        self._yaml.representer.add_representer(Whole, _represent_whole)
        self.content: CommentedMap = self._yaml.load(path.read_text(encoding="utf-8"))

    def save(self, path: Path, check: Callable[[Path], T]) -> T:
        """Write the file, whole or not at all; `check` loads the draft beside it and gives what is in it.

        Raises:
            InputError: what `check` raises (nothing is written then), or the file cannot be written.
        """
        text = io.StringIO()
        self._yaml.dump(self.content, text)
        draft = path.with_name(f".{path.name}.draft")
        try:
            draft.write_text(text.getvalue(), encoding="utf-8")
            found = check(draft)
            draft.replace(path)
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error})") from error
        finally:
            draft.unlink(missing_ok=True)
        return found


def section_of(mapping: CommentedMap, name: str) -> CommentedMap:
    """The mapping under `name`, made if there is none."""
    if name not in mapping:
        mapping[name] = CommentedMap()
    found: CommentedMap = mapping[name]
    return found


def note_provenance(section: CommentedMap, names: Sequence[str], provenance: Provenance) -> None:
    """Write down under `calibration` where the named parts of a section are from."""
    notes = section_of(section, "calibration")
    for name in names:
        row: dict[str, Any] = {
            "date": provenance.date.isoformat(),
            "source": provenance.source,
            "sha256": provenance.sha256,
        }
        if provenance.uncertainty is not None:
            row["uncertainty"] = number(provenance.uncertainty)
        if provenance.figures:
            row["figures"] = {key: number(value) for key, value in provenance.figures.items()}
        notes[name] = in_one_line(row)


def _represent_float(representer: RoundTripRepresenter, value: float) -> ScalarNode:
    """A number that every YAML reader takes for one: 1.0e-07, where Python writes 1e-07."""
    return _scalar(representer, f"{value:.{DIGITS}g}")


def _represent_whole(representer: RoundTripRepresenter, value: Whole) -> ScalarNode:
    return _scalar(representer, float.__repr__(value))


def _scalar(representer: RoundTripRepresenter, text: str) -> ScalarNode:
    mantissa, mark, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    node: ScalarNode = representer.represent_scalar("tag:yaml.org,2002:float", f"{mantissa}{mark}{exponent}")
    return node


def number(value: float) -> float:
    """The value to the digits that a file holds."""
    return float(f"{value:.{DIGITS}g}")


def numbers(values: NDArray[np.float64]) -> list[float]:
    """The values to the digits that a file holds."""
    return [number(float(value)) for value in values]


def _sequence(values: list[Any]) -> CommentedSeq:
    sequence = CommentedSeq(values)
    sequence.fa.set_flow_style()
    return sequence


def in_one_line(value: Any) -> Any:  # noqa: ANN401 (YAML content)
    """The value as YAML in one line."""
    if isinstance(value, dict):
        mapping = CommentedMap({key: in_one_line(part) for key, part in value.items()})
        mapping.fa.set_flow_style()
        return mapping
    if isinstance(value, list):
        return _sequence([in_one_line(part) for part in value])
    return value
