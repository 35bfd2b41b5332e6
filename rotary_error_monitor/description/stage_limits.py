"""What a stage can do at most: readings that say more than that are doubted, not believed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.spindle_section import Spindle

HAND = 200.0
"""Force, N, by which a person pushes at a shaft (Lou et al. 2019, Figure 15: pushes by hand, up to some 200 N)."""

WARMING = 10.0
"""Change of temperature, K, that a stage in a workshop goes through."""

RISE = 0.03
"""How long a push takes to come at its steepest, s: by hand it rises within 0.1 s, steepest in the middle."""

SPREAD = 1.5
"""How much larger the error motion of a stage may grow than its description says before the description is wrong."""

Extent = Annotated[float, Expected("a size in m or rad", above=0, most=0.01)]
Rate = Annotated[float, Expected("a rate in m/s or rad/s", above=0, most=10)]

_BEYOND = "beyond what the description predicts"


@dataclass(frozen=True)
class StageLimits:
    """Limits of a stage; a stage file may state each of them (section `limits`).

    What is left out of the file is derived, so the defaults are those of a stage that describes no error motion.
    """

    speed: Annotated[float, Expected("fastest rotation in rad/s", above=0, most=10_000)] = 60.0
    radial: Annotated[Extent, Expected("largest radial error motion at the ring in m")] = 5e-5
    tilt: Annotated[Extent, Expected("largest tilt error motion in rad")] = 3e-4
    radial_rate: Annotated[Rate, Expected(f"fastest change of the radial error motion {_BEYOND}, in m/s")] = 5e-4
    tilt_rate: Annotated[Rate, Expected(f"fastest change of the tilt error motion {_BEYOND}, in rad/s")] = 3e-3
    following_error: Annotated[
        float, Expected("largest distance of the rotation from its command at rest in rad", above=0, most=3)
    ] = 5e-4
    latency: Annotated[
        float, Expected("largest difference of the stamps of command and heads, and lag of the drive, in s", 0, 1)
    ] = 3e-4
    axial: Annotated[Extent, Expected("largest axial error motion in m")] = 5e-5
    axial_rate: Annotated[Rate, Expected(f"fastest change of the axial error motion {_BEYOND}, in m/s")] = 5e-4

    @property
    def components(self) -> tuple[float, ...]:
        """Largest size of each component of error motion at rest, `exc` to `ecc`, m and rad."""
        return self.radial, self.radial, self.axial, self.tilt, self.tilt, self.following_error


def derive_limits(spindle: Spindle) -> StageLimits:
    """Limits of a stage whose file states none, from the error motion that it describes.

    A stage that describes no error motion keeps the defaults: a bearing that is worse than 50 µm or 0.3 mrad is no
    precision stage.
    """
    limits = StageLimits()
    pushed, tilted = HAND * abs(spindle.radial_compliance), HAND * abs(spindle.tilt_compliance)
    described = _peak(spindle.radial)
    if described > 0.0:
        largest = SPREAD * described + pushed + WARMING * math.hypot(*spindle.radial_thermal)
        limits = replace(limits, radial=largest, radial_rate=_rate(largest, pushed))
    described = _peak(spindle.tilt)
    if described > 0.0:
        largest = SPREAD * described + tilted
        limits = replace(limits, tilt=largest, tilt_rate=_rate(largest, tilted))
    described = sum(math.hypot(row.cos, row.sin) for row in spindle.axial)
    if described > 0.0:
        largest = SPREAD * described
        limits = replace(limits, axial=largest, axial_rate=_rate(largest, 0.0))
    return limits


def _peak(rows: Iterable[PlanarHarmonic]) -> float:
    """Largest length that a sum of plane harmonics can reach, at most."""
    return sum(math.hypot(*row.x, *row.y) for row in rows)


def _rate(largest: float, pushed: float) -> float:
    """Change per second of what the description does not predict: a push, or a tenth of all there is."""
    return max(pushed, 0.1 * largest) / RISE
