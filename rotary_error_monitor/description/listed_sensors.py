"""Sensors that a stage's file lists by name (section `sensors`), each of a kind that says what it shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from rotary_error_monitor.description import schema
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic, angular, planar

_COMMON = ("noise", "resolution", "range", "uncertainty", "zero", "gain")
_ELSEWHERE = "latency"
"""Is no number of the kind, but of the response of the instrument, which `StageDescription.responses` has."""

FIELDS, UNIT = ("displacement",), "m"
"""Of a kind whose file names none."""


@dataclass(frozen=True)
class ListedSensor:
    """One sensor of the list: it reads `zero + gain * (what the error motion moves its target by + form)`.

    It has a field or several, all with the same noise, resolution, range, uncertainty and gain. One that is an input
    reads `zero +` what acts on the stage, such as a temperature; it has neither gain nor form.

    Attributes:
        kind: of sensor, one file in `config/schema/sensors/` and one class in `sensors/`.
        noise: standard deviation of a reading before rounding, in `unit`.
        resolution: step of a reading, in `unit`.
        range: half of the measuring range, in `unit`.
        uncertainty: standard uncertainty of `zero` and `form`, in `unit`.
        zero: reading of a perfect axis and target, in `unit`: of all fields alike, or one for each.
        gain: reading per displacement; negative for a sensor that counts the other way.
        place: numbers of its kind by name, such as `azimuth` (rad) and `height` (m).
        form: what its target shows of itself over a turn, in `unit`: of one field by orders of the place on the
            target, `azimuth - theta`; of two by orders of the rotation, x and y along the axes of the stage.
        fields: of a sample, as its kind's file names them.
        unit: SI unit of the fields, m or rad, or °C, as its kind's file names it.
    """

    kind: str
    noise: float
    resolution: float
    range: float
    uncertainty: float
    zero: float | tuple[float, ...] = 0.0
    gain: float = 1.0
    place: Mapping[str, float] = field(default_factory=dict)
    form: tuple[AngularHarmonic | PlanarHarmonic, ...] = ()
    fields: tuple[str, ...] = FIELDS
    unit: str = UNIT

    @property
    def is_input(self) -> bool:
        """Whether it measures what acts on the stage, and nothing of how the rotor stands."""
        return is_input(self.kind)

    @property
    def zeros(self) -> tuple[float, ...]:
        """`zero` of each field."""
        return self.zero if isinstance(self.zero, tuple) else (self.zero,) * len(self.fields)

    @property
    def forms(self) -> tuple[tuple[AngularHarmonic, ...], ...]:
        """`form` of each field; of two, along the axes of the stage."""
        parts = [_parts(row) for row in self.form]
        return tuple(tuple(part[place] for part in parts) for place in range(len(self.fields)))

    def shifted(self, by: Sequence[float]) -> ListedSensor:
        """The same with the zero of each field larger by an amount."""
        zeros = tuple(zero + float(each) for zero, each in zip(self.zeros, by, strict=True))
        return replace(self, zero=zeros if len(zeros) > 1 else zeros[0])


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


def quantity(kind: str) -> tuple[tuple[str, ...], str]:
    """Fields of a sample of a kind of listed sensor, and their SI unit, as its file in `config/schema/sensors/` says.

    The kind is one that has such a file.
    """
    said = schema.sensor_kinds()[kind]
    return tuple(said.get("fields", FIELDS)), str(said.get("unit", UNIT))


def is_input(kind: str) -> bool:
    """Whether sensors of a kind are inputs, as its file in `config/schema/sensors/` says."""
    return bool(schema.sensor_kinds().get(kind, {}).get("input", False))


def pose_streams(streams: Iterable[str]) -> tuple[str, ...]:
    """Those of the streams of listed sensors that are no inputs."""
    inputs = tuple(f"{kind}_" for kind in schema.sensor_kinds() if is_input(kind))
    return tuple(stream for stream in streams if not stream.startswith(inputs))


def _sensor(row: Mapping[str, Any]) -> ListedSensor:
    own = {name: value for name, value in row.items() if name not in ("kind", "form", _ELSEWHERE, *_COMMON)}
    (fields, unit), form = quantity(row["kind"]), row.get("form", ())
    return ListedSensor(
        kind=row["kind"],
        **{name: _numbers(row[name]) for name in _COMMON if name in row},
        place={name: float(value) for name, value in own.items()},
        form=angular(form) if len(fields) == 1 else planar(form),
        fields=fields,
        unit=unit,
    )


def _row(sensor: ListedSensor) -> dict[str, Any]:
    row = {"kind": sensor.kind, **sensor.place, **{name: _plain(getattr(sensor, name)) for name in _COMMON}}
    if sensor.is_input:
        del row["gain"]
        return row
    form = [{name: _plain(value) for name, value in vars(each).items()} for each in sensor.form]
    return {**row, "form": form}


def _numbers(value: Any) -> Any:  # noqa: ANN401 (what YAML holds)
    """A number, or one for each field."""
    return tuple(map(float, value)) if isinstance(value, list | tuple) else float(value)


def _plain(value: Any) -> Any:  # noqa: ANN401 (as above)
    """A value as YAML holds it."""
    return list(value) if isinstance(value, tuple) else value


def _parts(row: AngularHarmonic | PlanarHarmonic) -> tuple[AngularHarmonic, ...]:
    """A row of a form, field by field."""
    if isinstance(row, AngularHarmonic):
        return (row,)
    return tuple(AngularHarmonic(row.order, *part) for part in (row.x, row.y))
