"""What a straightness step found, in words, and the mirror's form as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.special import gammaincinv

from rotary_error_monitor.calibration.reports import ending
from rotary_error_monitor.calibration.straightness_runs import Placed
from rotary_error_monitor.calibration.straightness_step import StraightnessResult
from rotary_error_monitor.metrology.reference_mirror import MirrorForm

SEEN = 0.5
"""Part of what was known of the mirror's curvature before to which several placements bring it, where they show it."""


def straightness_text(result: StraightnessResult, output: Path) -> str:
    """Straightness, its uncertainty, the evidence of the overlaps, the mirror's form, and a direct measurement."""
    spliced, doubts = result.spliced, result.doubts
    low, high = doubts.error_bounds
    first, last = spliced.positions[[0, -1]] * 1e3
    ends, zone = (spliced.straightness(method).error for method in ("end_point", "minimum_zone"))
    lines = [
        f"straightness ({result.name}) {result.error * 1e6:.3f} µm about the least squares line, standard uncertainty "
        f"{doubts.error_uncertainty * 1e6:.3f} µm, {first:g} to {last:g} mm",
        f"  95 % interval {low * 1e6:.3f} to {high * 1e6:.3f} µm",
        f"  a point of the curve {doubts.uncertainty * 1e6:.3f} µm, of which {doubts.between * 1e6:.3f} µm lie between "
        f"readings {result.spacing * 1e3:g} mm apart; waves shorter than {2 * result.spacing * 1e3:g} mm stay unseen",
        f"  about the line through the ends {ends * 1e6:.3f} µm, minimum zone {zone * 1e6:.3f} µm",
        *(line for number, part in enumerate(result.placements, start=1) for line in _repeatability(number, part)),
    ]
    if result.reversal is not None:
        lines.append(f"  largest difference of forward and backward {result.reversal * 1e6:.3f} µm")
    for overlap in spliced.overlaps:
        lines.append(
            f"  overlap of segments {overlap.segments[0] + 1} and {overlap.segments[1] + 1}: {overlap.share:.0%} of "
            f"the mirror, differ by {overlap.difference * 1e6:.3f} µm (noise explains {overlap.expected * 1e6:.3f} µm)"
        )
    lines += [*_mirror(result), *_direct(result)]
    lines += [f"  warning: {warning}" for warning in spliced.warnings]
    lines += [f"  note: {remark}" for remark in result.remarks]
    if result.rotated is not None:
        angle, sense = result.rotated.angle * 1e6, "rises" if result.rotated.rising else "falls"
        lines.append(f"  rotated by {angle:+.2f} µrad: the curve {sense} and its correction never reverses")
    return "\n".join([*lines, ending(doubts.misfits, result.written, output)])


def repeatability_bounds(part: Placed) -> tuple[float, float] | None:
    """95 % interval for the standard deviation of a reading about the mean of its direction, m; None without repeats.

    Neighbours that go together count for less: of the degrees of freedom remains (1 - r²) / (1 + r²) at a correlation
    r (Bayley and Hammersley 1946, of an autoregressive process of the first order).
    """
    combined = part.combined
    if combined.uncertainty is None or combined.freedom < 1:
        return None
    square = combined.correlation**2
    freedom = max(1.0, combined.freedom * (1 - square) / (1 + square))
    low, high = (
        combined.scatter * math.sqrt(freedom / float(2 * gammaincinv(0.5 * freedom, tail))) for tail in (0.975, 0.025)
    )
    return low, high


def mirror_csv(form: MirrorForm, source: str) -> str:
    """The mirror's form, found from the file `source`, as `--mirror-profile` takes it."""
    worst = math.sqrt(max(0.0, float(np.diag(form.covariance).max())))
    rows = [f"{x * 1e3:.9g},{y * 1e6:.5f}" for x, y in zip(form.distances, form.heights, strict=True)]
    heads = [
        f"# form of the mirror from {source}, standard uncertainty of a point {worst * 1e6:.3f} um",
        "distance_mm,height_um",
    ]
    return "\n".join([*heads, *rows]) + "\n"


def _repeatability(number: int, part: Placed) -> Iterator[str]:
    bounds = repeatability_bounds(part)
    if bounds is None:
        return
    low, high = bounds
    yield (
        f"  segment {number}: {len(part.runs)} runs, largest deviation of a run from the mean of its direction "
        f"{part.combined.largest_deviation * 1e6:.3f} µm, standard deviation {part.combined.scatter * 1e6:.3f} "
        f"({low * 1e6:.3f} to {high * 1e6:.3f})"
    )


def _mirror(result: StraightnessResult) -> Iterator[str]:
    form = result.spliced.mirror
    if form is None:
        return
    worst = math.sqrt(max(0.0, float(np.diag(form.covariance).max())))
    curvature = "its curvature unseen, as stated" if form.unseen > SEEN else "its curvature as well"
    yield (
        f"  form of the mirror ({curvature}): {form.flatness * 1e6:.3f} µm peak to valley, standard uncertainty of a "
        f"point {worst * 1e6:.3f} µm"
    )


def _direct(result: StraightnessResult) -> Iterator[str]:
    found = result.comparison
    if found is None:
        return
    yield (
        f"  measured directly {np.ptp(found.second) * 1e6:.3f} µm, spliced {np.ptp(found.first) * 1e6:.3f} µm; largest "
        f"difference {found.largest * 1e6:.3f} µm, at {found.at * 1e3:g} mm\n"
        f"    (both uncertainties explain {found.bound * 1e6:.3f} µm, p-value {found.probability:.2g})"
    )
