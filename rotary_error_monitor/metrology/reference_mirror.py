"""A reference mirror, readings along its placements, and what may be assumed of its form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.straightness import check_profile

MIRROR_ORDERS = range(2, 7)
"""Legendre orders of the mirror's unknown form; orders 0 and 1 are its placement."""

TURNED_ORDERS = range(2, 13)
"""The same where a turned placement shows the form, so that finer detail can be told."""

MIRROR_RANGE = 3.8
"""Mean peak-to-valley of a sum of those Legendre polynomials with coefficients of standard deviation 1."""

ANY_RANGE = 1e-3
"""Range allowed to the form of a mirror that a turned placement shows whatever it is, m."""

FORM_POINTS = 101
"""Points at which a mirror's form is given: 8 a wave of the highest order."""


@dataclass(frozen=True)
class ReferenceMirror:
    """Reference mirror, the same for all segments.

    Attributes:
        length: m.
        flatness: peak-to-valley of its form error along the line of measurement, m, beyond `profile`; None if unknown.
        profile: (k, 2) calibrated form, distance from the mirror's start and height, m; None if there is none.
    """

    length: float
    flatness: float | None
    profile: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class PlacementReadings:
    """Readings along one placement of the mirror.

    Attributes:
        positions: (n,) axis positions, m, in any order.
        readings: (n,) displacement readings, m.
        noise: standard deviation of a reading, or (n,) of each, m.
        start: axis position where the mirror begins, m; None for the first sample.
        turned: the mirror is turned over about its long axis, so that its form counts the other way; readings keep
            their sign as the axis goes (those of a sensor that now looks the other way are negated).
    """

    positions: NDArray[np.float64]
    readings: NDArray[np.float64]
    noise: float | NDArray[np.float64]
    start: float | None = None
    turned: bool = False


@dataclass(frozen=True)
class PlacedSegment:
    """A segment made ready: ascending, the known form of the mirror removed, `along` the mirror from -1 to 1.

    `side` is +1, or -1 where the mirror is turned over.
    """

    positions: NDArray[np.float64]
    heights: NDArray[np.float64]
    along: NDArray[np.float64]
    noise: NDArray[np.float64]
    side: float


@dataclass(frozen=True)
class MirrorForm:
    """Form of a mirror as its placements show it, its calibrated profile included.

    Attributes:
        distances: (k,) from the mirror's start, m.
        heights: (k,) about their least squares line, m.
        covariance: (k, k) of `heights`, m².
        unseen: standard uncertainty of the curvature (Legendre order 2) over what it was before: 1 where nothing
            shows it.
    """

    distances: NDArray[np.float64]
    heights: NDArray[np.float64]
    covariance: NDArray[np.float64]
    unseen: float

    @property
    def flatness(self) -> float:
        """Range of the heights, m."""
        return float(np.ptp(self.heights))


def place_segment(segment: PlacementReadings, mirror: ReferenceMirror | None, number: int) -> PlacedSegment:
    """A segment made ready; `number` counts it from 0, for messages. Without a mirror, the readings as they are.

    Raises:
        InputError: readings that make no profile or are without noise, or a sample beyond the mirror or its profile.
    """
    check_profile(segment.positions, segment.readings)
    order = np.argsort(segment.positions, kind="stable")
    positions, heights = segment.positions[order], segment.readings[order]
    noise = np.broadcast_to(segment.noise, positions.shape)[order]
    if not np.all(noise > 0):
        raise InputError(
            f"segment {number + 1}: noise {noise.min():g} m; give the standard deviation of a reading, above 0"
        )
    if mirror is None:
        return PlacedSegment(positions, heights, np.zeros_like(positions), noise, 1.0)
    start = float(positions[0]) if segment.start is None else segment.start
    distance = positions - start
    slack = 1e-6 * mirror.length
    if distance[0] < -slack or distance[-1] > mirror.length + slack:
        raise InputError(
            f"segment {number + 1} runs from {positions[0] * 1e3:g} mm to {positions[-1] * 1e3:g} mm, beyond the "
            f"mirror of {mirror.length * 1e3:g} mm that begins at {start * 1e3:g} mm"
        )
    side = -1.0 if segment.turned else 1.0
    if mirror.profile is not None:
        first, last = float(mirror.profile[0, 0]), float(mirror.profile[-1, 0])
        if distance[0] < first - slack or distance[-1] > last + slack:
            raise InputError(
                f"segment {number + 1} uses the mirror from {distance[0] * 1e3:g} mm to {distance[-1] * 1e3:g} mm, "
                f"but its form is calibrated from {first * 1e3:g} mm to {last * 1e3:g} mm"
            )
        heights = heights - side * np.interp(distance, mirror.profile[:, 0], mirror.profile[:, 1])
    return PlacedSegment(positions, heights, 2 * distance / mirror.length - 1, noise, side)


