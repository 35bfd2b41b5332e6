"""A load cell at a place of the stage, after which it is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.definition_files import own_columns
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Angle, Gain
from rotary_error_monitor.description.sensor_section import SHAFT_FORCE, SensorSection

LARGEST = 1e6
"""Force, N: the largest load cells of machines measure a tenth of it."""

_Zero = Annotated[float, Expected("a force in N", -LARGEST, LARGEST)]


@dataclass(frozen=True, kw_only=True)
class ForceSection(SensorSection):
    """What the load cell reads along two axes at right angles, or along the first of them alone."""

    fields = own_columns("force")
    unit = "N"
    is_input = True
    measures = SHAFT_FORCE

    noise: Annotated[float, Expected("standard deviation of one reading in N", 0, LARGEST)]
    resolution: Annotated[float, Expected("step of a reading in N", 0, LARGEST)]
    range: Annotated[float, Expected("largest reading, either way, in N", above=0, most=LARGEST)]
    uncertainty: Annotated[float, Expected("standard uncertainty of the zero in N", 0, LARGEST)]
    azimuth: Annotated[Angle, Expected("direction of its first axis, an angle about +z in rad")]
    axes: Annotated[int | None, Expected("1 where it measures along its first axis alone, else 2", 1, 2)] = None
    zero: Annotated[tuple[_Zero, _Zero] | None, Expected("reading [first axis, second axis] without a force in N")] = (
        None
    )
    gain: Gain | None = None
