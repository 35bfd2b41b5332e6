"""An instrument beside the rotor that sees the tilt of a mirror on it in two axes, such as a further autocollimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.definition_files import own_columns
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import PlaneWaves
from rotary_error_monitor.description.quantities import Gain, Noise, Range, Reading, Resolution, Roll
from rotary_error_monitor.description.sensor_section import SensorSection, Uncertainty


@dataclass(frozen=True, kw_only=True)
class TiltSensorSection(SensorSection):
    """What the instrument reads of the tilt, in rad."""

    fields = own_columns("tilt_sensor")
    unit = "rad"
    further = "autocollimator"

    noise: Annotated[Noise, Expected("standard deviation of one reading in rad")]
    resolution: Annotated[Resolution, Expected("step of a reading in rad")]
    range: Annotated[Range, Expected("half of the measuring range in rad")]
    uncertainty: Annotated[Uncertainty, Expected("standard uncertainty of zero and form in rad, 0.1 nrad or more")]
    zero: Annotated[
        tuple[Reading, Reading] | None, Expected("reading [x, y] of a perfect axis in rad, each at most 0.1 rad")
    ] = None
    gain: Gain | None = None
    roll: Roll | None = None
    form: Annotated[
        PlaneWaves | None,
        Expected(
            "tilt (order 1) and flatness of the mirror over a turn: at most 500 rows {order, x: [cos, sin], "
            "y: [cos, sin]} in rad"
        ),
    ] = None
