"""A displacement probe that looks at a round artefact of the rotor from outside, along a radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Angle, Height
from rotary_error_monitor.description.sensor_section import LARGEST_ARTEFACT, ProbeSection


@dataclass(frozen=True, kw_only=True)
class RadialProbeSection(ProbeSection):
    """Where the probe stands."""

    azimuth: Annotated[Angle, Expected("angle of the probe about +z in rad")]
    height: Annotated[Height, Expected("height of the place that it sees above the ring in m")]

    @property
    def track(self) -> tuple[float]:
        """The height."""
        return (self.height,)

    @property
    def body(self) -> tuple[float, float, float]:
        """At the largest artefact, where the same azimuths are farthest apart."""
        return (LARGEST_ARTEFACT * math.cos(self.azimuth), LARGEST_ARTEFACT * math.sin(self.azimuth), self.height)
