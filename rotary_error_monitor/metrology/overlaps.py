"""What placements of a mirror say where they overlap, and whether they contradict one another."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.distributions import chi_square_tail

LEAST_OVERLAP = 0.15
"""Share of the mirror's length that two placements should share (Zhou et al. 2023, Section 2.1)."""

DISAGREEMENT = 1e-3
"""Probability that segments that agree are said to disagree in any overlap, where the mirror's flatness is stated."""

UNKNOWN_DISAGREEMENT = 0.01
"""The same for a mirror of unknown flatness: an overlap shows only a part of its form, so suspicion comes earlier."""


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
        cells: how many were compared.
    """

    segments: tuple[int, int]
    first: float
    last: float
    share: float
    difference: float
    expected: float
    probability: float
    cells: int

    def probability_beside(self, variance: float) -> float:
        """Of so large a difference, where a cell of either segment has a further `variance`, m²."""
        square = self.cells * self.difference**2 / (self.expected**2 + 2 * variance)
        return min(1.0, max(self.probability, chi_square_tail(square, max(1, self.cells - 2))))


@dataclass(frozen=True)
class Residual:
    """What is left of a segment's readings after splicing: ascending positions (n,), residuals and noise (n,), m."""

    positions: NDArray[np.float64]
    values: NDArray[np.float64]
    noise: NDArray[np.float64]


def compare_overlaps(
    residuals: Sequence[Residual], numbers: Sequence[int], length: float, breaks: NDArray[np.float64]
) -> tuple[Overlap, ...]:
    """Each two neighbours compared cell by cell, the cells given by their `breaks` (m,) m.

    `numbers` are the segments' own, `length` is that of the mirror, m.
    """
    found = []
    for k, pair in enumerate(itertools.pairwise(residuals)):
        first = float(max(part.positions[0] for part in pair))
        last = float(min(part.positions[-1] for part in pair))
        counts, means, variances = [], [], []
        for part in pair:
            inside = (part.positions >= first) & (part.positions <= last)
            at = part.positions[inside]
            counts.append(np.histogram(at, breaks)[0])
            share = np.maximum(counts[-1], 1)
            means.append(np.histogram(at, breaks, weights=part.values[inside])[0] / share)
            variances.append(np.histogram(at, breaks, weights=part.noise[inside] ** 2)[0] / share**2)
        both = (counts[0] > 0) & (counts[1] > 0)
        difference, variance = np.zeros(1), np.ones(1)
        if both.any():
            difference, variance = (means[0] - means[1])[both], (variances[0] + variances[1])[both]
        found.append(
            Overlap(
                segments=(numbers[k], numbers[k + 1]),
                first=first,
                last=last,
                share=(last - first) / length,
                difference=float(np.sqrt(np.mean(difference**2))),
                expected=float(np.sqrt(np.mean(variance))),
                probability=chi_square_tail(np.sum(difference**2 / variance), max(1, both.sum() - 2)),
                cells=int(both.sum()),
            )
        )
    return tuple(found)


def contradicting(
    overlaps: Sequence[Overlap], *, unknown: bool = False, unresolved: float = 0.0
) -> tuple[Overlap, ...]:
    """Overlaps in which the segments differ by more than noise explains, or detail between their samples.

    `unknown` is the mirror's flatness, `unresolved` the standard deviation of that detail, m.
    """
    limit = (UNKNOWN_DISAGREEMENT if unknown else DISAGREEMENT) / max(1, len(overlaps))
    return tuple(overlap for overlap in overlaps if overlap.probability_beside(unresolved**2) < limit)


def overlap_warnings(overlaps: Sequence[Overlap], *, unknown: bool) -> tuple[str, ...]:
    """What a user should know of the overlaps; `unknown` is the mirror's flatness.

    Raises:
        InputError: segments differ and the mirror's flatness is unknown.
    """
    warnings = []
    for overlap in overlaps:
        pair = f"segments {overlap.segments[0] + 1} and {overlap.segments[1] + 1}"
        if overlap.share < LEAST_OVERLAP:
            warnings.append(
                f"{pair} share {overlap.share:.1%} of the mirror's length; {LEAST_OVERLAP:.0%} is good practice"
            )
        if overlap in contradicting(overlaps, unknown=unknown):
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
    if unknown and not overlaps:
        warnings.append(
            "the mirror's flatness is unknown: all of its form counts as the guideway's, without uncertainty"
        )
    if unknown and overlaps:
        warnings.append(
            "the mirror's flatness is unknown: its curvature grows with every joint and stays unseen in all overlaps; "
            "one placement measured a second time with the mirror turned over would show it"
        )
    return tuple(warnings)
