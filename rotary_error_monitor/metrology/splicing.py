"""Straightness of a guideway longer than the reference mirror: segments that overlap, spliced by least squares.

Zhou et al. 2023, Section 2.1, fit a rotation and a shift to one overlap. Their Equation 1 prints both sines with the
same sign; a rotation has [[cos, -sin], [sin, cos]]. At the microradians between two mirror placements it is a change of
slope and of height, so all placements, the profile and the mirror's form are unknowns of one linear least squares.

The mirror's form is common to all placements while the guideway's is not, so overlaps show it, but for its curvature:
a curved mirror looks like a curved guideway in every placement. A placement measured a second time with the mirror
turned over about its long axis (straightedge reversal) shows the curvature as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array
from scipy.stats import chi2

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.straightness import LineMethod, Straightness, check_profile, estimate_straightness

LEAST_OVERLAP = 0.15
"""Share of the mirror's length that two placements should share (Zhou et al. 2023, Section 2.1)."""

MIRROR_ORDERS = range(2, 7)
"""Legendre orders of the mirror's unknown form; orders 0 and 1 are its placement."""

TURNED_ORDERS = range(2, 13)
"""The same where a turned placement shows the form, so that finer detail can be told."""

MIRROR_RANGE = 3.8
"""Mean peak-to-valley of a sum of those Legendre polynomials with coefficients of standard deviation 1."""

DISAGREEMENT = 1e-3
"""Probability below which segments are said to disagree in an overlap, where the mirror's flatness is stated."""

UNKNOWN_DISAGREEMENT = 0.01
"""The same for a mirror of unknown flatness: an overlap shows only a part of its form, so suspicion comes earlier."""

ANY_RANGE = 1e-3
"""Range allowed to the form of a mirror that a turned placement shows whatever it is, m."""

DEGREE = 3


@dataclass(frozen=True)
class Mirror:
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
class Segment:
    """Readings along one placement of the mirror.

    Attributes:
        positions: (n,) axis positions, m, in any order.
        readings: (n,) displacement readings, m.
        noise: standard deviation of a reading, m.
        start: axis position where the mirror begins, m; None for the first sample.
        turned: the mirror is turned over about its long axis, so that its form counts the other way; readings keep
            their sign as the axis goes (those of a sensor that now looks the other way are negated).
    """

    positions: NDArray[np.float64]
    readings: NDArray[np.float64]
    noise: float
    start: float | None = None
    turned: bool = False


@dataclass(frozen=True)
class Overlap:
    """Evidence in one overlap.

    Attributes:
        segments: indices of the two segments.
        first, last: the overlap on the axis, m.
        share: its length over that of the mirror.
        difference: root mean square difference of the two, averaged in cells, after splicing, m.
        expected: the same as the readings' noise explains it, m.
        probability: of so large a difference by that noise.
    """

    segments: tuple[int, int]
    first: float
    last: float
    share: float
    difference: float
    expected: float
    probability: float


@dataclass(frozen=True)
class SplicedProfile:
    """A profile over the whole axis, in the frame of the first segment.

    Attributes:
        positions: (n,) m.
        profile: (n,) m.
        covariance: (n, n) m², of sensor noise and of what is unknown of the mirror.
        slopes, offsets: (k,) how each segment lies in the first one's frame, rad and m.
        overlaps: evidence, overlap by overlap.
        warnings: what a user should know, in words.
    """

    positions: NDArray[np.float64]
    profile: NDArray[np.float64]
    covariance: NDArray[np.float64]
    slopes: NDArray[np.float64]
    offsets: NDArray[np.float64]
    overlaps: tuple[Overlap, ...]
    warnings: tuple[str, ...]

    @property
    def standard_uncertainty(self) -> NDArray[np.float64]:
        """(n,) standard uncertainty along the axis, relative to the first segment, m; it grows with every joint."""
        return cast("NDArray[np.float64]", np.sqrt(np.diag(self.covariance)))

    def straightness(self, method: LineMethod = "least_squares") -> Straightness:
        """Straightness of the whole axis."""
        return estimate_straightness(self.positions, self.profile, method)

    def deviation_covariance(self) -> NDArray[np.float64]:
        """(n, n) covariance of the deviations from the least squares line, m²: slope and height of all drop out."""
        x = self.positions - self.positions.mean()
        basis = np.column_stack([np.full_like(x, x.size**-0.5), x / np.linalg.norm(x)])
        project = np.eye(x.size) - basis @ basis.T
        return cast("NDArray[np.float64]", project @ self.covariance @ project)


