"""What steps of a reference say of the autocollimator, in words and arcsec."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotary_error_monitor.calibration.collimator import CollimatorResult
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.two_axis_calibration import COVERAGE
from rotary_error_monitor.metrology.two_axis_fit import numbers_of
from rotary_error_monitor.units import ARCSEC, HOUR


def collimator_text(result: CollimatorResult, output: Path) -> str:
    """What was found, how sure it is, and what does not fit."""
    steps, used = result.calibration.steps, result.calibration.used
    lines = [
        f"autocollimator: {len(steps.step)} readings in {len(steps.names)} steps at {len(np.unique(steps.settings))} "
        f"settings, {int(used.sum())} steps used; each ± is a standard uncertainty",
        *_numbers(result),
        *_drift(result),
        *_residuals(result),
    ]
    half, before = (value * ARCSEC for value in result.range)
    lines.append(f"  range ±{half:.1f} arcsec" + ("" if half == before else f", before ±{before:.1f}"))
    if result.misfits:
        lines += ["the steps do not fit:", *(f"  {misfit}" for misfit in result.misfits)]
    lines += [f"note: {remark}" for remark in result.remarks]
    if result.written:
        return "\n".join([*lines, f"written to {output}"])
    return "\n".join([*lines, "not written; --force writes it with an uncertainty that covers what does not fit"])


def _numbers(result: CollimatorResult) -> list[str]:
    """The numbers of the response with their standard uncertainties."""
    response, stds = result.response, result.stds
    zero, cubic, kept = np.array(response.zero) * ARCSEC, np.array(response.cubic), " (kept from before)"
    gains, sure = axis_gains(result)
    ends = cubic * np.square(np.abs(result.calibration.steps.reference[result.calibration.used]).max(axis=0))
    lines = [
        f"  gain {response.gain:.5f} ± {stds[2]:.5f}: of x {gains[0]:.5f} ± {sure[0]:.5f}, of y {gains[1]:.5f} ± "
        f"{sure[1]:.5f}",
        f"  roll {math.degrees(response.roll):.4f} ± {math.degrees(stds[3]):.4f} deg"
        + (kept if "roll" in result.kept else "")
        + f", cross-coupling {response.cross_coupling:.5f} ± {stds[5]:.5f} ({_from_zero(result, (4, 5))} beside equal "
        "axes)",
        f"  zero ({zero[0]:.3f}, {zero[1]:.3f}) ± ({stds[0] * ARCSEC:.3f}, {stds[1] * ARCSEC:.3f}) arcsec"
        + (kept if "zero" in result.kept else ""),
        f"  cubic ({cubic[0]:.3g}, {cubic[1]:.3g}) ± ({stds[6]:.2g}, {stds[7]:.2g}) 1/rad^2, {ends[0]:+.2%} and "
        f"{ends[1]:+.2%} at the end of the steps ({_from_zero(result, (6, 7))} beside 0)",
    ]
    if result.quadrants is not None:
        own = np.abs(result.quadrants.sensitivity / gains)
        lines.append(
            f"  for iio.sensitivity {result.quadrants.sensitivity:g}, as the node must have it; that of x is "
            f"{own[0]:.6g} rad, of y {own[1]:.6g} rad"
        )
    return lines


def axis_gains(result: CollimatorResult) -> tuple[np.ndarray, np.ndarray]:
    """(2,) sensitivity of the x and y axis of the instrument, reading per tilt, and its standard uncertainty (2,)."""
    response, covariance = result.response, result.calibration.covariance[np.ix_([2, 4], [2, 4])]
    signs, gain = np.array([0.5, -0.5]), response.gain
    slopes = np.stack([1 + signs * response.gain_difference, abs(gain) * signs], axis=1)
    return gain * slopes[:, 0], np.sqrt(np.einsum("ai,ij,aj->a", slopes, covariance, slopes))


def _from_zero(result: CollimatorResult, which: Sequence[int]) -> str:
    """Whether these numbers differ from 0: probability of as much by chance."""
    values, part = numbers_of(result.response)[list(which)], result.calibration.covariance[np.ix_(which, which)]
    return f"p-value {chi_square_tail(float(values @ np.linalg.solve(part, values)), len(which)):.1g}"


def _drift(result: CollimatorResult) -> list[str]:
    if result.calibration.fit.rate is None:
        return []
    rate, std = (values * ARCSEC * HOUR / abs(result.response.gain) for values in result.calibration.fit.rate)
    return [
        f"  drift while it stands ({rate[0]:.2f}, {rate[1]:.2f}) ± ({std[0]:.2f}, {std[1]:.2f}) arcsec/h; the zero is "
        "that of the middle of the time"
    ]


def _residuals(result: CollimatorResult) -> list[str]:
    """What is left, as Lou et al. 2019 have it in Figure 5."""
    found, used = result.calibration, result.calibration.used
    after, raw = (np.abs(values[used]).max(axis=0) * ARCSEC for values in (found.residual, found.uncalibrated))
    explained, expanded = found.plausible_residual * ARCSEC, result.expanded * ARCSEC
    single = np.hypot(expanded, COVERAGE * found.noise * ARCSEC)
    return [
        f"  residual x ±{after[0]:.2f}, y ±{after[1]:.2f} arcsec (reference and noise explain ±{explained[0]:.2f}, "
        f"±{explained[1]:.2f}); before ±{raw[0]:.2f}, ±{raw[1]:.2f}",
        f"  expanded uncertainty (95 %) of a calibrated reading x {expanded[0]:.2f}, y {expanded[1]:.2f} arcsec; of a "
        f"single one with its noise {single[0]:.2f}, {single[1]:.2f}",
    ]
