"""Calibration of an instrument of two axes by steps of a reference: which steps count, and what is then left.

A step at which the detector is at its end, one that does not fit the others, and lost motion of the reference are told
apart before anything is believed; the fit itself is that of `two_axis_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.distributions import chi_square_limit, chi_square_tail, f_limit
from rotary_error_monitor.metrology.positioning import SCALE_EFFICIENCY
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.two_axis_fit import (
    ReferenceUncertainty,
    TwoAxisFit,
    fit_steps,
    numbers_of,
    response_from,
)
from rotary_error_monitor.metrology.two_axis_steps import StepReadings
from rotary_error_monitor.signals.reading_noise import MEDIAN_OF_ABSOLUTE_NORMAL

COVERAGE = float(ndtri(0.975))
"""Coverage factor of an expanded uncertainty of 95 % where the variances are known (GUM, Annex G)."""

FEWEST_SETTINGS = 5
"""Different settings that are needed: 6 numbers from 4 would leave no check of one axis, and no bend shows."""

LEAST_ASPECT = 0.05
"""Part of the longer axis of the steps that the shorter has at least; a wrong mounting by 3 degrees makes as much."""

FEWEST_READINGS = 10
"""Degrees of freedom from which readings within steps tell their noise better than the description."""

MOST_OUTLIERS = 0.25
"""Part of the steps that may stand off; where it is more, no model fits and the residual says so."""

LEAST_VARIANCE = 1e-300
"""By which nothing is divided that is 0."""

SIGMAS = 4.0
"""Standard deviations by which readings at the end of a detector may differ from one another."""


@dataclass(frozen=True)
class InstrumentPrior:
    """What is known of the instrument before, in rad of what it reads.

    Attributes:
        noise: standard deviation of a reading, where the steps do not tell it.
        resolution: step of a reading.
        slow: standard deviation of noise that lasts longer than a step.
    """

    noise: float
    resolution: float
    slow: float = 0.0


@dataclass(frozen=True)
class TwoAxisCalibration:
    """What steps of a reference say of an instrument of two axes.

    Attributes:
        steps: k of them.
        fit: of those that are `used` (k,).
        response: the instrument's, with a positive gain.
        covariance: (8, 8) of its numbers, in the order of `two_axis_fit.NAMES`.
        short: steps that read less than was shown, at an end of the detector.
        outliers: steps that do not fit the others, the worst first.
        all_steps: fit with the outliers in it; the same as `fit` where there are none.
        repeat: (2,) by how much more visits of a setting scatter than readings within them say; 1 where they do not.
        noise: (2,) standard deviation of a single reading, over the gain, rad.
        variances: (k, 2) of the mean readings by noise, rad^2.
        reference: how sure that is.
    """

    steps: StepReadings
    fit: TwoAxisFit
    response: Response
    covariance: Array
    used: Mask
    short: tuple[int, ...]
    outliers: tuple[int, ...]
    all_steps: TwoAxisFit
    repeat: Array
    noise: Array
    variances: Array
    reference: ReferenceUncertainty

    @property
    def stds(self) -> Array:
        """(8,) standard uncertainties of the response's numbers."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def probability(self) -> float:
        """Of so much being left by chance, if reference and noise are as stated."""
        return chi_square_tail(self.fit.chi_square, self.fit.freedom)

    @property
    def residual(self) -> Array:
        """(k, 2) calibrated mean readings less what the reference tells, rad; drift and lost motion taken off."""
        lost = self.fit.lost[0] * self.steps.directions
        seen = self.fit.fitted + self.fit.residual
        return self.response.corrected(seen) - self.steps.reference - lost

    @property
    def uncalibrated(self) -> Array:
        """(k, 2) mean readings less what the reference tells, both from their middle, rad: without any calibration."""
        off = self.steps.means - self.steps.reference
        return np.asarray(off - off[self.used].mean(axis=0))

    @property
    def plausible_residual(self) -> Array:
        """(2,) what the largest residual of the used steps stays below in 95 % of such calibrations, rad."""
        own = np.sqrt(self.variances[self.used].max(axis=0) / self.response.gain**2 + self.reference.step**2)
        return np.asarray(own * -ndtri(0.025 / int(self.used.sum())))

    @property
    def lost_motion(self) -> tuple[int, ...]:
        """Axes along which the reference reads apart by the side from which it came, at `FALSE_ALARM`."""
        value, std = self.fit.lost
        return tuple(k for k in range(2) if abs(value[k]) > -ndtri(FALSE_ALARM / 4) * std[k] > 0)

    @property
    def reach(self) -> tuple[Array, NDArray[np.bool_]]:
        """(2, 2) how far used steps read along each axis (row) to its negative and positive end, over the gain, rad.

        And (2, 2) whether steps beyond fell short.
        """
        readings = self.steps.means / self.response.gain
        ends = np.stack([-readings[self.used].min(axis=0), readings[self.used].max(axis=0)], axis=1)
        found = np.zeros((2, 2), np.bool_)
        for step in self.short:
            axis, end = _end_of(self.fit, self.used, step)
            found[axis, end] = True
        return ends, found

    def expanded(self, tilts: Array) -> Array:
        """(m, 2) expanded uncertainty (95 %) of calibrated readings of tilts (m, 2), rad, without noise of readings."""
        numbers, readings = numbers_of(self.response), self.response.readings(tilts)
        moved = np.zeros((*tilts.shape, len(numbers)))
        for k, std in enumerate(self.stds):
            for sign in (1, -1) if std > 0 else ():
                near = response_from(numbers + sign * 0.1 * std * (np.arange(len(numbers)) == k))
                moved[..., k] += sign * near.corrected(readings) / (0.2 * std)
        return np.asarray(COVERAGE * np.sqrt(np.einsum("mai,ij,maj->ma", moved, self.covariance, moved)))