def splice_segments(segments: Sequence[Segment], mirror: Mirror, *, spacing: float | None = None) -> SplicedProfile:
    """Profile of a guideway from overlapping segments, all overlaps at once.

    The profile is a cubic spline with knots every `spacing` m (by default twice the sample spacing, at most 1000
    knots), each segment after the first lies at an unknown slope and height, and the mirror adds a form of low Legendre
    orders that is the same in every placement and as large as its flatness allows. All are estimated together, so that
    samples need not share positions, and the mirror is calibrated as far as the overlaps can: in all but its curvature,
    and in that as well where a placement is measured both ways up.

    Raises:
        InputError: segments that do not meet, a gap, a sample beyond the mirror, or a mirror of unknown flatness whose
            form shows in the overlaps.
    """
    ordered = sorted(range(len(segments)), key=lambda k: float(segments[k].positions.min(initial=np.inf)))
    parts = [_levelled(segments[k], mirror, k) for k in ordered]
    _check_meeting(parts, ordered)
    knots = _knots(parts, spacing)
    solution = _solve(parts, mirror, knots)
    overlaps = _overlaps(parts, ordered, mirror, solution)
    warnings = _warnings(overlaps, unknown=_form_prior(parts, mirror) is None)
    order = np.argsort(ordered)
    return SplicedProfile(
        positions=solution.positions,
        profile=solution.profile,
        covariance=solution.covariance,
        slopes=solution.slopes[order],
        offsets=solution.offsets[order],
        overlaps=overlaps,
        warnings=warnings,
    )


@dataclass(frozen=True)
class _Part:
    """A segment made ready: ascending, the known form of the mirror removed, `along` the mirror from -1 to 1.

    `side` is +1, or -1 where the mirror is turned over.
    """

    positions: NDArray[np.float64]
    heights: NDArray[np.float64]
    along: NDArray[np.float64]
    noise: float
    side: float


@dataclass(frozen=True)
class _Solution:
    positions: NDArray[np.float64]
    profile: NDArray[np.float64]
    covariance: NDArray[np.float64]
    slopes: NDArray[np.float64]
    offsets: NDArray[np.float64]
    form: NDArray[np.float64]
    spline: BSpline


def _levelled(segment: Segment, mirror: Mirror, number: int) -> _Part:
    check_profile(segment.positions, segment.readings)
    if not segment.noise > 0:
        raise InputError(
            f"segment {number + 1}: noise {segment.noise:g} m; give the standard deviation of a reading, above 0"
        )
    order = np.argsort(segment.positions, kind="stable")
    positions, heights = segment.positions[order], segment.readings[order]
    start = float(positions[0]) if segment.start is None else segment.start
    distance = positions - start
    slack = 1e-6 * mirror.length
    if distance[0] < -slack or distance[-1] > mirror.length + slack:
        raise InputError(
            f"segment {number + 1} runs from {positions[0]:g} m to {positions[-1]:g} m, beyond the mirror of "
            f"{mirror.length:g} m that begins at {start:g} m"
        )
    side = -1.0 if segment.turned else 1.0
    if mirror.profile is not None:
        first, last = float(mirror.profile[0, 0]), float(mirror.profile[-1, 0])
        if distance[0] < first - slack or distance[-1] > last + slack:
            raise InputError(
                f"segment {number + 1} uses the mirror from {distance[0]:g} m to {distance[-1]:g} m, but its form is "
                f"calibrated from {first:g} m to {last:g} m"
            )
        heights = heights - side * np.interp(distance, mirror.profile[:, 0], mirror.profile[:, 1])
    return _Part(positions, heights, 2 * distance / mirror.length - 1, segment.noise, side)


@dataclass(frozen=True)
class _FormPrior:
    """What may be assumed of the mirror's form: how many Legendre orders from 2 on, and their range, m."""

    orders: int
    range: float


