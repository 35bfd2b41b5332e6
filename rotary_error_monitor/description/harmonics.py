"""Rows of harmonics over a rotation, as stage descriptions hold them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import Deviation

Order = Annotated[int, Expected("waves per revolution, a whole number", 0, 100_000)]
Coefficients = Annotated[tuple[Deviation, Deviation], Expected("[cos, sin], each at most 10 mm or at most 10 mrad")]

# each row costs every sample two sines; calibrations by several heads tell some hundred orders of ring or bearings
_MOST = (0, 500)


@dataclass(frozen=True)
class AngularHarmonic:
    """One order of an error over an angle: `cos * cos(order * psi) + sin * sin(order * psi)` in rad or m."""

    order: Order
    cos: Deviation
    sin: Deviation


@dataclass(frozen=True)
class PlanarHarmonic:
    """One order of a plane vector over the rotation, x and y each `[cos, sin]` coefficients in m or rad."""

    order: Order
    x: Coefficients
    y: Coefficients


Waves = Annotated[tuple[AngularHarmonic, ...], Expected("at most 500 rows {order, cos, sin} in m or rad", count=_MOST)]
PlaneWaves = Annotated[
    tuple[PlanarHarmonic, ...],
    Expected("at most 500 rows {order, x: [cos, sin], y: [cos, sin]} in m or rad", count=_MOST),
]
