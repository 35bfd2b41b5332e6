"""Autocollimator and reference in a stage file: instruments of two axes, and how they answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.quantities import (
    CrossCoupling,
    Cubic,
    DisplacementPair,
    Gain,
    GainDifference,
    Height,
    Latency,
    Noise,
    Range,
    Reading,
    Resolution,
    Roll,
)
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.sections import Place, narrowed, stated

RESPONSES = ("gain", "roll", "zero")
"""What may be uncertain of how an instrument of two axes answers."""

DISTORTIONS = ("gain_difference", "cross_coupling", "cubic")
"""And of an autocollimator besides."""


@dataclass(frozen=True)
class Turbulence:
    """Slow part of the autocollimator's noise."""

    std: Annotated[Noise, Expected("standard deviation of the slow part of the noise in rad")]
    correlation_time: Annotated[float, Expected("correlation time of the slow part in s", above=0, most=3600)]


@dataclass(frozen=True)
class Autocollimator:
    """Autocollimator: measuring range ±`range`, `resolution` and `noise` (standard deviation), rad.

    All three are of readings over the absolute gain: what they are in rad of tilt.
    """

    range: Annotated[Range, Expected("half of the measuring range in rad")]
    resolution: Annotated[Resolution, Expected("step of a reading in rad")]
    noise: Annotated[Noise, Expected("standard deviation of one reading in rad")]
    turbulence: Turbulence | None = None


@dataclass(frozen=True)
class RadialReference:
    """Displacement sensor of two axes: height above the ring, noise, eccentricity of its artefact on the rotor."""

    height: Annotated[Height, Expected("height of the artefact above the ring in m")]
    noise: Annotated[Noise, Expected("standard deviation of one reading in m")]
    artefact_eccentricity: DisplacementPair = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class TwoAxisSection:
    """How an instrument of two axes answers; what is left out has the default of `Response`."""

    gain: Gain | None = None
    roll: Roll | None = None
    latency: Latency | None = None
    zero: tuple[Reading, Reading] | None = None

    @property
    def response(self) -> Response:
        """Of the instrument."""
        return replace(Response((0.0, 0.0)), **stated(narrowed(TwoAxisSection, self)))


@dataclass(frozen=True, kw_only=True)
class AutocollimatorSection(TwoAxisSection, Autocollimator):
    """The autocollimator and how it answers."""

    zero: Annotated[
        tuple[Reading, Reading] | None, Expected("reading [x, y] of a mirror without tilt in rad, each at most 0.1 rad")
    ] = None
    gain_difference: GainDifference | None = None
    cross_coupling: CrossCoupling | None = None
    cubic: Annotated[
        tuple[Cubic, Cubic] | None,
        Expected("[x, y] in 1/rad^2 by which a reading grows with the square of the tilt, each at most 1e9"),
    ] = None

    @property
    def response(self) -> Response:
        """Of the instrument; a cubic term of 0 is none."""
        distortion = replace(super().response, **{n: v for n in DISTORTIONS if (v := getattr(self, n)) is not None})
        return distortion if any(distortion.cubic) else replace(distortion, cubic=())


@dataclass(frozen=True, kw_only=True)
class RadialReferenceSection(TwoAxisSection, RadialReference):
    """The reference and how it answers."""

    zero: Annotated[
        tuple[Reading, Reading] | None, Expected("reading [x, y] of a perfect axis in m, each at most 100 mm")
    ] = None


def two_axis_rows(response: Response) -> dict[str, Any]:
    """Fields of `TwoAxisSection`, and those of a distortion that there is; none of an ideal response."""
    if response.is_ideal:
        return {}
    rows = stated(response)
    return {name: rows[name] for name in rows if name not in DISTORTIONS or np.any(rows[name])}


def folded(section: AutocollimatorSection) -> Iterator[tuple[Place, str]]:
    """Where a cubic term is so negative that a reading within the range is that of two tilts."""
    response = section.response
    for axis, zero in enumerate(response.zero):
        most = section.range + abs(zero / response.gain)
        if response.rises_to(axis) < most:
            yield (
                ("autocollimator", "cubic", axis),
                f"{response.cubic[axis]:g} lets readings fall again before they are {most:g} rad from the zero, the "
                f"end of the range; expected {-4 / (27 * most**2):.3g} 1/rad^2 or more, or a smaller range",
            )
