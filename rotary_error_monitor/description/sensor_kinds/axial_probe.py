"""A displacement probe that looks along +z at a face of the rotor, on the axis (radius 0) or beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Angle
from rotary_error_monitor.description.sensor_section import ProbeSection


@dataclass(frozen=True, kw_only=True)
class AxialProbeSection(ProbeSection):
    """Where the probe stands."""

    or_else = ", or gains of unlike sign before two faces"

    azimuth: Annotated[Angle | None, Expected("angle of the probe about +z in rad")] = None
    radius: Annotated[
        float, Expected("distance of the place that it sees from the axis in m, 0 for on the axis", 0, 10)
    ]

    @property
    def track(self) -> tuple[float, float]:
        """The radius, and the face: one may look from above and one from below, by the way that they count."""
        return (self.radius, math.copysign(1.0, self.gain or 1.0))

    @property
    def body(self) -> tuple[float, float, float]:
        """Before one of the two faces."""
        azimuth, (radius, side) = self.azimuth or 0.0, self.track
        return (radius * math.cos(azimuth), radius * math.sin(azimuth), side)
