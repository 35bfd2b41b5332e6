"""What a stage's file states of a ball probe."""

import math
from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Angle, Height
from rotary_error_monitor.description.sensor_section import LARGEST_ARTEFACT, ProbeSection


@dataclass(frozen=True, kw_only=True)
class BallProbe(ProbeSection):
    """Where the probe stands; noise, range, zero, gain and form are those of all displacement probes."""

    azimuth: Annotated[Angle, Expected("angle of the probe about +z in rad")]
    elevation: Annotated[float, Expected("angle of its line above the plane of the ring in rad", -1.5708, 1.5708)]
    height: Annotated[Height, Expected("height of the ball's centre above the ring in m")]

    @property
    def body(self) -> tuple[float, float, float]:
        """At the largest ball, where the same angles are farthest apart."""
        out, up = LARGEST_ARTEFACT * math.cos(self.elevation), LARGEST_ARTEFACT * math.sin(self.elevation)
        return (out * math.cos(self.azimuth), out * math.sin(self.azimuth), up + self.height)
