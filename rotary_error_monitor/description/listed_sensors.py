"""Sensors that a stage's file lists by name (section `sensors`), each of a kind that says what it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rotary_error_monitor.description.harmonics import AngularHarmonic

_COMMON = ("noise", "resolution", "range", "uncertainty", "zero", "gain")
_ELSEWHERE = "latency"
"""Is no number of the kind, but of the response of the instrument, which `StageDescription.responses` has."""


@dataclass(frozen=True)
class ListedSensor:
    """One sensor of the list: it reads `zero + gain * (what the error motion moves its target by + form)`.

    Attributes:
        kind: of sensor, one file in `config/schema/sensors/` and one class in `sensors/`.
        noise: standard deviation of a reading before rounding, m.
        resolution: step of a reading, m.
        range: half of the measuring range, m.
        uncertainty: standard uncertainty of `zero` and `form`, m.
        zero: reading of a perfect axis and target, m.
        gain: reading per displacement; negative for a sensor that counts the other way.
        place: numbers of its kind by name, such as `azimuth` (rad) and `height` (m).
        form: what its target shows of itself over a turn, m, by orders of the place on it, `azimuth - theta`.
    """

    kind: str
    noise: float
    resolution: float
    range: float
    uncertainty: float
    zero: float = 0.0
    gain: float = 1.0
    place: Mapping[str, float] = field(default_factory=dict)
    form: tuple[AngularHarmonic, ...] = ()


def listed_sensors(section: Mapping[str, Mapping[str, Any]]) -> dict[str, ListedSensor]:
    """Sensors by the name of their stream, such as `axial_probe_top`, from a section that is valid by the schema.

    They are in the order of these names, which is that of their bits in masks, however the file lists them.
    """
    found = {f"{row['kind']}_{name}": _sensor(row) for name, row in section.items()}
    return {stream: found[stream] for stream in sorted(found)}


def sensors_section(sensors: Mapping[str, ListedSensor]) -> dict[str, dict[str, Any]]:
    """The section of a file: the inverse of `listed_sensors`."""
    return {name_of(stream, sensor): _row(sensor) for stream, sensor in sensors.items()}


def name_of(stream: str, sensor: ListedSensor) -> str:
    """Name of a sensor in the list, by its stream."""
    return stream.removeprefix(f"{sensor.kind}_")


def _sensor(row: Mapping[str, Any]) -> ListedSensor:
    own = {name: value for name, value in row.items() if name not in ("kind", "form", _ELSEWHERE, *_COMMON)}
    return ListedSensor(
        kind=row["kind"],
        **{name: float(row[name]) for name in _COMMON if name in row},
        place={name: float(value) for name, value in own.items()},
        form=tuple(
            AngularHarmonic(each["order"], float(each["cos"]), float(each["sin"])) for each in row.get("form", ())
        ),
    )


def _row(sensor: ListedSensor) -> dict[str, Any]:
    form = [{"order": each.order, "cos": each.cos, "sin": each.sin} for each in sensor.form]
    return {"kind": sensor.kind, **sensor.place, **{name: getattr(sensor, name) for name in _COMMON}, "form": form}
