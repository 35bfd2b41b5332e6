"""The autocollimator's answer from steps of a reference, into the stage file (Lou et al. 2019, Figures 4 and 5)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.assembly_doubts import CHANGED
from rotary_error_monitor.calibration.collimator_steps import Quadrants, read_steps
from rotary_error_monitor.calibration.stage_document import kept_figures, set_value
from rotary_error_monitor.calibration.yaml_document import YamlDocument, hash_source, number
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.two_axis_calibration import (
    COVERAGE,
    InstrumentPrior,
    TwoAxisCalibration,
    calibrate_two_axes,
)
from rotary_error_monitor.metrology.two_axis_fit import NAMES, ReferenceUncertainty, numbers_of, response_of
from rotary_error_monitor.metrology.two_axis_steps import StepReadings, StrayReading, find_stray_readings
from rotary_error_monitor.units import ARCSEC

PART = "autocollimator"
KEPT = ("zero", "roll")
"""What may stay in the file as it was: off the stage, the reference knows neither its zero nor its axes."""

ANOTHER_UNIT = 2.0
"""Factor from the gain in the file from which the units of the table are in doubt: of one make they differ by percents,
and the nearest units by 4.8."""


@dataclass(frozen=True)
class CollimatorResult:
    """What steps of a reference say of a stage's autocollimator.

    Attributes:
        calibration: with what is in doubt in its covariance.
        before: response that the file had.
        response: that it is to have: with the sign of the gain as before, and with what is kept.
        stds: (8,) standard uncertainties of its numbers; of what is kept as found.
        kept: names of what stays as it was.
        range: half of the measuring range, rad, and what the file had.
        quadrants: how voltages were read; None where the readings were tilts.
        misfits: what does not fit, in words.
        remarks: what else is to be known, in words.
        written: whether the file was written.
    """

    calibration: TwoAxisCalibration
    before: Response
    response: Response
    stds: Array
    kept: tuple[str, ...]
    range: tuple[float, float]
    quadrants: Quadrants | None
    misfits: tuple[str, ...]
    remarks: tuple[str, ...]
    written: bool = False

    @property
    def expanded(self) -> Array:
        """(2,) largest expanded uncertainty of a calibrated reading over the steps, without its noise, rad."""
        used = self.calibration.steps.reference[self.calibration.used]
        return np.asarray(self.calibration.expanded(used).max(axis=0))


def calibrate_autocollimator(
    source: Path,
    stage_file: Path,
    output: Path,
    day: date,
    reference: ReferenceUncertainty,
    *,
    quadrants: Quadrants | None = None,
    keep: tuple[str, ...] = (),
    drop_outliers: bool = False,
    force: bool = False,
    layout: ColumnLayout | None = None,
) -> CollimatorResult:
    """Zero, gain, roll, distortion and range of the autocollimator, into the stage file.

    Steps that do not fit, lost motion of the reference, a residual that reference and noise do not explain, and a
    change against what the file has with an uncertainty are written only by `force`, with an uncertainty for them.

    Args:
        source: CSV file of the steps.
        stage_file: the stage as described so far.
        output: where to write.
        day: of the calibration.
        reference: how sure it is.
        quadrants: how voltages become tilts, as the node is set.
        keep: of `KEPT`, what stays in the file.
        drop_outliers: leave steps out that stand off.
        force: write what does not fit.
        layout: which column of the source is what, of a table as an instrument writes it.

    Raises:
        InputError: table or stage file cannot be read, the stage has no autocollimator, or the steps do not tell.
    """
    stage = load_stage(stage_file)
    if stage.autocollimator is None:
        raise InputError(f"{stage_file}: the stage has no section 'autocollimator', which this calibrates")
    quadrants = quadrants or Quadrants()
    steps, voltages = read_steps(source, quadrants, layout)
    result = _result(source, stage, steps, reference, keep, drop_outliers, quadrants if voltages else None)
    if result.misfits and not force:
        return result
    _write(result, source, stage_file, output, day)
    return replace(result, written=True)


def _result(
    source: Path,
    stage: StageDescription,
    steps: StepReadings,
    reference: ReferenceUncertainty,
    keep: tuple[str, ...],
    drop_outliers: bool,
    quadrants: Quadrants | None,
) -> CollimatorResult:
    """What the steps say; `quadrants` where they are voltages.

    Raises:
        InputError: they do not tell.
    """
    described = stage.tilt_instrument.range
    strays = find_stray_readings(steps, false_alarm=FALSE_ALARM)
    with told_of(source):
        clean = calibrate_two_axes(steps.without([each.row for each in strays]), _instrument(stage), reference)
        calibration = calibrate_two_axes(steps, _instrument(stage), reference) if strays else clean
    remarks = _strays(steps, strays)
    if drop_outliers:
        calibration, strays = clean, ()
    before = stage.response(PART)
    response = _as_before(calibration.response, before, keep)
    misfits, doubts = _doubts(calibration, stage, response, keep, drop_outliers, quadrants is not None)
    if strays:
        misfits += [f"{each}; --drop-outliers leaves it out" for each in remarks]
        doubts = np.hypot(doubts, np.abs(numbers_of(calibration.response) - numbers_of(clean.response)))
    spread = max(1.0, calibration.fit.chi_square / calibration.fit.freedom) if _left(calibration) else 1.0
    calibration = replace(calibration, covariance=calibration.covariance * spread + np.diag(doubts**2))
    return CollimatorResult(
        calibration,
        before,
        response,
        calibration.stds,
        keep,
        (_range(calibration, described), described),
        quadrants,
        tuple(misfits),
        (
            *_remarks(calibration, described),
            *_moved_zero(calibration, response),
            *(() if strays else (f"{each}; left out" for each in remarks)),
        ),
    )


def _strays(steps: StepReadings, strays: Sequence[StrayReading]) -> list[str]:
    """Readings that stand off from the others of their step, in words."""
    words = []
    for each in strays:
        line = "" if steps.lines is None else f" (line {steps.lines[each.row]})"
        words.append(
            f"step {steps.names[steps.step[each.row]]}: a reading{line} is {each.excess * ARCSEC:+.3f} arcsec from the "
            f"others about {'xy'[each.axis]}, {each.ratio:.1f} standard deviations"
        )
    return words


def _instrument(stage: StageDescription) -> InstrumentPrior:
    described, gain = stage.tilt_instrument, abs(stage.response(PART).gain)
    slow = 0.0 if described.turbulence is None else described.turbulence.std
    return InstrumentPrior(described.noise * gain, described.resolution * gain, slow * gain)


def _as_before(found: Response, before: Response, keep: tuple[str, ...]) -> Response:
    """The same response with the sign of gain that the file has, and with what is kept of it."""
    if before.gain < 0:  # a gain of the other sign is half a turn
        found = replace(found, gain=-found.gain, roll=math.remainder(found.roll + math.pi, 2 * math.pi))
    found = replace(found, latency=before.latency)
    if "zero" in keep:
        found = replace(found, zero=before.zero or (0.0, 0.0))
    return replace(found, roll=before.roll) if "roll" in keep else found


def _left(calibration: TwoAxisCalibration) -> bool:
    return calibration.probability < FALSE_ALARM


def _doubts(
    calibration: TwoAxisCalibration,
    stage: StageDescription,
    response: Response,
    keep: tuple[str, ...],
    drop_outliers: bool,
    voltages: bool,
) -> tuple[list[str], Array]:
    """What does not fit, in words, and (8,) how far it may move each number of the response."""
    misfits, doubts, fit = [], np.zeros(len(NAMES)), calibration.fit
    for axis in calibration.lost_motion:
        size = 2 * abs(float(fit.lost[0][axis]))
        misfits.append(
            f"reference {'xy'[axis]} comes to the same angle {size * ARCSEC:.3f} arcsec apart from its two sides (lost "
            f"motion, standard uncertainty {2 * float(fit.lost[1][axis]) * ARCSEC:.3f}): come from one side only"
        )
        doubts[:2] = np.hypot(doubts[:2], np.abs(fit.matrix[:, axis]) * size / 2)
    if calibration.outliers and not drop_outliers:
        named = ", ".join(_named(calibration, step) for step in calibration.outliers)
        misfits.append(f"steps that do not fit the others: {named}; --drop-outliers leaves them out")
        moved = numbers_of(response_of(calibration.all_steps.values)) - numbers_of(calibration.response)
        doubts = np.hypot(doubts, np.abs(moved))
    if _left(calibration):
        ratio = math.sqrt(fit.chi_square / fit.freedom)
        misfits.append(
            f"what is left is {ratio:.2f} times what reference and noise explain (p-value "
            f"{calibration.probability:.1g}): the reference is less sure than stated, or the instrument bends "
            "otherwise than by a cubic term"
        )
    factor = abs(response.gain / stage.response(PART).gain)
    if not voltages and not 1 / ANOTHER_UNIT < factor < ANOTHER_UNIT:
        misfits.append(
            f"the gain is {factor:.4g} times that of the file: are reference and readings in the units of the header?"
        )
    for name, words, size in _changes(calibration, stage, response, keep):
        misfits.append(words)
        doubts[NAMES.index(name)] = math.hypot(doubts[NAMES.index(name)], size)
    return misfits, doubts


def _named(calibration: TwoAxisCalibration, step: int) -> str:
    off = calibration.residual[step] * ARCSEC
    return f"{calibration.steps.names[step]} ({off[0]:+.3f}, {off[1]:+.3f} arcsec)"


def _changes(
    calibration: TwoAxisCalibration, stage: StageDescription, response: Response, keep: tuple[str, ...]
) -> Iterator[tuple[str, str, float]]:
    """Numbers that differ from those in the file by more than both uncertainties explain: name, words, difference."""
    known = {name: stage.uncertainty.get(f"{PART}.{name.partition('[')[0]}") for name in NAMES}
    compared = [name for name in NAMES if known[name] is not None and name.partition("[")[0] not in keep]
    limit = -float(ndtri(CHANGED / (2 * max(1, len(compared)))))
    for index, (name, old, new) in enumerate(
        zip(NAMES, numbers_of(stage.response(PART)), numbers_of(response), strict=True)
    ):
        if name not in compared:
            continue
        std, own = known[name] or 0.0, float(calibration.stds[index])
        difference = math.remainder(new - old, 2 * math.pi) if name == "roll" else new - old
        if abs(difference) > limit * math.hypot(std, own):
            change = f"was {old:.6g} ± {std:.2g} and now is {new:.6g} ± {own:.2g}"
            yield name, f"{PART}.{name} {change}: was it adjusted or mounted anew?", abs(difference)


def _range(calibration: TwoAxisCalibration, before: float) -> float:
    """Half of the measuring range, rad: as far as steps fit where those beyond fell short, or fit beyond the old."""
    ends, short = calibration.reach
    if short.any():
        return float(ends[short].min())
    return max(before, float(ends.min()))


def _remarks(calibration: TwoAxisCalibration, before: float) -> Iterator[str]:
    names = calibration.steps.names
    if calibration.short:
        yield f"beyond the usable range, left out: step {', '.join(names[step] for step in calibration.short)}"
    ends, short = calibration.reach
    if not short.any() and ends.min() < 0.9 * before:
        yield (
            f"steps reach {ends.min() * ARCSEC:.1f} arcsec of the range of ±{before * ARCSEC:.1f} arcsec; nothing is "
            "known beyond"
        )
    if calibration.outliers:
        yield f"left out of the fit: step {', '.join(names[step] for step in calibration.outliers)}"
    if (calibration.repeat > 1).any():
        yield (
            f"visits of a setting scatter {calibration.repeat.max():.2f} times as much as readings within them say; "
            "that is counted"
        )
    if not calibration.fit.prior[10:].all():
        yield "the reference came from one side only along an axis: its lost motion does not show"
    if calibration.fit.rate is None:
        yield "without time_s a drift does not show"
    for axis, told in zip("xy", calibration.fit.told, strict=True):
        if not told:
            yield f"these steps do not tell the cubic term of axis {axis}; it is as uncertain as they leave it"


def _moved_zero(calibration: TwoAxisCalibration, response: Response) -> Iterator[str]:
    """A zero that is kept is not that about which the cubic terms were found."""
    moved = np.abs(np.subtract(response.zero, calibration.response.zero) / response.gain)
    ends = np.square(np.abs(calibration.steps.reference[calibration.used]).max(axis=0))
    off = float((3 * np.abs(response.cubic) * moved * ends).max()) * ARCSEC
    if off > float(calibration.expanded(calibration.steps.reference[calibration.used]).max()) * ARCSEC:
        yield (
            f"the zero that is kept is up to {float(moved.max()) * ARCSEC:.1f} arcsec from that of these steps, about "
            f"which the cubic terms hold: readings at the end of the range are off by up to {off:.2f} arcsec; step the "
            "reference where the instrument stands"
        )


def _write(result: CollimatorResult, source: Path, stage_file: Path, output: Path, day: date) -> None:
    document, response = YamlDocument(stage_file, "stage"), result.response
    values: dict[str, Any] = {
        "zero": [number(value) for value in response.zero],
        "gain": number(response.gain),
        "roll": number(response.roll),
        "gain_difference": number(response.gain_difference),
        "cross_coupling": number(response.cross_coupling),
        "cubic": [number(value) for value in response.cubic],
        "range": number(result.range[0]),
    }
    figures: dict[str, float] = dict(kept_figures(document, ("latency", *result.kept)))
    for name, value in values.items():
        if name in result.kept or (name == "range" and result.range[0] == result.range[1]):
            continue
        set_value(document, PART, (PART, name), value)
        std = max(
            (float(s) for n, s in zip(NAMES, result.stds, strict=True) if n.partition("[")[0] == name), default=None
        )
        if std is None:
            continue
        figures[f"{name}_uncertainty"] = std
        # what the file states itself counts before its calibration
        stated = ("uncertainty", f"{PART}.{name}")
        if document.get(*stated) is not None:
            set_value(document, PART, stated, number(std))
    figures |= _figures(result)
    digest, remark = hash_source(source), "; ".join(result.misfits) or None
    uncertainty = float(result.expanded.max()) / COVERAGE
    document.note(PART, Calibrated(day.isoformat(), source.name, digest, uncertainty, figures, remark))
    document.save(output, load_stage, source)


def _figures(result: CollimatorResult) -> dict[str, float]:
    calibration = result.calibration
    largest = np.abs(calibration.residual[calibration.used]).max(axis=0)
    found = {f"residual_{axis}": float(size) for axis, size in zip("xy", largest, strict=True)}
    found |= {f"expanded_uncertainty_{axis}": float(size) for axis, size in zip("xy", result.expanded, strict=True)}
    if calibration.fit.rate is not None:
        for axis, value, std in zip("xy", *calibration.fit.rate, strict=True):
            found |= {f"drift_{axis}": float(value), f"drift_{axis}_uncertainty": float(std)}
    return found
