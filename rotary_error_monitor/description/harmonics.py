"""Rows of harmonics over a rotation, as stage descriptions hold them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class AngularHarmonic:
    """One order of an error over an angle: `cos * cos(order * psi) + sin * sin(order * psi)` in rad or m."""

    order: int
    cos: float
    sin: float


@dataclass(frozen=True)
class PlanarHarmonic:
    """One order of a plane vector over the rotation, x and y each `[cos, sin]` coefficients in m or rad."""

    order: int
    x: tuple[float, float]
    y: tuple[float, float]


def angular(rows: Iterable[Mapping[str, Any]]) -> tuple[AngularHarmonic, ...]:
    """Harmonics from the rows of a file that is valid by the schema."""
    return tuple(AngularHarmonic(row["order"], float(row["cos"]), float(row["sin"])) for row in rows)


def planar(rows: Iterable[Mapping[str, Any]]) -> tuple[PlanarHarmonic, ...]:
    """Plane harmonics from the rows of a file that is valid by the schema."""
    return tuple(PlanarHarmonic(row["order"], pair(row["x"]), pair(row["y"])) for row in rows)


def pair(values: Iterable[float]) -> tuple[float, float]:
    """The two numbers of a vector in a file."""
    x, y = values
    return float(x), float(y)
