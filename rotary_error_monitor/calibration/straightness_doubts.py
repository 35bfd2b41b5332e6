"""How sure a straightness is, and what in its measurement does not fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.quietness import quiet_length
from rotary_error_monitor.calibration.steps import share_of_travel
from rotary_error_monitor.calibration.straightness_runs import Placed
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.metrology.overlaps import contradicting
from rotary_error_monitor.metrology.profile_range import NORMAL_95, range_bounds
from rotary_error_monitor.metrology.reference_mirror import PlacementReadings
from rotary_error_monitor.metrology.run_agreement import (
    disagreeing_directions,
    disagreeing_runs,
    scatters_too_little,
    unrepeated_doubt,
)
from rotary_error_monitor.metrology.splicing import SplicedProfile
from rotary_error_monitor.metrology.straightness import Straightness
from rotary_error_monitor.metrology.unresolved import find_unresolved

LEAST_OF_TRAVEL = 0.01
"""Part of the travel that readings cover at least: metres taken for mm cover a thousandth."""

SMALL_PART = 0.1
"""Readings that cover less than this of both their mirror and the travel are taken for positions in another unit, such
as inches: pieces of a travel are as long as the mirror that they are measured along."""


@dataclass(frozen=True)
class StraightnessUncertainty:
    """How sure a straightness is.

    Attributes:
        uncertainty: largest standard uncertainty of a deviation, m.
        error_uncertainty: standard uncertainty of the range of the deviations, m.
        error_bounds: 95 % interval for it, m.
        between: part of `uncertainty` by what lies between the readings, m.
        correlation: of the noise of neighbouring readings.
        doubt: part of `uncertainty` by what does not fit or was not repeated, m.
        misfits: what does not fit, in words.
    """

    uncertainty: float
    error_uncertainty: float
    error_bounds: tuple[float, float]
    between: float
    correlation: float
    doubt: float
    misfits: tuple[str, ...]

    def beside(self, misfits: tuple[str, ...], moved: float = 0.0) -> StraightnessUncertainty:
        """These with further misfits, which may have moved a deviation by so many m."""
        low, high = self.error_bounds
        wider = NORMAL_95 * math.sqrt(2) * moved
        return replace(
            self,
            uncertainty=math.hypot(self.uncertainty, moved),
            doubt=math.hypot(self.doubt, moved),
            error_uncertainty=math.hypot(self.error_uncertainty, math.sqrt(2) * moved),
            error_bounds=(max(0.0, low - wider), high + wider),
            misfits=(*misfits, *self.misfits),
        )


def find_doubts(
    parts: Sequence[Placed], spliced: SplicedProfile, straightness: Straightness, noise: float
) -> StraightnessUncertainty:
    """How sure a spliced straightness is; `noise` is the stated standard deviation of a reading, m."""
    covariance = spliced.deviation_covariance()
    between = _between(parts)
    misfits, doubt = _contradictions(parts, spliced, between)
    disagreements, moved = _disagreements(parts, noise)
    disagreements = (*disagreements, *_too_little(parts, noise))
    doubt = max(doubt, moved, *(unrepeated_doubt(part.combined, noise) for part in parts))
    largest = float(np.diag(covariance).max())
    high, low = int(np.argmax(straightness.deviations)), int(np.argmin(straightness.deviations))
    across = float(covariance[high, high] + covariance[low, low] - 2 * covariance[high, low])
    # errors of neighbours that go together are opposite between a curve's two extremes
    correlation = max(part.combined.correlation for part in parts)
    across = max(across, 2 * largest) * (1 + correlation)
    # what lies between the readings makes the range larger at both ends
    further = math.hypot(2 * between, math.sqrt(2) * doubt)
    return StraightnessUncertainty(
        uncertainty=math.hypot(math.sqrt(largest), between, doubt),
        error_uncertainty=math.hypot(math.sqrt(across), further),
        error_bounds=range_bounds(straightness.deviations, covariance * (1 + correlation), further),
        between=between,
        correlation=correlation,
        doubt=doubt,
        misfits=(*disagreements, *misfits),
    )


def _between(parts: Sequence[Placed]) -> float:
    """Standard deviation of what lies between the stops of all placements, m.

    Placements are taken together before it is asked whether anything is left: noise shows a little in one or the other.
    """
    found = [
        find_unresolved(part.segment.positions, part.segment.readings, np.square(part.segment.noise)) for part in parts
    ]
    count = max(1, sum(one.count for one in found))
    square = max(0.0, sum(one.square for one in found))
    return max(math.sqrt(square / count), max(one.largest for one in found))


def _contradictions(parts: Sequence[Placed], spliced: SplicedProfile, between: float) -> tuple[tuple[str, ...], float]:
    """What does not fit, in words, and how far it may move the result, m."""
    misfits, doubt = [], 0.0
    for number, part in enumerate(parts, start=1):
        outliers = part.combined.outliers
        if part.combined is part.without or not outliers:
            continue
        worst = outliers[0]
        misfits.append(
            f"segment {number}: {len(outliers)} reading(s) stand off from those of other runs, by up to "
            f"{worst.excess * 1e6:+.3f} µm or {worst.ratio:.1f} standard deviations; --drop-outliers leaves them out"
        )
        moved = np.interp(part.combined.positions, part.without.positions, part.without.mean) - part.combined.mean
        doubt = max(doubt, float(np.abs(moved - np.median(moved)).max()))
    for overlap in contradicting(spliced.overlaps, unresolved=between):
        pair = f"segments {overlap.segments[0] + 1} and {overlap.segments[1] + 1}"
        misfits.append(
            f"{pair} differ by {overlap.difference * 1e6:.3f} µm in their overlap, where noise explains "
            f"{overlap.expected * 1e6:.3f} µm (p-value {overlap.probability_beside(between**2):.1g})"
        )
        doubt = max(doubt, overlap.difference)
    return tuple(misfits), doubt


def _disagreements(parts: Sequence[Placed], noise: float) -> tuple[tuple[str, ...], float]:
    """Runs and directions that contradict one another, in words, and how far they may move the result, m."""
    misfits, doubt = [], 0.0
    for number, part in enumerate(parts, start=1):
        for what, found, advice in (
            (
                "runs of one direction scatter by",
                disagreeing_runs(part.combined, len(part.runs), noise),
                "a run of another sign or unit, a drift, or noise larger than stated",
            ),
            (
                "forward and backward differ by",
                disagreeing_directions(part.combined, noise),
                "one direction of another sign or unit, or a drift",
            ),
        ):
            if found is not None:
                misfits.append(
                    f"segment {number}: {what} {found.size * 1e6:.3f} µm, where noise of {noise * 1e6:g} µm and a "
                    f"plausible repeatability or reversal explain {found.expected * 1e6:.3f} µm (p-value "
                    f"{found.probability:.1g}): {advice}"
                )
                doubt = max(doubt, found.moved)
    return tuple(misfits), doubt


def _too_little(parts: Sequence[Placed], noise: float) -> Iterator[str]:
    """Placements whose runs are far more alike than the stated noise, or any instrument, lets them be, in words."""
    for number, part in enumerate(parts, start=1):
        scatter, what = part.combined.scatter, f"segment {number}: runs of one direction scatter by"
        if scatters_too_little(part.combined, noise):
            yield (
                f"{what} {scatter * 1e6:.2g} µm, where noise of {noise * 1e6:g} µm is stated: are the readings in the "
                "unit of the header, and is the noise in µm?"
            )
        elif (doubt := quiet_length(scatter, *_size(part.segment), in_air=False)) is not None:
            yield f"{what} {doubt}"


def _size(segment: PlacementReadings) -> tuple[float, float]:
    """Largest departure of a placement's readings from their line, and along what they were read, m."""
    x, y = segment.positions, segment.readings
    return float(np.abs(y - np.polyval(np.polyfit(x, y, 1), x)).max()), float(np.ptp(x))


def unit_doubts(axis: Axis, positions: Array, mirror: float | None) -> tuple[str, ...]:
    """Positions that cover so little that their unit is in doubt, in words; `mirror` is its length, m, if any."""
    share = share_of_travel(axis, positions)
    of_mirror = 0.0 if mirror is None else float(np.ptp(positions)) / mirror
    if share >= LEAST_OF_TRAVEL and max(share, of_mirror) >= SMALL_PART:
        return ()
    covered = f"cover {share:.2%} of the travel of {axis.letter}"
    if mirror is not None:
        covered += f" and {of_mirror:.2%} of the mirror's length"
    return (
        f"the positions, {positions[0] * 1e3:g} to {positions[-1] * 1e3:g} mm, {covered}: are they in another unit?",
    )