def calibrate_two_axes(
    steps: StepReadings, instrument: InstrumentPrior, reference: ReferenceUncertainty
) -> TwoAxisCalibration:
    """The response of an instrument from steps of a reference.

    Raises:
        InputError: too few settings, one axis moved only, or axes of the wrong hand.
    """
    _check_settings(steps)
    spread, freedom = steps.spread()
    noise = spread if freedom >= FEWEST_READINGS else np.full(2, instrument.noise)
    variances = steps.variances(noise, instrument.resolution) + instrument.slow**2
    flat = _flat_ends(steps, np.sqrt(variances), instrument.resolution, reference)
    _check_settings(steps, ~flat)
    fit = fit_steps(steps, ~flat, variances, reference)
    repeat = _repeat(steps, fit, variances, ~flat)
    if (repeat > 1).any():
        variances = variances * repeat**2
        fit = fit_steps(steps, ~flat, variances, reference)
    chance = FALSE_ALARM / int((~flat).sum())
    limit = float(chi_square_limit(chance, 2) if freedom < FEWEST_READINGS else 2 * f_limit(chance, 2, freedom))
    outliers, used, fit = _without_outliers(steps, fit, ~flat, limit, variances, reference)
    short = [step for step in outliers if _is_short(fit, used, step)]
    outliers = [step for step in outliers if step not in short]
    all_steps = fit
    if outliers:
        all_steps = fit_steps(steps, used | np.isin(np.arange(len(used)), outliers), variances, reference)
    response = fit.response()
    return TwoAxisCalibration(
        steps,
        fit,
        response,
        fit.response_covariance(reference),
        used,
        tuple(sorted([*np.flatnonzero(flat).tolist(), *short])),
        tuple(outliers),
        all_steps,
        repeat,
        np.hypot(noise, instrument.resolution / np.sqrt(12)) / response.gain,
        variances,
        reference,
    )


def _check_settings(steps: StepReadings, used: Mask | None = None) -> None:
    """Hold that there are steps enough, along both axes.

    Raises:
        InputError: they do not do.
    """
    used = np.ones(len(steps.names), np.bool_) if used is None else used
    left = "" if used.all() else f" are left without {int((~used).sum())} at the end of the detector"
    count = len(np.unique(steps.settings[used]))
    if count < FEWEST_SETTINGS:
        raise InputError(f"{count} different settings{left}; expected {FEWEST_SETTINGS} or more, along both axes")
    points = steps.reference[used] - steps.reference[used].mean(axis=0)
    long, short = np.linalg.svd(points, compute_uv=False)
    if short < LEAST_ASPECT * long:
        spans = np.ptp(points, axis=0)
        how = "only one axis moved" if spans.min() < LEAST_ASPECT * spans.max() else "both axes moved together only"
        raise InputError(
            f"{how}: reference x spans {spans[0]:.4g} rad and y {spans[1]:.4g} rad{left}; expected steps along x and "
            "steps along y, for roll and cross-coupling show in these alone"
        )