def check_direct(segments: Sequence[PlacementReadings]) -> None:
    """Hold that readings without a mirror need none.

    Raises:
        InputError: several segments, or one along a mirror that was turned over.
    """
    if len(segments) > 1:
        raise InputError(
            f"{len(segments)} segments, and no mirror: pieces are spliced along a mirror that is put down anew, whose "
            "length and flatness are needed; a straightness interferometer measures the whole axis as one segment"
        )
    if any(segment.turned for segment in segments):
        raise InputError("a mirror turned over, and no mirror: its length and flatness are needed")


@dataclass(frozen=True)
class FormPrior:
    """What may be assumed of the mirror's form: how many Legendre orders from 2 on, and their range, m."""

    orders: int
    range: float


def form_prior(parts: Sequence[PlacedSegment], mirror: ReferenceMirror | None) -> FormPrior | None:
    """None where there is no mirror, or nothing is known of its form and no turned placement shows it."""
    if mirror is None:
        return None
    if len({part.side for part in parts}) == 2:
        return FormPrior(len(TURNED_ORDERS), mirror.flatness or ANY_RANGE)
    return None if mirror.flatness is None else FormPrior(len(MIRROR_ORDERS), max(mirror.flatness, 1e-12))


def form_columns(part: PlacedSegment, orders: int) -> NDArray[np.float64]:
    """(n, orders) Legendre polynomials of the mirror's form, as it lies in a placement."""
    return part.side * _polynomials(part.along, orders)


def mirror_form(
    parts: Sequence[PlacedSegment],
    mirror: ReferenceMirror,
    coefficients: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> MirrorForm | None:
    """Form of Legendre coefficients (orders,) m with their covariance, m²; None where no two placements tell it.

    It is told where samples of any placement are.
    """
    prior = form_prior(parts, mirror)
    if prior is None or len(parts) < 2:
        return None
    along = np.concatenate([part.along for part in parts])
    u = np.linspace(along.min(), along.max(), FORM_POINTS)
    distances = (u + 1) * mirror.length / 2
    design = _polynomials(u, prior.orders)
    heights = design @ coefficients
    if mirror.profile is not None:
        heights = heights + np.interp(distances, mirror.profile[:, 0], mirror.profile[:, 1])
    line = legendre.legvander(u, 1)
    level = np.eye(u.size) - line @ np.linalg.pinv(line)
    unseen = float(np.sqrt(covariance[0, 0])) * MIRROR_RANGE / prior.range
    spread = level @ design @ covariance @ design.T @ level.T
    return MirrorForm(distances, level @ heights, spread, unseen)


def _polynomials(along: NDArray[np.float64], orders: int) -> NDArray[np.float64]:
    vandermonde = legendre.legvander(along, MIRROR_ORDERS[0] + orders - 1)
    return np.asarray(vandermonde[:, MIRROR_ORDERS[0] :], dtype=np.float64)
