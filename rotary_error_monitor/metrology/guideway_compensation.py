"""Straightness of two feed axes compensated by a third one that never reverses (Zhou et al. 2023, Section 3).

A straightness error goes 1:1 into the ground surface. The vertical axis can take it out, but a straightness curve rises
and falls, and at each reversal the vertical axis loses its reversal error. A rotated curve serves as well, since a tilt
of the surface is no flatness error; rotated until it is monotone, it moves the vertical axis one way only. The whole
curve of a guideway is rotated, and the workpiece's part cut out of it then: one rotation serves all workpieces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.straightness import check_profile, estimate_straightness, fit_line

ROUNDED = 1e-10
"""Steps against the way of a curve, m, that come of rounding where a file states its slope with five digits."""


@dataclass(frozen=True)
class RotatedCurve:
    """An error curve turned until it is monotone.

    Attributes:
        positions: (n,) ascending, m.
        errors: (n,) the rotated curve, m.
        angle: smallest rotation that does it, rad; positive to make it rise, 0 if it was monotone before.
        rising: True if the rotated curve rises.
    """

    positions: Array
    errors: Array
    angle: float
    rising: bool


@dataclass(frozen=True)
class WorkpieceCurve:
    """A feed axis where the workpiece is.

    Attributes:
        positions: (n,) ascending, m.
        errors: (n,) its straightness there as measured, m.
        rotated: (n,) the same of the curve that was rotated as a whole, m.
        rotation: the whole rotated curve.
    """

    positions: Array
    errors: Array
    rotated: Array
    rotation: RotatedCurve


@dataclass(frozen=True)
class VerticalAxis:
    """The axis that corrects, as it is.

    Attributes:
        reversal_error: play that a reversal of the axis has to take up first, m.
        positions: (k,) ascending axis positions of `deviations`, m.
        deviations: (k,) positioning deviations there, m.
    """

    reversal_error: float
    positions: Array
    deviations: Array

    def follow(self, commands: Array, *, rising: bool) -> Array:
        """(n, m) positions reached along m passes of n commands each, m.

        Every pass begins with the play taken up in the sense that `rising` says, as after an approach from that side.
        """
        reached = np.empty_like(commands)
        half = self.reversal_error / 2
        state = commands[0] - half if rising else commands[0] + half
        for row, command in enumerate(commands):
            state = np.clip(state, command - half, command + half)
            reached[row] = state
        return reached + np.interp(reached, self.positions, self.deviations)


@dataclass(frozen=True)
class GroundSurface:
    """A ground workpiece.

    Attributes:
        heights: (n, m) heights over x and z less their least squares plane, m.
        flatness: their range, m.
        reversals: how often the vertical axis reversed while grinding.
    """

    heights: Array
    flatness: float
    reversals: int


@dataclass(frozen=True)
class GrindingComparison:
    """Flatness before compensation, after it as measured, and after it with the rotated curves."""

    before: GroundSurface
    unrotated: GroundSurface
    rotated: GroundSurface


def rotate_monotone(positions: Array, errors: Array) -> RotatedCurve:
    """The error curve (n,) m over positions (n,) m, rotated by the smallest angle that makes it monotone.

    At the microradians of a guideway the rotation adds a slope; positions change by parts per million of the errors.
    The rotated curve is level where the measured one was steepest the other way.

    Raises:
        InputError: positions that do not ascend, or numbers that are not finite.
    """
    check_profile(positions, errors)
    steps = np.diff(positions)
    if np.any(steps <= 0):
        at = int(np.argmin(steps > 0))
        raise InputError(f"positions must ascend, but {positions[at]:g} m comes before {positions[at + 1]:g} m")
    slopes = np.diff(errors) / steps
    to_rise, to_fall = max(0.0, -float(slopes.min())), max(0.0, float(slopes.max()))
    rising = to_rise <= to_fall
    slope = to_rise if rising else -to_fall
    rotated = errors + slope * (positions - positions.mean())
    # Rounding may leave a step of the wrong sign where the slope is zero.
    rotated = np.maximum.accumulate(rotated) if rising else np.minimum.accumulate(rotated)
    return RotatedCurve(positions, rotated, math.atan(slope), rising)


def rotate_as_stated(positions: Array, errors: Array) -> RotatedCurve:
    """The error curve (n,) m over positions (n,) m as it is where it is monotone, and else rotated from level.

    So a curve that a machine file states with its rotation stays as it corrects the machine, and one that it states
    without gets the rotation that it would be given.

    Raises:
        InputError: positions that do not ascend, or numbers that are not finite.
    """
    check_profile(positions, errors)
    steps = np.diff(errors)
    for rising, against in ((True, -steps), (False, steps)):
        if against.max() <= ROUNDED and np.ptp(errors) > 0:
            along = np.maximum.accumulate(errors) if rising else np.minimum.accumulate(errors)
            return RotatedCurve(positions, along, math.atan(fit_line(positions, errors).slope), rising)
    return rotate_monotone(positions, estimate_straightness(positions, errors).deviations)


def cut_workpiece(positions: Array, errors: Array, rotation: RotatedCurve, at: Array) -> WorkpieceCurve:
    """The part at ascending positions `at` (n,) of a guideway's errors (k,) and its rotated curve, m.

    Raises:
        InputError: the workpiece reaches beyond the measured part of the axis.
    """
    rotated = cut_curve(rotation.positions, rotation.errors, at)
    return WorkpieceCurve(at, cut_curve(positions, errors, at), rotated, rotation)


def predict_error_matrix(errors_x: Array, errors_z: Array) -> Array:
    """(n, m) vertical error over x and z: `E(i, j) = eX(i) + eZ(j)` (Zhou et al. 2023, Equation 2), m."""
    return errors_x[:, None] + errors_z[None, :]


def cut_curve(positions: Array, errors: Array, at: Array) -> Array:
    """(n,) the curve at ascending positions `at` (n,) m: the part that the workpiece sees.

    Raises:
        InputError: the workpiece reaches beyond the measured part of the axis.
    """
    if at[0] < positions[0] or at[-1] > positions[-1]:
        raise InputError(
            f"the workpiece from {at[0] * 1e3:g} mm to {at[-1] * 1e3:g} mm reaches beyond the straightness measured "
            f"from {positions[0] * 1e3:g} mm to {positions[-1] * 1e3:g} mm"
        )
    return np.interp(at, positions, errors)


def predict_corrections(x: WorkpieceCurve, z: WorkpieceCurve) -> Array:
    """(n, m) what the vertical axis adds to its position over x and z, m: the opposite of the rotated error."""
    return -predict_error_matrix(x.rotated, z.rotated)


def estimate_flatness(x: Array, z: Array, heights: Array) -> tuple[float, Array]:
    """Range of heights (n, m) over x (n,), z (m,) about their least squares plane, and the deviations from it, m."""
    u, w = x - x.mean(), z - z.mean()
    deviations = heights - heights.mean()
    slope_x = float((u[:, None] * deviations).sum() / (len(w) * (u @ u)))
    slope_z = float((w[None, :] * deviations).sum() / (len(u) * (w @ w)))
    deviations = deviations - slope_x * u[:, None] - slope_z * w[None, :]
    return float(np.ptp(deviations)), deviations


def count_reversals(commands: Array) -> int:
    """How often motion along the passes (columns) of (n, m) commands turns back; standing still is no reversal."""
    total = 0
    for column in np.sign(np.diff(commands, axis=0)).T:
        moving = column[column != 0]
        total += int(np.count_nonzero(np.diff(moving)))
    return total


def simulate_grinding(x: Array, z: Array, truth: Array, corrections: Array | None, axis: VerticalAxis) -> GroundSurface:
    """Surface ground along passes in +x at each z.

    Arguments: x (n,), z (m,), vertical error of the guideways `truth` (n, m) and `corrections` (n, m) of the vertical
    axis, None to leave it still; all m. Between passes the wheel is clear of the workpiece and approaches in the sense
    in which the pass then moves, as a program for compensated grinding does.
    """
    if corrections is None:
        flatness, heights = estimate_flatness(x, z, truth)
        return GroundSurface(heights, flatness, 0)
    rising = bool(np.sum(np.diff(corrections, axis=0)) >= 0)
    flatness, heights = estimate_flatness(x, z, truth + axis.follow(corrections, rising=rising))
    return GroundSurface(heights, flatness, count_reversals(corrections))


def compare_compensation(x: WorkpieceCurve, z: WorkpieceCurve, axis: VerticalAxis) -> GrindingComparison:
    """Grinding without compensation, with the error curves as measured, and with them rotated to be monotone, m."""
    truth = predict_error_matrix(x.errors, z.errors)
    surfaces = [
        simulate_grinding(x.positions, z.positions, truth, corrections, axis)
        for corrections in (None, -truth, predict_corrections(x, z))
    ]
    return GrindingComparison(*surfaces)
