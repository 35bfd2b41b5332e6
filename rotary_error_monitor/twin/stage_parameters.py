"""The parameters of a stage description one by one, so that their stated uncertainty can be taken into account."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rotary_error_monitor.description.stage import TIMINGS, AngularHarmonic, PlanarHarmonic, StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sensors.library import sensor_kinds

Part = Any
"""A number, a row of harmonics, or numbers by name or in a row: whatever stands in a description."""


@dataclass(frozen=True)
class UncertainParameter:
    """One number of a description that is known to `uncertainty` only.

    Attributes:
        name: dotted name with the component, such as `encoder.eccentricity[0]`.
        uncertainty: its standard uncertainty, in the number's unit.
        seen_by: kinds of streams that it moves: `head`, `autocollimator`, `lvdt`.
        shifted: the description with that number larger by an amount.
    """

    name: str
    uncertainty: float
    seen_by: tuple[str, ...]
    shifted: Callable[[StageDescription, float], StageDescription]


def uncertain_parameters(stage: StageDescription) -> tuple[UncertainParameter, ...]:
    """All numbers whose uncertainty the description states.

    Raises:
        InputError: it states the uncertainty of something that it does not have.
    """
    found: list[UncertainParameter] = []
    for name, uncertainty in stage.uncertainty.items():
        if uncertainty == 0.0 or name in TIMINGS:  # stamps are no number of the twin: effects of latency explain them
            continue
        section_name, _, key = name.partition(".")
        section = getattr(stage, section_name, None)
        attribute = "azimuths" if name == "encoder.azimuth" else key
        if section is None and section_name in {sensor.section for sensor in sensor_kinds().values()}:
            continue  # of a sensor that this stage does not have
        value = getattr(section, attribute, None)
        if value is None:
            raise InputError(f"uncertainty: no parameter is called '{name}'; name one such as encoder.eccentricity")
        for path in _paths(value):
            label = name + "".join(f"[{step}]" for step in path)
            kinds = (sensor for sensor in sensor_kinds().values() if sensor.streams(stage))
            seen_by = tuple(sensor.kind for sensor in kinds if name.startswith(sensor.moved_by))
            found.append(UncertainParameter(label, uncertainty, seen_by, _shifter(section_name, attribute, path)))
    return tuple(found)


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
