"""Rows of harmonics over a rotation, as stage descriptions hold them."""

from __future__ import annotations

from dataclasses import dataclass


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
