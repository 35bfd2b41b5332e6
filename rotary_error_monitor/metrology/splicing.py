"""Straightness of a guideway longer than the reference mirror: segments that overlap, spliced by least squares.

Zhou et al. 2023, Section 2.1, fit a rotation and a shift to one overlap. Their Equation 1 prints both sines with the
same sign; a rotation has [[cos, -sin], [sin, cos]]. At the microradians between two mirror placements it is a change of
slope and of height, so all placements, the profile and the mirror's form are unknowns of one linear least squares.

The mirror's form is common to all placements while the guideway's is not, so overlaps show it, but for its curvature:
a curved mirror looks like a curved guideway in every placement. A placement measured a second time with the mirror
turned over about its long axis (straightedge reversal) shows the curvature as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.overlaps import Overlap, Residual, compare_overlaps, overlap_warnings
from rotary_error_monitor.metrology.reference_mirror import (
    MIRROR_RANGE,
    MirrorForm,
    PlacedSegment,
    PlacementReadings,
    ReferenceMirror,
    check_direct,
    form_columns,
    form_prior,
    mirror_form,
    place_segment,
)
from rotary_error_monitor.metrology.scans import DEGREE, gap_between, knots_of, upper_band
from rotary_error_monitor.metrology.straightness import LineMethod, Straightness, estimate_straightness

DETAIL = 1e-3
"""Probability that noise alone is taken for detail that the spline's nodes are too far apart for."""

LARGEST_STEP = 5.0
"""Times the median step up to which samples are unevenly spaced; a longer one is a gap."""

FEWEST_POSITIONS = 500
"""Intervals in which a profile is given at least: the line of least squares through its points, of which those at the
ends count whole, then is that of the curve to a thousandth (of 100 intervals, to half a percent)."""


@dataclass(frozen=True)
class SplicedProfile:
    """A profile over the whole axis, in the frame of the first segment.

    Attributes:
        positions: (n,) m, evenly spaced, the nodes of the spline among them.
        nodes: (m,) of the spline, m.
        profile: (n,) m.
        covariance: (n, n) m², of sensor noise and of what is unknown of the mirror.
        slopes, offsets: (k,) how each segment lies in the first one's frame, rad and m.
        overlaps: evidence, overlap by overlap.
        warnings: what a user should know, in words.
        mirror: its form as several placements show it; None where they do not.
        square: sum of squares of all that is left over its noise, and of the mirror's form over what was assumed of it:
            -2 times the logarithm of how probable the readings are, up to what other placements share.
    """

    positions: Array
    nodes: Array
    profile: Array
    covariance: Array
    slopes: Array
    offsets: Array
    overlaps: tuple[Overlap, ...]
    warnings: tuple[str, ...]
    mirror: MirrorForm | None = None
    square: float = 0.0

    def straightness(self, method: LineMethod = "least_squares") -> Straightness:
        """Straightness of the whole axis."""
        return estimate_straightness(self.positions, self.profile, method)

    def deviation_covariance(self) -> Array:
        """(n, n) covariance of the deviations from the least squares line, m²: slope and height of all drop out."""
        x = self.positions - self.positions.mean()
        basis = np.column_stack([np.full_like(x, x.size**-0.5), x / np.linalg.norm(x)])
        left = self.covariance - basis @ (basis.T @ self.covariance)
        return cast("Array", left - (left @ basis) @ basis.T)