def _flat_ends(steps: StepReadings, stds: Array, resolution: float, reference: ReferenceUncertainty) -> Mask:
    """(k,) steps whose reading stands at the end of an axis though the reference moves on."""
    means = steps.means
    ends: dict[tuple[int, int], Mask] = {}
    for axis in range(2):
        wide = max(resolution, SIGMAS * float(stds[:, axis].max()))
        for sign in (1, -1):
            outwards = sign * means[:, axis]
            ends[axis, sign] = np.asarray(outwards >= outwards.max() - wide)
    inner = ~np.any(list(ends.values()), axis=0)
    if len(np.unique(steps.settings[inner])) < FEWEST_SETTINGS:
        return np.zeros(len(means), np.bool_)
    design = np.column_stack([np.ones(int(inner.sum())), steps.reference[inner]])
    found = np.linalg.lstsq(design, means[inner], rcond=None)[0]
    shown = np.column_stack([np.ones(len(means)), steps.reference]) @ found
    flat = np.zeros(len(means), np.bool_)
    for (axis, _), group in ends.items():
        doubt = reference.step * float(np.hypot(*found[1:, axis]))
        wide = max(resolution, SIGMAS * float(stds[:, axis].max())) + SIGMAS * doubt
        if np.ptp(shown[group, axis]) > 2 * wide:
            flat |= group
    return flat


def _repeat(steps: StepReadings, fit: TwoAxisFit, variances: Array, used: Mask) -> Array:
    """(2,) by how much more visits of a setting scatter than `variances` (k, 2) say, by a median for outliers.

    1 where they do not, or hardly a setting is visited again.
    """
    off, freedom, settings = [], 0, steps.settings
    for setting in np.unique(settings[used]):
        visits = used & (settings == setting)
        count = int(visits.sum())
        if count > 1:
            apart = fit.residual[visits] - fit.residual[visits].mean(axis=0)
            off.append(np.abs(apart) / np.sqrt(np.maximum(variances[visits], LEAST_VARIANCE) * (1 - 1 / count)))
            freedom += count - 1
    if freedom < FEWEST_READINGS:
        return np.ones(2)
    ratio = np.median(np.concatenate(off), axis=0) / MEDIAN_OF_ABSOLUTE_NORMAL
    most = 1 - ndtri(FALSE_ALARM) / np.sqrt(2 * SCALE_EFFICIENCY * freedom)
    return np.where(ratio > most, ratio, 1.0)


def _without_outliers(
    steps: StepReadings, fit: TwoAxisFit, used: Mask, limit: float, variances: Array, reference: ReferenceUncertainty
) -> tuple[list[int], Mask, TwoAxisFit]:
    """Steps whose chi-square against the others exceeds a limit, the worst first, those left (k,), their fit."""
    found: list[int] = []
    while len(found) < MOST_OUTLIERS * len(used):
        worst = int(np.argmax(fit.deletion))
        left = used & (np.arange(len(used)) != worst)
        if fit.deletion[worst] <= limit or len(np.unique(steps.settings[left])) < FEWEST_SETTINGS:
            break
        found.append(worst)
        used, fit = left, fit_steps(steps, left, variances, reference)
    return found, used, fit


def _end_of(fit: TwoAxisFit, used: Mask, step: int) -> tuple[int, int]:
    """Axis and end (0 negative, 1 positive) beyond which a step lies farthest, over how far used steps lie."""
    from_middle = fit.fitted - fit.values[:2]
    ends = np.where(from_middle[step] > 0, from_middle[used].max(axis=0), -from_middle[used].min(axis=0))
    over = np.abs(from_middle[step]) / ends
    axis = int(np.argmax(over))
    return axis, int(from_middle[step, axis] > 0)


def _is_short(fit: TwoAxisFit, used: Mask, step: int) -> bool:
    """Whether a step lies beyond all that fit along an axis, and reads less of it than was shown."""
    axis, end = _end_of(fit, used, step)
    sign = 1 if end else -1
    beyond = sign * fit.fitted[step, axis] > (sign * fit.fitted[used, axis]).max()
    return bool(beyond and sign * fit.residual[step, axis] < 0)
