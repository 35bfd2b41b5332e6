"""Where a stage file has what is calibrated of an instrument, and what an earlier note says that stays true."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from rotary_error_monitor.calibration.yaml_document import YamlDocument
from rotary_error_monitor.description.sections import place_in_file
from rotary_error_monitor.description.stage_section import own_places


def in_file(document: YamlDocument, place: tuple[str, ...]) -> tuple[str, ...]:
    """Where the file has a place of a section: in its list of sensors, if it lists what the section is of."""
    return tuple(map(str, place_in_file(place, own_places(document.get("sensors")))))


def set_value(document: YamlDocument, part: str, place: tuple[str, ...], value: Any) -> None:  # noqa: ANN401 (YAML content)
    """Put a value there if it is another; what was there goes to the history of the calibrated `part`."""
    place = in_file(document, place)
    if document.get(*place) != value:
        document.set(part, ".".join(place), place, value)


def kept_figures(document: YamlDocument, names: Iterable[str]) -> Iterator[tuple[str, float]]:
    """Uncertainties that the note on the autocollimator has of these of its parameters, for the note after it."""
    figures = document.get("calibration", "autocollimator", "figures") or {}
    for name in names:
        if f"{name}_uncertainty" in figures:
            yield f"{name}_uncertainty", float(figures[f"{name}_uncertainty"])
