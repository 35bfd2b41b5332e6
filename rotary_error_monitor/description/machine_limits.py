"""What a machine's thermometer can show: readings that say otherwise are doubted, not believed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Temperature
from rotary_error_monitor.description.sections import Place, Section

FASTEST = {"linear": 2.0, "rotary": 60.0}
"""Speed of an axis where the file states none, m/s and rad/s: what the fastest machining centres reach."""

QUICKEST = {"linear": 20.0, "rotary": 1000.0}
"""Acceleration of an axis where the file states none, m/s² and rad/s²: what linear motors and torque motors reach."""


@dataclass(frozen=True)
class MachineLimits(Section):
    """Limits of a machine's temperature: what a machine shop has, and what a body of iron can do."""

    temperature: Annotated[tuple[Temperature, Temperature], Expected("[lowest, highest] temperature in °C")] = (
        5.0,
        45.0,
    )
    temperature_rate: Annotated[float, Expected("fastest change of temperature in K/s", above=0, most=100)] = 0.5
    temperature_age: Annotated[
        float, Expected("age in s from which a temperature counts as uncertain", above=0, most=86_400)
    ] = 10.0

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """A range whose end is not above its beginning."""
        low, high = self.temperature
        if low >= high:
            yield ("temperature",), f"[{low}, {high}] is no range; expected the lowest temperature first"