def _form_prior(parts: Sequence[_Part], mirror: Mirror) -> _FormPrior | None:
    """None where nothing is known of the form and no turned placement shows it."""
    if len({part.side for part in parts}) == 2:
        return _FormPrior(len(TURNED_ORDERS), mirror.flatness or ANY_RANGE)
    return None if mirror.flatness is None else _FormPrior(len(MIRROR_ORDERS), max(mirror.flatness, 1e-12))


def _check_meeting(parts: Sequence[_Part], ordered: Sequence[int]) -> None:
    if not parts:
        raise InputError("no segment; give at least one")
    end = float(parts[0].positions[-1])
    for part, number in zip(parts[1:], ordered[1:], strict=True):
        start = float(part.positions[0])
        shared = int((part.positions <= end).sum())
        if shared < 3:
            raise InputError(
                f"segment {number + 1} begins at {start:g} m and the segments before it end at {end:g} m: they share "
                f"{shared} sample(s), a slope and a height need three at least; let the placements overlap"
            )
        end = max(end, float(part.positions[-1]))


def _knots(parts: Sequence[_Part], spacing: float | None) -> NDArray[np.float64]:
    first = min(float(part.positions[0]) for part in parts)
    last = max(float(part.positions[-1]) for part in parts)
    if spacing is None:
        spacing = max(2 * max(float(np.median(np.diff(part.positions))) for part in parts), (last - first) / 1000)
    breaks = np.linspace(first, last, max(2, round((last - first) / spacing) + 1))
    samples = np.concatenate([part.positions for part in parts])
    count, _ = np.histogram(samples, breaks)
    if np.any(count == 0):
        at = int(np.argmin(count))
        raise InputError(
            f"no sample from {breaks[at]:g} m to {breaks[at + 1]:g} m; measure without the gap or widen the spacing"
        )
    return np.concatenate([np.full(DEGREE, first), breaks, np.full(DEGREE, last)])


def _form(part: _Part, orders: int) -> NDArray[np.float64]:
    """(n, orders) Legendre polynomials of the mirror's form, as it lies in a placement."""
    polynomials = legendre.legvander(part.along, MIRROR_ORDERS[0] + orders - 1)[:, MIRROR_ORDERS[0] :]
    return np.asarray(part.side * polynomials, dtype=np.float64)


def _solve(parts: Sequence[_Part], mirror: Mirror, knots: NDArray[np.float64]) -> _Solution:
    """Spline, placements and mirror form: the spline's banded block is eliminated, the small rest is solved dense."""
    samples = np.concatenate([part.positions for part in parts])
    heights = np.concatenate([part.heights for part in parts])
    weights = np.concatenate([np.full(part.positions.size, 1 / part.noise) for part in parts])
    middle = float(samples.mean())
    design = csr_array(BSpline.design_matrix(samples, knots, DEGREE)).multiply(weights[:, None]).tocsr()
    form = _form_prior(parts, mirror)
    rest = _placement_columns(parts, middle, 0 if form is None else form.orders) * weights[:, None]
    target = heights * weights
    count = 2 * (len(parts) - 1)
    prior = np.zeros(rest.shape[1])
    if form is not None:
        prior[count:] = (MIRROR_RANGE / form.range) ** 2

    factor = cholesky_banded(_upper_band(csr_array(design.T @ design)))
    cross = np.asarray(design.T @ rest)
    gain = cho_solve_banded((factor, False), cross)
    rhs = np.asarray(design.T @ target)
    alone = cho_solve_banded((factor, False), rhs)
    schur = rest.T @ rest + np.diag(prior) - cross.T @ gain
    inverse = cho_solve(cho_factor(schur), np.eye(len(schur))) if schur.size else np.zeros((0, 0))
    placed = inverse @ (rest.T @ target - cross.T @ alone)
    coefficients = alone - gain @ placed

    positions = np.linspace(knots[0], knots[-1], len(coefficients))
    basis = BSpline.design_matrix(positions, knots, DEGREE).toarray()
    through = basis @ gain
    covariance = basis @ cho_solve_banded((factor, False), basis.T) + through @ inverse @ through.T
    slopes = np.concatenate([[0.0], placed[0:count:2]])
    # Columns are centred on `middle` for a good condition; offsets are told at axis position 0.
    offsets = np.concatenate([[0.0], placed[1:count:2]]) - slopes * middle
    spline = BSpline(knots, coefficients, DEGREE)
    return _Solution(positions, basis @ coefficients, covariance, slopes, offsets, placed[count:], spline)