def splice_segments(
    segments: Sequence[PlacementReadings], mirror: ReferenceMirror | None, *, spacing: float | None = None
) -> SplicedProfile:
    """Profile of a guideway from overlapping segments, all overlaps at once; from one alone where there is no mirror.

    The profile is a cubic spline with knots every `spacing` m (by default twice the sample spacing, at most 1000
    knots), each segment after the first lies at an unknown slope and height, and the mirror adds a form of low Legendre
    orders that is the same in every placement and as large as its flatness allows. All are estimated together, so that
    samples need not share positions, and the mirror is calibrated as far as the overlaps can: in all but its curvature,
    and in that as well where a placement is measured both ways up.

    Raises:
        InputError: segments that do not meet, a gap, a sample beyond the mirror, or a mirror of unknown flatness whose
            form shows in the overlaps; without a mirror, more than one segment.
    """
    if mirror is None:
        check_direct(segments)
    ordered = sorted(range(len(segments)), key=lambda k: float(segments[k].positions.min(initial=np.inf)))
    parts = [place_segment(segments[k], mirror, k) for k in ordered]
    _check_meeting(parts, ordered)
    solution = _solve(parts, mirror, _knots(parts, spacing))
    if spacing is None and _shows_detail(parts, solution):
        solution = _solve(parts, mirror, _fine_knots(parts), _roughness(parts))
    residuals = [Residual(p.positions, _residual(p, k, solution), p.noise) for k, p in enumerate(parts)]
    breaks = solution.spline.t[DEGREE : len(solution.spline.t) - DEGREE]
    overlaps = () if mirror is None else compare_overlaps(residuals, ordered, mirror.length, breaks)
    unknown = mirror is not None and form_prior(parts, mirror) is None
    warnings = overlap_warnings(overlaps, unknown=unknown)
    order = np.argsort(ordered)
    return SplicedProfile(
        positions=solution.positions,
        nodes=breaks,
        profile=solution.profile,
        covariance=solution.covariance,
        slopes=solution.slopes[order],
        offsets=solution.offsets[order],
        overlaps=overlaps,
        warnings=warnings,
        mirror=None if mirror is None else mirror_form(parts, mirror, solution.form, solution.form_covariance),
        square=_square_left(residuals, solution, mirror, parts),
    )


def _square_left(
    residuals: Sequence[Residual], solution: _Solution, mirror: ReferenceMirror | None, parts: Sequence[PlacedSegment]
) -> float:
    """Sum of squares of residuals over their noise, and of the form's coefficients over what was assumed of them."""
    square = sum(float(((each.values / each.noise) ** 2).sum()) for each in residuals)
    form = form_prior(parts, mirror)
    if form is not None:
        square += float(solution.form @ solution.form) * (MIRROR_RANGE / form.range) ** 2
    return square


@dataclass(frozen=True)
class _Solution:
    positions: Array
    profile: Array
    covariance: Array
    slopes: Array
    offsets: Array
    form: Array
    form_covariance: Array
    spline: BSpline


def _check_meeting(parts: Sequence[PlacedSegment], ordered: Sequence[int]) -> None:
    if not parts:
        raise InputError("no segment; give at least one")
    end = float(parts[0].positions[-1])
    for part, number in zip(parts[1:], ordered[1:], strict=True):
        start = float(part.positions[0])
        shared = int((part.positions <= end).sum())
        if shared < 3:
            raise InputError(
                f"segment {number + 1} begins at {start * 1e3:g} mm and those before it end at {end * 1e3:g} mm: they "
                f"share {shared} sample(s), a slope and a height need three at least; let the placements overlap"
            )
        end = max(end, float(part.positions[-1]))


def _knots(parts: Sequence[PlacedSegment], spacing: float | None) -> Array:
    first = min(float(part.positions[0]) for part in parts)
    last = max(float(part.positions[-1]) for part in parts)
    samples = np.concatenate([part.positions for part in parts])
    if spacing is None:
        usual = max(float(np.median(np.diff(part.positions))) for part in parts)
        longest = float(np.diff(np.sort(samples)).max())
        spacing = max(2 * usual, (last - first) / 1000)
        if 1 < longest / spacing <= LARGEST_STEP / 2:  # so few nodes that each two have a sample between them
            spacing = (last - first) / max(1, math.floor((last - first) / longest))
    breaks = np.linspace(first, last, max(2, round((last - first) / spacing) + 1))
    if empty := gap_between(breaks, samples):
        raise InputError(f"no sample {empty}; measure without the gap or widen the spacing")
    return knots_of(breaks)


def _shows_detail(parts: Sequence[PlacedSegment], solution: _Solution) -> bool:
    """Whether readings depart from the spline by more than their noise: the profile is finer than its nodes."""
    square = sum(float(((_residual(part, k, solution) / part.noise) ** 2).sum()) for k, part in enumerate(parts))
    readings = sum(part.positions.size for part in parts)
    unknowns = len(solution.spline.c) + 2 * (len(parts) - 1)
    return readings > unknowns and chi_square_tail(square, readings - unknowns) < DETAIL


def _fine_knots(parts: Sequence[PlacedSegment]) -> Array:
    """A node for each reading of the placement that has fewest."""
    first = min(float(part.positions[0]) for part in parts)
    last = max(float(part.positions[-1]) for part in parts)
    spacing = max(max(float(np.median(np.diff(part.positions))) for part in parts), (last - first) / 1000)
    return knots_of(np.linspace(first, last, max(2, round((last - first) / spacing) + 1)))


