"""The parameters of a stage description one by one, so that their stated uncertainty can be taken into account."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor, name_of, short_names
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import TWO_AXIS
from rotary_error_monitor.description.two_axis_section import DISTORTIONS, RESPONSES
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.periodic_curves import doubted_orders
from rotary_error_monitor.sensors.library import instrument_of, sensor_kinds

_PAIRS = ("zero", "cubic")
"""What of their answer is of either axis."""

Part = Any
"""A number, a row of harmonics, or numbers by name or in a row: whatever stands in a description."""


@dataclass(frozen=True)
class UncertainParameter:
    """One number of a description that is known to `uncertainty` only.

    Attributes:
        name: dotted name with the component, such as `encoder.eccentricity[0]`.
        uncertainty: its standard uncertainty, in the number's unit.
        seen_by: instruments that it moves: `head`, `autocollimator`, listed sensors by their streams.
        shifted: the description with that number larger by an amount.
    """

    name: str
    uncertainty: float
    seen_by: tuple[str, ...]
    shifted: Callable[[StageDescription, float], StageDescription]


def uncertain_parameters(stage: StageDescription) -> tuple[UncertainParameter, ...]:
    """All numbers whose uncertainty the description states, and zero and form of each listed sensor.

    Raises:
        InputError: it states the uncertainty of something that it does not have.
    """
    found: list[UncertainParameter] = []
    for name, uncertainty in stage.uncertainty.items():
        # stamps and readings of what drives the stage are no numbers of the twin
        if uncertainty == 0.0 or name.endswith(".timing") or name.startswith("environment."):
            continue
        found += (_of_listed if name.startswith("sensors.") else _of_section)(stage, name, uncertainty)
    found += _of_curves(stage)
    for stream, sensor in stage.sensors.items():
        if sensor.uncertainty and stage.zero_uncertainty(stream) is None:
            found += _zero(f"sensors.{name_of(stream, sensor)}.zero", stream, sensor, sensor.uncertainty)
    for label, streams in _before_targets(stage).items():
        found += _form(label, streams, stage.sensors)
    return tuple(found)


def _of_section(stage: StageDescription, name: str, uncertainty: float) -> list[UncertainParameter]:
    """All numbers of a parameter of one section, such as `encoder.eccentricity`."""
    section_name, _, key = name.partition(".")
    if key in (*RESPONSES, *DISTORTIONS) and section_name in TWO_AXIS:
        return _of_response(stage, name, uncertainty)
    section = getattr(stage, section_name, None)
    attribute = "azimuths" if name == "encoder.azimuth" else key
    if section is None and section_name in {sensor.section for sensor in sensor_kinds().values()}:
        return []  # of a sensor that this stage does not have
    value = getattr(section, attribute, None)
    if value is None:
        raise _unknown(name)
    seen_by = _seen_by(stage, name)
    return [
        UncertainParameter(
            name + "".join(f"[{step}]" for step in path), uncertainty, seen_by, _shifter(section_name, attribute, path)
        )
        for path in _paths(value)
    ]


def _of_curves(stage: StageDescription) -> list[UncertainParameter]:
    """Orders that a measured curve of ring or mirror may lack or have too much of, by what it says of its values."""
    found: list[UncertainParameter] = []
    ring = None if stage.encoder is None else stage.encoder.graduation_table
    for section, attribute, table, axes in (
        ("encoder", "graduation", ring, 1),
        ("mirror", "flatness", stage.mirror.flatness_table, 2),
    ):
        if table is None or table.uncertainty == 0.0:
            continue
        seen_by = _seen_by(stage, f"{section}.{attribute}")
        orders, uncertainty = doubted_orders(table)
        for order, axis, part in product(orders, range(axes), (0, 1)):
            name = f"{section}.{attribute}_table[order {order}]"
            name += (f"[{'xy'[axis]}]" if axes > 1 else "") + f"[{('cos', 'sin')[part]}]"
            row = partial(_form_row, axes, axis, order, part)
            found.append(UncertainParameter(name, uncertainty, seen_by, _row_shifter(section, attribute, row)))
    return found


def _row_shifter(
    section: str, attribute: str, row: Callable[[float], AngularHarmonic | PlanarHarmonic]
) -> Callable[[StageDescription, float], StageDescription]:
    """The description with one more row of harmonics, of a size."""

    def shifted(stage: StageDescription, by: float) -> StageDescription:
        part = getattr(stage, section)
        return replace(stage, **{section: replace(part, **{attribute: (*getattr(part, attribute), row(by))})})

    return shifted


def _seen_by(stage: StageDescription, name: str) -> tuple[str, ...]:
    """Instruments that a parameter moves."""
    streams = [(stream, sensor.moved_by) for sensor in sensor_kinds().values() for stream in sensor.streams(stage)]
    return tuple(dict.fromkeys(instrument_of(stream) for stream, moved_by in streams if name.startswith(moved_by)))


def _of_response(stage: StageDescription, name: str, uncertainty: float) -> list[UncertainParameter]:
    """How an instrument of two axes answers, such as `autocollimator.gain`; nothing of one that is not there."""
    stream, _, key = name.partition(".")
    if getattr(stage, stream) is None:
        return []
    paths: list[tuple[Any, ...]] = [(0,), (1,)] if key in _PAIRS else [()]

    def shifter(path: tuple[Any, ...]) -> Callable[[StageDescription, float], StageDescription]:
        def shifted(stage: StageDescription, by: float) -> StageDescription:
            response = stage.response(stream)
            value = getattr(response, key) or ((0.0, 0.0) if key in _PAIRS else 0.0)
            changed = replace(response, **{key: _shift(value, path, by)})
            return replace(stage, responses={**stage.responses, stream: changed})

        return shifted

    return [
        UncertainParameter(name + "".join(f"[{step}]" for step in path), uncertainty, (stream,), shifter(path))
        for path in paths
    ]


def _of_listed(stage: StageDescription, name: str, uncertainty: float) -> list[UncertainParameter]:
    """Gain or zeros of a listed sensor, or a number that says where it stands, such as `sensors.top.height`."""
    _, listed, key = name.split(".")
    stream = next((s for s, sensor in stage.sensors.items() if name_of(s, sensor) == listed), None)
    if stream is None or key not in ("gain", "zero", *stage.sensors[stream].place):
        raise _unknown(name)
    if key == "zero":
        return _zero(name, stream, stage.sensors[stream], uncertainty)

    def moved(sensor: ListedSensor, by: float) -> ListedSensor:
        if key == "gain":
            return replace(sensor, gain=sensor.gain + by)
        return replace(sensor, place={**sensor.place, key: sensor.place[key] + by})

    return [UncertainParameter(name, uncertainty, (stream,), _sensor_shifter((stream,), moved))]


def _zero(label: str, stream: str, sensor: ListedSensor, uncertainty: float) -> list[UncertainParameter]:
    """Zero of each field of a listed sensor; of two fields the axes are those of the stage, as in the file."""

    def zero(axis: int, sensor: ListedSensor, by: float) -> ListedSensor:
        return sensor.shifted([by * (axis == each) for each in range(len(sensor.fields))])

    return [
        UncertainParameter(
            label + _axis(sensor, axis), uncertainty, (stream,), _sensor_shifter((stream,), partial(zero, axis))
        )
        for axis in range(len(sensor.fields))
    ]


def _axis(sensor: ListedSensor, axis: int) -> str:
    """What names a field among several."""
    return f"[{short_names(sensor.fields)[axis]}]" if len(sensor.fields) > 1 else ""


def _before_targets(stage: StageDescription) -> dict[str, tuple[str, ...]]:
    """Streams of listed sensors whose form is uncertain, together before one target; by what has it in the file."""
    found: dict[str, tuple[str, ...]] = {}
    for stream, sensor in stage.sensors.items():
        label = f"targets.{sensor.target}" if sensor.target else f"sensors.{name_of(stream, sensor)}"
        if sensor.uncertainty:
            found[label] = (*found.get(label, ()), stream)
    return found


def _form(label: str, streams: tuple[str, ...], sensors: Mapping[str, ListedSensor]) -> list[UncertainParameter]:
    """What a target shows of itself to the sensors with these streams.

    That is in the orders that are stated and in the first: how well the target is centred or square, which no mounting
    makes zero. Each of the sensors states the most that it may be.
    """
    sensor = sensors[streams[0]]
    if not sensor.may_have_form:
        return []

    def form(axis: int, order: int, part: int, sensor: ListedSensor, by: float) -> ListedSensor:
        return replace(sensor, form=(*sensor.form, _form_row(len(sensor.fields), axis, order, part, by)))

    uncertainty = min(sensors[stream].uncertainty for stream in streams)
    orders = sorted({1, *(row.order for row in sensor.form)} - {0})
    return [
        UncertainParameter(
            f"{label}.form[order {order}]{_axis(sensor, axis)}[{('cos', 'sin')[part]}]",
            uncertainty,
            streams,
            _sensor_shifter(streams, partial(form, axis, order, part)),
        )
        for axis, order, part in product(range(len(sensor.fields)), orders, (0, 1))
    ]


def _form_row(axes: int, axis: int, order: int, part: int, size: float) -> AngularHarmonic | PlanarHarmonic:
    """Row of a form of one field or two, of which one coefficient is not 0."""
    rows = [[0.0, 0.0] for _ in range(axes)]
    rows[axis][part] = size
    pairs = [(cos, sin) for cos, sin in rows]
    return AngularHarmonic(order, *pairs[0]) if axes == 1 else PlanarHarmonic(order, *pairs)


def _sensor_shifter(
    streams: tuple[str, ...], moved: Callable[[ListedSensor, float], ListedSensor]
) -> Callable[[StageDescription, float], StageDescription]:
    def shifted(stage: StageDescription, by: float) -> StageDescription:
        return replace(stage, sensors={**stage.sensors, **{s: moved(stage.sensors[s], by) for s in streams}})

    return shifted


def _unknown(name: str) -> InputError:
    return InputError(f"uncertainty: no parameter is called '{name}'; name one such as encoder.eccentricity")


def _paths(value: Part) -> list[tuple[Any, ...]]:
    """Where the numbers of a value stand; orders of harmonics are names, not numbers that could be wrong."""
    if isinstance(value, int | float):
        return [()]
    if isinstance(value, AngularHarmonic):
        return [("cos",), ("sin",)]
    if isinstance(value, PlanarHarmonic):
        return [(axis, part) for axis in ("x", "y") for part in (0, 1)]
    keys = list(value) if isinstance(value, Mapping) else range(len(value))
    return [(key, *rest) for key in keys for rest in _paths(value[key])]


def _shifter(
    section: str, attribute: str, path: tuple[Any, ...]
) -> Callable[[StageDescription, float], StageDescription]:
    def shifted(stage: StageDescription, by: float) -> StageDescription:
        part = getattr(stage, section)
        changed = replace(part, **{attribute: _shift(getattr(part, attribute), path, by)})
        return replace(stage, **{section: changed})

    return shifted


def _shift(value: Part, path: tuple[Any, ...], by: float) -> Part:
    if not path:
        return value + by
    step, rest = path[0], path[1:]
    if isinstance(value, AngularHarmonic | PlanarHarmonic):
        return replace(value, **{step: _shift(getattr(value, step), rest, by)})
    if isinstance(value, Mapping):
        return {**value, step: _shift(value[step], rest, by)}
    return tuple(_shift(item, rest, by) if i == step else item for i, item in enumerate(value))