def _placement_columns(parts: Sequence[_Part], middle: float, orders: int) -> NDArray[np.float64]:
    rows = []
    for number, part in enumerate(parts):
        block = np.zeros((part.positions.size, 2 * (len(parts) - 1)))
        if number:
            block[:, 2 * number - 2] = part.positions - middle
            block[:, 2 * number - 1] = 1.0
        rows.append(np.column_stack([block, _form(part, orders)]))
    return np.concatenate(rows)


def _upper_band(matrix: csr_array) -> NDArray[np.float64]:
    band = np.zeros((DEGREE + 1, matrix.shape[0]))
    for above in range(DEGREE + 1):
        band[DEGREE - above, above:] = matrix.diagonal(above)
    return band


def _overlaps(
    parts: Sequence[_Part], ordered: Sequence[int], mirror: Mirror, solution: _Solution
) -> tuple[Overlap, ...]:
    """Each two neighbours compared cell by cell, the cells as long as the knots are apart."""
    breaks = solution.spline.t[DEGREE : len(solution.spline.t) - DEGREE]
    residuals = [_residual(part, k, solution) for k, part in enumerate(parts)]
    found = []
    for k in range(len(parts) - 1):
        first = float(max(parts[k].positions[0], parts[k + 1].positions[0]))
        last = float(min(parts[k].positions[-1], parts[k + 1].positions[-1]))
        counts, means = [], []
        for part, residual in zip(parts[k : k + 2], residuals[k : k + 2], strict=True):
            inside = (part.positions >= first) & (part.positions <= last)
            counts.append(np.histogram(part.positions[inside], breaks)[0])
            sums = np.histogram(part.positions[inside], breaks, weights=residual[inside])[0]
            means.append(sums / np.maximum(counts[-1], 1))
        both = (counts[0] > 0) & (counts[1] > 0)
        difference = (means[0] - means[1])[both]
        variance = parts[k].noise ** 2 / counts[0][both] + parts[k + 1].noise ** 2 / counts[1][both]
        found.append(
            Overlap(
                segments=(ordered[k], ordered[k + 1]),
                first=first,
                last=last,
                share=(last - first) / mirror.length,
                difference=float(np.sqrt(np.mean(difference**2))),
                expected=float(np.sqrt(np.mean(variance))),
                probability=float(chi2.sf(np.sum(difference**2 / variance), max(1, both.sum() - 2))),
            )
        )
    return tuple(found)


def _residual(part: _Part, number: int, solution: _Solution) -> NDArray[np.float64]:
    """Readings minus all that the solution knows: profile, placement and mirror form."""
    placed = solution.slopes[number] * part.positions + solution.offsets[number]
    form = _form(part, len(solution.form)) @ solution.form
    return cast("NDArray[np.float64]", part.heights - solution.spline(part.positions) - placed - form)


def _warnings(overlaps: Sequence[Overlap], *, unknown: bool) -> tuple[str, ...]:
    warnings = []
    for overlap in overlaps:
        pair = f"segments {overlap.segments[0] + 1} and {overlap.segments[1] + 1}"
        if overlap.share < LEAST_OVERLAP:
            warnings.append(
                f"{pair} share {overlap.share:.1%} of the mirror's length; {LEAST_OVERLAP:.0%} is good practice"
            )
        if overlap.probability < (UNKNOWN_DISAGREEMENT if unknown else DISAGREEMENT):
            finding = (
                f"{pair} differ by {overlap.difference * 1e6:.3f} µm in their overlap, where noise explains "
                f"{overlap.expected * 1e6:.3f} µm"
            )
            if unknown:
                raise InputError(
                    f"{finding}, and the mirror's flatness is unknown; have the mirror calibrated, state its flatness, "
                    "or measure a placement a second time with the mirror turned over"
                )
            warnings.append(f"{finding}; noise, flatness or the placement is not as stated")
    if unknown and overlaps:
        warnings.append(
            "the mirror's flatness is unknown: its curvature grows with every joint and stays unseen in all overlaps; "
            "one placement measured a second time with the mirror turned over would show it"
        )
    return tuple(warnings)
