"""Sensors that a stage's file lists by name (section `sensors`), each of a kind that says what it shows."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rotary_error_monitor.description.expected import entries
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.sections import extended, stated
from rotary_error_monitor.description.sensor_section import ENTRY_POINTS, ProbeSection, SensorSection, listed_kinds
from rotary_error_monitor.errors import InputError

EXTERNAL_SENSORS = "external_sensors"
"""Parameter of a cell with the names of listed sensors that a program publishes which its file does not start."""

_ELSEWHERE = "latency"
"""Is no number of the kind, but of the response of the instrument, which `StageDescription.responses` has."""


@dataclass(frozen=True)
class ListedSensor:
    """One sensor of the list: it reads `zero + gain * (what the error motion moves its target by + form)`.

    It has a field or several, all with the same noise, resolution, range, uncertainty and gain. One that is an input
    reads `zero + gain *` what acts on the stage, such as a temperature; it has no form.

    Attributes:
        kind: of sensor, one file in `description/sensor_kinds/` and one class in `sensors/`.
        noise: standard deviation of a reading before rounding, in `unit`.
        resolution: step of a reading, in `unit`.
        range: half of the measuring range, in `unit`.
        uncertainty: standard uncertainty of `zero` and `form`, in `unit`; of `form` alone where the stage states one of
            the zero.
        zero: reading of a perfect axis and target, in `unit`: of all fields alike, or one for each.
        gain: reading per displacement; negative for a sensor that counts the other way.
        place: numbers of its kind by name, such as `azimuth` (rad) and `height` (m).
        form: what its target shows of itself over a turn, in `unit`: of one field by orders of the place on the
            target, `azimuth - theta`; of two by orders of the rotation, x and y along the axes of the stage.
        fields: of a sample, as its kind names them.
        unit: SI unit of the fields, m, rad or N, or °C, as its kind names it.
        target: name of the target whose `form` it sees, which others see as well; empty where it has one of its own.
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
    fields: tuple[str, ...] = field(default_factory=SensorSection.sample_fields)
    unit: str = SensorSection.unit
    target: str = ""

    @property
    def is_input(self) -> bool:
        """Whether it measures what acts on the stage, and nothing of how the rotor stands."""
        return is_input(self.kind)

    @property
    def is_slow(self) -> bool:
        """Whether it samples about once a second."""
        return self.kind in listed_kinds() and listed_kinds()[self.kind].is_slow

    @property
    def measures(self) -> str:
        """What it measures of what acts on the stage, as its kind declares; empty for any other sensor."""
        return listed_kinds()[self.kind].measures if self.kind in listed_kinds() else ""

    @property
    def zeros(self) -> tuple[float, ...]:
        """`zero` of each field."""
        return self.zero if isinstance(self.zero, tuple) else (self.zero,) * len(self.fields)

    @property
    def may_have_form(self) -> bool:
        """Whether a form of its target can be stated: rows are of one field or two."""
        return len(self.fields) <= 2

    @property
    def forms(self) -> tuple[tuple[AngularHarmonic, ...], ...]:
        """`form` of each field; of two, along the axes of the stage."""
        parts = [_parts(row) for row in self.form]
        return tuple(tuple(part[place] for part in parts) for place in range(len(self.fields)))

    def shifted(self, by: Sequence[float]) -> ListedSensor:
        """The same with the zero of each field larger by an amount."""
        zeros = tuple(zero + float(each) for zero, each in zip(self.zeros, by, strict=True))
        return replace(self, zero=zeros if len(zeros) > 1 else zeros[0])


def listed_sensors(section: Mapping[str, SensorSection]) -> dict[str, ListedSensor]:
    """Sensors by the name of their stream, such as `axial_probe_top`.

    They are in the order of these names, which is that of their bits in masks, however the file lists them.
    """
    found = {stream_of_sensor(name, row.kind): listed_sensor(row) for name, row in section.items()}
    return {stream: found[stream] for stream in sorted(found)}


def sensors_section(
    sensors: Mapping[str, ListedSensor], latency: Mapping[str, float], targets: Container[str] = ()
) -> dict[str, SensorSection]:
    """The section of a file: the inverse of `listed_sensors`, with the latency of each stream.

    The form of one of the `targets` stands there, not with the sensors that see it.
    """
    found = {}
    for stream, sensor in sensors.items():
        kind, target = listed_kinds()[sensor.kind], sensor.target if sensor.target in targets else None
        more: dict[str, object] = {**sensor.place, "latency": latency[stream] or None}
        if issubclass(kind, ProbeSection):
            more |= {"target": target, "form": None} if target else {"target": None}
        found[name_of(stream, sensor)] = extended(kind, sensor, **more)
    return found


def stream_of_sensor(name: str, kind: str) -> str:
    """Name of the stream of a sensor, by its name in the list and its kind."""
    return f"{kind}_{name}"


def name_of(stream: str, sensor: ListedSensor) -> str:
    """Name of a sensor in the list, by its stream."""
    return stream.removeprefix(f"{sensor.kind}_")


def quantity(kind: str) -> tuple[tuple[str, ...], str]:
    """Fields of a sample of a kind of listed sensor, and their SI unit.

    Raises:
        InputError: there is no such kind.
    """
    found = listed_kinds().get(kind)
    if found is None:
        raise InputError(
            f"no file of sensor_kinds/ and no entry point of '{ENTRY_POINTS}' is of sensor kind '{kind}'; "
            f"there are {', '.join(listed_kinds())}"
        )
    return found.sample_fields(), found.unit


def kind_of_stream(stream: str) -> str | None:
    """Kind of the listed sensor whose stream is called so; None of any other stream."""
    return max((kind for kind in listed_kinds() if stream.startswith(f"{kind}_")), key=len, default=None)


def short_names(fields: Sequence[str]) -> tuple[str, ...]:
    """What the fields of a sample are called beside one another: x, y and z, or more than three by their names."""
    return tuple("xyz"[: len(fields)]) if len(fields) <= 3 else tuple(fields)


def is_input(kind: str) -> bool:
    """Whether sensors of a kind are inputs."""
    return kind in listed_kinds() and listed_kinds()[kind].is_input


def pose_streams(streams: Iterable[str]) -> tuple[str, ...]:
    """Those of the streams of listed sensors that are no inputs."""
    inputs = tuple(f"{kind}_" for kind in listed_kinds() if is_input(kind))
    return tuple(stream for stream in streams if not stream.startswith(inputs))


def listed_sensor(row: SensorSection) -> ListedSensor:
    """A sensor as a file states it: what its kind states of its own is its place."""
    found, common = stated(row), {each.name for each in entries(ListedSensor)}
    place = {name: value for name, value in found.items() if name not in (*common, _ELSEWHERE)}
    own = {name: value for name, value in found.items() if name in common}
    fields = row.sample_fields()
    if len(fields) > 1:  # a file states one for each
        own.setdefault("zero", (0.0,) * len(fields))
    return ListedSensor(**own, place=place, fields=fields, unit=row.unit)


def _parts(row: AngularHarmonic | PlanarHarmonic) -> tuple[AngularHarmonic, ...]:
    """A row of a form, field by field."""
    if isinstance(row, AngularHarmonic):
        return (row,)
    return tuple(AngularHarmonic(row.order, *part) for part in (row.x, row.y))
