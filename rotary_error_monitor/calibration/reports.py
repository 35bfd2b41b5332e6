"""What a calibration found, in words and units that people read: µm, arcsec, µrad."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.calibration.axis_lines import SquarenessResult
from rotary_error_monitor.calibration.axis_location import ZERO
from rotary_error_monitor.calibration.axis_table import AxisRelation
from rotary_error_monitor.calibration.controller_tables import CompensationChange
from rotary_error_monitor.calibration.known_slopes import BESIDE
from rotary_error_monitor.calibration.machine_step import MachineResult
from rotary_error_monitor.calibration.steps import PositioningResult
from rotary_error_monitor.calibration.volume import ErrorCost, UncertainOffsets
from rotary_error_monitor.machine.location_names import SPINDLE
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.units import ARCSEC

MOST_ROWS = 12


def change_text(change: CompensationChange, before: Path) -> str:
    """How far a compensation is from an earlier one."""
    unit, scale = ("arcsec", ARCSEC) if change.rotary else ("µm", 1e6)
    place = f"{math.degrees(change.position):g} degrees" if change.rotary else f"{change.position * 1e3:g} mm"
    text = (
        f"the error that it takes out differs from that of {before} by {change.rms * scale:.3f} {unit} (root mean "
        f"square), most by {change.largest * scale:+.3f} {unit} at {place}, direction {change.direction:+d}"
    )
    if change.uncovered > 0:
        text += f"; {change.uncovered:.1%} of its travel had no rows before"
    return text


def positioning_text(result: PositioningResult, output: Path) -> str:
    """ISO 230-2 figures, outliers and departures from the standard test."""
    unit, scale = ("arcsec", ARCSEC) if result.runs.rotary else ("µm", 1e6)
    what = "scatter of the runs"
    if result.instrument:
        what += f" and an instrument of {result.instrument * scale:.3g} {unit}"
    lines = [
        f"positioning ({result.name}), {len(result.runs.targets)} targets, ISO 230-2, {unit}",
        f"  in brackets 95 % intervals, of the {what}",
        *_figure_lines(result, scale),
    ]
    where = 180 / math.pi if result.runs.rotary else 1e3
    fate = "dropped" if result.dropped else "the figures include it"
    for outlier in result.outliers:
        lines.append(
            f"  flagged{' (start-up)' if outlier.startup else ''}: cycle {outlier.cycle + 1}, direction "
            f"{outlier.direction:+d}, target {result.runs.targets[outlier.target] * where:g} "
            f"{'deg' if result.runs.rotary else 'mm'}: {outlier.excess * scale:+.3f} {unit} from the others, "
            f"{outlier.ratio:.1f} standard deviations; {fate}"
        )
    lines += [f"  note: {remark}" for remark in result.remarks]
    last = ending(result.misfits, result.written, output)
    return "\n".join([*lines, f"{last}, standard uncertainty {result.uncertainty * scale:.3f} {unit}"])


def _figure_lines(result: PositioningResult, scale: float) -> list[str]:
    """Figures of ISO 230-2 with their 95 % intervals, a line for each direction and two for both."""
    figures, bounds = result.figures, result.bounds
    usual = {"repeatability R": "repeatability", "systematic deviation E": "systematic_deviation"}
    usual["accuracy A"] = "accuracy"
    lines = [_figures_of("forward", figures.forward, bounds.forward, usual, scale)]
    if figures.backward is not None:
        lines.append(_figures_of("backward", figures.backward, bounds.backward, usual, scale))
    if figures.bidirectional is not None:
        further = {"reversal error B": "reversal_error", "mean reversal error": "mean_reversal_error"}
        further["range of means M"] = "mean_deviation_range"
        lines += [
            _figures_of(name, figures.bidirectional, bounds.bidirectional, chosen, scale)
            for name, chosen in (("bidirectional", usual), ("", further))
        ]
    return lines


def _figures_of(name: str, figures: object, bounds: object, chosen: Mapping[str, str], scale: float) -> str:
    parts = []
    for words, attribute in chosen.items():
        low, high = (value * scale for value in getattr(bounds, attribute))
        parts.append(f"{words} {getattr(figures, attribute) * scale:.3f} ({low:.3f} to {high:.3f})")
    return f"  {f'{name:13} ' if name else ''}{'   '.join(parts)}"


def squareness_text(result: SquarenessResult, output: Path) -> str:
    """Squareness errors, and location errors of rotary axes."""
    lines = ["squareness errors (angle less 90 degrees), µrad"]
    for letter, other, angle, uncertainty in result.squareness:
        lines.append(f"  {letter} to {other}: {angle * 1e6:+.2f}, standard uncertainty {uncertainty * 1e6:.2f}")
    lines += _known_lines(result)
    for letter, found in result.locations.items():
        name = letter if letter == SPINDLE else f"axis {letter}"
        lines.append(
            f"  {name} tilted by ({_micro(found.rotation)}) µrad about x, y, z, standard uncertainty "
            f"{found.rotation_uncertainty.max() * 1e6:.2f}"
        )
        if letter == result.reference:
            lines.append(f"    its place is that of the file, and others count from it (no feature {ZERO})")
            continue
        if np.all(np.isnan(found.shift_uncertainty)):
            lines.append("    its place is that of the file: nothing that carries it ties it to the others")
            continue
        lines.append(
            f"    displaced by ({_micro(np.where(np.isnan(found.shift_uncertainty), np.nan, found.shift))}) µm along "
            f"x, y, z (nan: not seen), standard uncertainty {np.nanmax(found.shift_uncertainty) * 1e6:.2f}"
        )
    lines += _relation_lines(result.relations)
    for letter, ratio in result.scatter:
        lines.append(f"  the points of {letter} scatter {ratio:.2f} times the noise, which the uncertainty counts")
    return "\n".join([*lines, ending(result.misfits, result.written, output)])


def _known_lines(result: SquarenessResult) -> Iterator[str]:
    """What errors of the file make of the lines, where that is more than a tenth of what the lines are unsure by."""
    least = 0.1 * max(uncertainty for *_, uncertainty in result.squareness)
    for letter, known in result.known.items():
        if max(float(np.abs(known.slope).max()), known.doubt, known.lever) <= least:
            continue
        place = "as the lines cross" if known.is_placed else "points taken to lie about mid-travel"
        text = (
            f"  without the slope of {letter} by errors of the file: ({_micro(known.slope)}) µrad along x, y, z, from "
        )
        text += f"{known.begin * 1e3:.4g} mm on ({place})"
        if known.doubt > least:
            text += f"; elsewhere on the travel another by {known.doubt * 1e6:.2f}, which the uncertainty counts"
        if known.lever > least:
            text += f"; by a reflector {BESIDE * 1e3:g} mm off another by up to {known.lever * 1e6:.2f}"
        yield text


def _relation_lines(rows: Sequence[AxisRelation]) -> list[str]:
    """How axes lie beside each other, as Pan et al. 2013, Table 2 has it."""
    if not rows:
        return []
    lines = [f"  {'between axes':34} {'mm / mm':>12} {'degrees':>10}  {'arcsec':>8}  95 %"]
    for row in rows:
        name, found = f"{row.item} {row.axes}", row.relation
        if row.length is None:
            bounds = f"{found.low * 1e3:.5f} … {found.high * 1e3:.5f} mm"
            lines.append(f"  {name:34} {found.value * 1e3:12.5f} {'':10}  {'':8}  {bounds}")
            continue
        # Squareness is less than 90 degrees where negative, a size is what is missing to it.
        sign = 1.0 if row.item == "squareness" else -1.0
        angle = 90 + sign * math.degrees(found.value) if row.right else math.degrees(found.value)
        over = f"{abs(found.value) * row.length * 1e3:.5f}/{row.length * 1e3:g}"
        bounds = f"{found.low * ARCSEC:.3f} … {found.high * ARCSEC:.3f}″"
        lines.append(f"  {name:34} {over:>12} {angle:10.5f}° {found.value * ARCSEC:8.3f}  {bounds}")
    return lines


def _micro(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{value * 1e6:+.2f}" for value in values)


def machine_text(result: MachineResult, output: Path) -> str:
    """The verdict, what the poses see and what they do not, and which further poses would help."""
    found, verdict = result.identification, result.verdict
    count = len(found.parameters)
    lines = [
        verdict.sentence,
        f"  {found.rank} of {count} combinations are seen, condition {found.condition:.1f}; "
        f"{int(found.determined.sum())} parameters are determined one by one; residual {found.residual_ratio:.3f} "
        "times the noise",
    ]
    if found.unseen:
        lines.append("  not seen (changes that go together unnoticed, in 10 µm and 10 µrad):")
        lines += [f"    {combination}" for combination in found.unseen[:MOST_ROWS]]
        lines.append(f"  the same poses with a tool 100 mm longer as well would show {verdict.rank_with_longer_tool}")
    lines.append(f"  poses that would add most ({', '.join(axis.letter for axis in found.machine.axes)}; mm, degrees):")
    scales = [axis.shown[0] for axis in found.machine.axes]
    for pose in verdict.further_poses:
        lines.append("    " + "  ".join(f"{value * scale:9.2f}" for value, scale in zip(pose, scales, strict=True)))
    known = found.standard_uncertainty
    worst = [k for k in np.argsort(-known) if np.isfinite(known[k])][:3]
    shown = ", ".join(f"{found.parameters[k].name} {known[k] * 1e6:.2f}" for k in worst)
    lines.append(f"  largest standard uncertainties (µm, µrad): {shown}")
    if found.too_small < FALSE_ALARM:
        lines.append(
            "  note: the readings scatter far less than the noise that is stated or taken: if the probe is better, say "
            "so (--noise-um), for its uncertainty is overstated; or are the offsets in another unit than µm?"
        )
    lines += [f"  note: {remark}" for remark in result.remarks]
    # the first line is the verdict, and says what does not fit
    return "\n".join([*lines, ending((), result.written, output)])


def ranking_text(costs: Sequence[ErrorCost]) -> str:
    """Errors by what each costs alone."""
    lines = [f"{'error':40} position, µm: rms  largest  orientation, µrad: rms"]
    for cost in costs:
        lines.append(
            f"{cost.name:40} {cost.position_rms * 1e6:17.3f} {cost.position_largest * 1e6:8.3f} "
            f"{cost.orientation_rms * 1e6:23.3f}"
        )
    return "\n".join(lines)


def uncertain_offsets_text(found: UncertainOffsets) -> str:
    """Position error over the working volume, and what the uncertainty of the description leaves of it."""
    error = np.linalg.norm(found.offset[:, :3], axis=1) * 1e6
    deviation = np.linalg.norm(found.deviation[:, :3], axis=1) * 1e6
    return (
        f"position error at {len(error)} poses: {_rms(error):.3f} µm rms, {error.max():.3f} µm at most\n"
        f"its standard uncertainty: {_rms(deviation):.2g} µm rms, {deviation.max():.2g} µm at most\n"
        f"95 % of the machines that the description allows are within {found.largest_bound * 1e6:.3f} µm everywhere"
    )


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def ending(misfits: Sequence[str], written: bool, output: Path) -> str:
    """What does not fit, and whether the file was written at `output`."""
    lines = [f"does not fit: {misfit}" for misfit in misfits]
    return "\n".join([*lines, f"written to {output}" if written else "not written; --force writes it all the same"])
