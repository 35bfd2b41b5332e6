"""Parts of a machine: error components, axes and bodies, as descriptions and the trees of files have them.

Errors are in the words of ISO 230-1. Where a file has it otherwise than `MachineDescription`, the part for a file ends
in `Section`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from rotary_error_monitor.description.expected import Expected, Key
from rotary_error_monitor.description.machine_limits import FASTEST, QUICKEST
from rotary_error_monitor.description.quantities import (
    HALF_TURN,
    Deviation,
    Displacements,
    Letter,
    Name,
    Tilt,
    Tilts,
    Travel,
)
from rotary_error_monitor.description.sections import Place, Section

Vector = tuple[float, float, float]
Component = Annotated[float, Expected("a component of a unit vector", -1, 1)]
Expansion = Annotated[float, Expected("a coefficient of thermal expansion in 1/K, about 1.0e-05", -0.001, 0.001)]

Length = Annotated[float, Expected("a length in m, at most 100 m", -100, 100)]
Turn = Annotated[float, Expected("an angle in rad, at most pi", -HALF_TURN, HALF_TURN)]

LONGEST = 100.0
"""Travel of a linear axis either way, m: of the longest gantries."""

ZERO: Vector = (0.0, 0.0, 0.0)

UNIT_LENGTH = 1e-9
"""How far the direction of an axis may be from a unit vector, as nine digits in a file leave it; a component of less is
none."""


@dataclass(frozen=True)
class Displacement:
    """Shift (m), then rotation by a rotation vector (rad): `p -> shift + Rot(rotation) p`.

    What a file may state is that of a location error.
    """

    shift: Displacements = ZERO
    rotation: Tilts = ZERO

    def plus(self, other: Displacement) -> Displacement:
        """Sum component by component: both as small errors, or one of them zero."""
        return Displacement(_sum(self.shift, other.shift), _sum(self.rotation, other.rotation))


@dataclass(frozen=True)
class Harmonic:
    """One wave of an error component: `cos * cos(order * q) + sin * sin(order * q)` in m or rad."""

    order: Annotated[float, Expected("waves per revolution, or rad per m (2 pi / period) of a linear axis", 0, 1e6)]
    cos: Deviation
    sin: Deviation


@dataclass(frozen=True)
class ErrorTable:
    """Error at rising axis `positions` for travel in `forward` (+) and `backward` (-) direction, linear between."""

    positions: tuple[float, ...]
    forward: tuple[float, ...]
    backward: tuple[float, ...]


@dataclass(frozen=True)
class Smooth:
    """Sum of a polynomial and of waves in the position."""

    poly: Annotated[
        tuple[Deviation, ...],
        Expected("[c0, c1, …] of c0 + c1*u + …, travel scaled to u = -1 … 1", count=(1, math.inf)),
    ] = ()
    harmonic: Annotated[
        tuple[Harmonic, ...], Expected("rows {order, cos, sin}: cos*cos(order*q) + sin*sin(order*q)")
    ] = ()


@dataclass(frozen=True)
class ErrorComponent(Smooth):
    """One error component of an axis: with a table of measured values, which is added."""

    table: ErrorTable | None = None


@dataclass(frozen=True)
class Axis(Section):
    """One axis of motion; positions in m (linear) or rad (rotary).

    Attributes:
        letter: its name, such as X.
        direction: along or about which it moves, in the frame of its body.
        expansion: of its scale: adds `expansion * dT * q` to its positioning error.
        reversal: width of its reversal error (ISO 230-2, B): half of it is missing in the direction of travel.
        repeatability: of its positioning (ISO 230-2, R: four standard deviations); scatter, no part of the errors.
    """

    letter: Annotated[Letter, Key]
    kind: Annotated[Literal["linear", "rotary"], Expected("linear or rotary")]
    direction: Annotated[
        tuple[Component, Component, Component], Expected("unit vector along which or about which the axis moves")
    ]
    travel: Travel
    expansion: Expansion = 0.0
    reversal: Annotated[Deviation, Expected("reversal error in m or rad, at most 10 mm or 10 mrad")] = 0.0
    repeatability: Annotated[
        float | None, Expected("repeatability R of positioning in m or rad, at most 10 mm or 10 mrad", 0, 0.01)
    ] = None
    speed: Annotated[
        float | None,
        Expected("fastest motion in m/s or rad/s; joint states that are faster are not believed", above=0, most=1e4),
    ] = None
    acceleration: Annotated[
        float | None,
        Expected("largest acceleration in m/s² or rad/s²; joint states that jump are not believed", above=0, most=1e6),
    ] = None

    @property
    def shown(self) -> tuple[float, str]:
        """How tables have its positions: how many mm or degrees are in one m or rad, and `mm` or `deg`."""
        return (1e3, "mm") if self.kind == "linear" else (180 / math.pi, "deg")

    @property
    def fastest(self) -> float:
        """Speed that it does not exceed, as stated or else as the fastest machines reach, m/s or rad/s."""
        return FASTEST[self.kind] if self.speed is None else self.speed

    @property
    def quickest(self) -> float:
        """Acceleration that it does not exceed, m/s² or rad/s²."""
        return QUICKEST[self.kind] if self.acceleration is None else self.acceleration

    @property
    def home(self) -> float:
        """Where it stands while nothing names it: at 0, or at the end of its travel that is nearest to 0, m or rad."""
        low, high = self.travel
        return min(max(0.0, low), high)

    @property
    def positioning_shares(self) -> dict[str, float]:
        """Which share of its positioning error is in which error component, by name: those of its direction."""
        letters = "XYZ" if self.kind == "linear" else "ABC"
        return {
            f"E{each}{self.letter}": share
            for each, share in zip(letters, self.direction, strict=True)
            if abs(share) > UNIT_LENGTH
        }

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """A travel that does not rise or is none of a machine, or a direction that is no unit vector."""
        if problem := wrong_travel(self.kind, self.travel):
            yield ("travel",), problem
        length = math.hypot(*self.direction)
        if abs(length - 1.0) > UNIT_LENGTH:
            yield ("direction",), f"{list(self.direction)} has length {length:.9g}; expected a unit vector"


@dataclass(frozen=True)
class Body:
    """One body of the tree.

    Attributes:
        name: its name.
        parent: name of the body that carries it, `base` for the base.
        pose: where it stands on its parent at axis position zero (Tp of Pan et al. 2013, Equation 9).
        location_error: how it stands otherwise than that (ΔTp), squareness errors included.
        axis: letter of the axis that moves it; none for a fixed body.
    """

    name: str
    parent: str
    pose: Displacement = Displacement()
    location_error: Displacement = Displacement()
    axis: str | None = None


@dataclass(frozen=True)
class PoseSection:
    """Where a body stands on its parent."""

    position: Annotated[tuple[Length, Length, Length], Expected("[x, y, z] in m")] = ZERO
    rotation: Annotated[tuple[Turn, Turn, Turn], Expected("a rotation vector in rad")] = ZERO


@dataclass(frozen=True)
class BodySection:
    """A body of the tree; squareness: angles to other axes less 90 degrees, by their letters."""

    name: Name
    parent: Name
    pose: PoseSection = field(default_factory=PoseSection)
    location_error: Displacement = field(default_factory=Displacement)
    axis: Letter | None = None
    squareness: Annotated[
        Mapping[Letter, Tilt], Expected("angle to another axis less 90 degrees in rad, by the letter of that axis")
    ] = field(default_factory=dict)

    def whole_location_error(self, axes: Mapping[str, Axis]) -> Displacement:
        """Location error with what the squareness to other axes adds to it."""
        whole = self.location_error
        for letter, angle in self.squareness.items():
            # Turning this axis about the common normal by +a brings it nearer to the other, so the angle shrinks by a.
            x, y, z = _cross(axes[self.axis or ""].direction, axes[letter].direction)
            whole = whole.plus(Displacement(rotation=(-angle * x, -angle * y, -angle * z)))
        return whole


def wrong_travel(kind: str, travel: tuple[float, float]) -> str | None:
    """What is wrong with a travel whose end is not above its beginning, or that is none of a machine."""
    low, high = travel
    if low >= high:
        return f"[{low}, {high}] is no travel; expected the lowest position first"
    if kind == "linear" and max(abs(low), abs(high)) > LONGEST:
        return f"[{low}, {high}] m is no travel; expected at most {LONGEST:g} m either way, in m and not in mm"
    return None


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