def _roughness(parts: Sequence[PlacedSegment]) -> float:
    """Root mean square of the readings' third differences, m: how much a spline through all of them may bend."""
    third = np.concatenate([np.diff(part.heights, 3) for part in parts if part.positions.size > DEGREE])
    return float(np.sqrt(np.mean(third**2))) if third.size else 0.0


def _solve(
    parts: Sequence[PlacedSegment], mirror: ReferenceMirror | None, knots: Array, roughness: float = 0.0
) -> _Solution:
    """Spline, placements and mirror form: the spline's banded block is eliminated, the small rest is solved dense.

    Where the spline has a node for each reading, its third differences are taken to be about `roughness`, m, which
    bridges nodes without a reading of their own.
    """
    samples = np.concatenate([part.positions for part in parts])
    heights = np.concatenate([part.heights for part in parts])
    weights = np.concatenate([1 / part.noise for part in parts])
    middle = float(samples.mean())
    design = csr_array(BSpline.design_matrix(samples, knots, DEGREE)).multiply(weights[:, None]).tocsr()
    form = form_prior(parts, mirror)
    rest = _placement_columns(parts, middle, 0 if form is None else form.orders) * weights[:, None]
    target = heights * weights
    count = 2 * (len(parts) - 1)
    prior = np.zeros(rest.shape[1])
    if form is not None:
        prior[count:] = (MIRROR_RANGE / form.range) ** 2

    try:
        factor = _factor(design, roughness)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"the readings do not determine the curve between {samples.min() * 1e3:g} and {samples.max() * 1e3:g} mm: "
            "a part of it has none; measure there as well"
        ) from error
    cross = np.asarray(design.T @ rest)
    gain = cho_solve_banded((factor, False), cross)
    rhs = np.asarray(design.T @ target)
    alone = cho_solve_banded((factor, False), rhs)
    schur = rest.T @ rest + np.diag(prior) - cross.T @ gain
    inverse = cho_solve(cho_factor(schur), np.eye(len(schur))) if schur.size else np.zeros((0, 0))
    placed = inverse @ (rest.T @ target - cross.T @ alone)
    coefficients = alone - gain @ placed

    intervals = len(knots) - 2 * DEGREE - 1
    positions = np.linspace(knots[0], knots[-1], intervals * math.ceil(FEWEST_POSITIONS / intervals) + 1)
    basis = csr_array(BSpline.design_matrix(positions, knots, DEGREE))
    through = basis @ gain
    covariance = basis @ cho_solve_banded((factor, False), basis.T.toarray()) + through @ inverse @ through.T
    slopes = np.concatenate([[0.0], placed[0:count:2]])
    # Columns are centred on `middle` for a good condition; offsets are told at axis position 0.
    offsets = np.concatenate([[0.0], placed[1:count:2]]) - slopes * middle
    spline = BSpline(knots, coefficients, DEGREE)
    form_covariance = np.asarray(inverse[count:, count:])
    return _Solution(
        positions, basis @ coefficients, covariance, slopes, offsets, placed[count:], form_covariance, spline
    )


def _factor(design: csr_array, roughness: float) -> Array:
    """Banded factor by Cholesky of the spline's normal matrix.

    Raises:
        LinAlgError: the matrix is singular.
    """
    normal = csr_array(design.T @ design)
    if roughness > 0:
        third = csr_array(np.diff(np.eye(design.shape[1]), DEGREE, axis=0)) / roughness
        normal = csr_array(normal + third.T @ third)
    return np.asarray(cholesky_banded(upper_band(normal)), np.float64)


def _placement_columns(parts: Sequence[PlacedSegment], middle: float, orders: int) -> Array:
    rows = []
    for number, part in enumerate(parts):
        block = np.zeros((part.positions.size, 2 * (len(parts) - 1)))
        if number:
            block[:, 2 * number - 2] = part.positions - middle
            block[:, 2 * number - 1] = 1.0
        rows.append(np.column_stack([block, form_columns(part, orders)]))
    return np.concatenate(rows)


def _residual(part: PlacedSegment, number: int, solution: _Solution) -> Array:
    """Readings minus all that the solution knows: profile, placement and mirror form."""
    placed = solution.slopes[number] * part.positions + solution.offsets[number]
    form = form_columns(part, len(solution.form)) @ solution.form
    return cast("Array", part.heights - solution.spline(part.positions) - placed - form)
