"""What a stage's file states of the error motion of its spindle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import PlaneWaves, Waves
from rotary_error_monitor.description.quantities import DisplacementPair

Compliance = Annotated[float, Expected("a compliance in m/N or rad/N", -0.001, 0.001)]


@dataclass(frozen=True)
class Spindle:
    """Known error motion: radial at the ring and axial (m), tilt (rad), compliances (m/N, rad/N), drift (m/K).

    The rows of `axial` are `cos * cos(order * theta) + sin * sin(order * theta)`.
    """

    radial: Annotated[PlaneWaves, Expected("at most 500 rows {order, x: [cos, sin], y: [cos, sin]} in m")] = ()
    tilt: Annotated[PlaneWaves, Expected("at most 500 rows {order, x: [cos, sin], y: [cos, sin]} in rad")] = ()
    radial_compliance: Annotated[Compliance, Expected("radial displacement per force in m/N")] = 0.0
    tilt_compliance: Annotated[Compliance, Expected("tilt per force in rad/N")] = 0.0
    radial_thermal: Annotated[DisplacementPair, Expected("[x, y] in m/K, each at most 10 mm/K")] = (0.0, 0.0)
    axial: Annotated[Waves, Expected("axial error motion: at most 500 rows {order, cos, sin} in m")] = ()
