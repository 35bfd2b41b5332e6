"""A thermometer at a place of the stage, after which it is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.definition_files import own_columns
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.sensor_section import PLACE_TEMPERATURE, SensorSection


@dataclass(frozen=True, kw_only=True)
class ThermometerSection(SensorSection):
    """What the thermometer reads, in °C; it has neither gain nor form."""

    fields = own_columns("thermometer")
    unit = "°C"
    is_input = True
    is_slow = True
    measures = PLACE_TEMPERATURE

    noise: Annotated[float, Expected("standard deviation of one reading in K", 0, 10)]
    resolution: Annotated[float, Expected("step of a reading in K", 0, 10)]
    range: Annotated[float, Expected("largest reading, above and below 0 °C, in K", above=0, most=2000)]
    uncertainty: Annotated[float, Expected("standard uncertainty of the zero in K", 0, 100)]
    zero: Annotated[float | None, Expected("reading minus temperature in K", -100, 100)] = None
