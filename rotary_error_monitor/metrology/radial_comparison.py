"""Radial error motion held against a reference on an artefact (Lou et al. 2019, Figures 13-15)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import (
    ErrorMotion,
    radial_covariance_at,
    radial_error_motion_at,
    rotate,
)
from rotary_error_monitor.signals.resampling import resample

MAX_GAP_NS = 20_000_000

BOUND = 1.959964
"""Standard deviations on either side that hold 95 % of a normal distribution."""


@dataclass(frozen=True)
class RadialComparison:
    """Estimated radial error motion minus the reference's along p directions, at m times.

    Attributes:
        stamp_ns: (m,) timestamp (ns).
        estimate: (m, p) radial error motion at the reference's height, m; p is 2 of two axes, 1 of a probe.
        reference: (m, p) the reference's, its artefact's eccentricity removed, m.
        std: (m, p) standard deviation of the difference by propagation, m.
    """

    stamp_ns: Times
    estimate: Array
    reference: Array
    std: Array

    @property
    def rms(self) -> float:
        """Root mean square of the difference, the largest of the components, m."""
        return float(np.sqrt(np.mean((self.estimate - self.reference) ** 2, axis=0)).max())

    @property
    def maximum(self) -> float:
        """Largest difference, m."""
        return float(np.abs(self.estimate - self.reference).max())

    @property
    def inside(self) -> float:
        """Part of the differences inside their 95 % bounds."""
        return float(np.mean(np.abs(self.estimate - self.reference) <= BOUND * self.std))

    def along(self, axis: int) -> RadialComparison:
        """The same along one of the directions."""
        one = slice(axis, axis + 1)
        return RadialComparison(self.stamp_ns, self.estimate[:, one], self.reference[:, one], self.std[:, one])


@dataclass(frozen=True)
class RadialAgreement:
    """How far estimate and reference differ: what `RadialComparison` says by the same names."""

    rms: float
    maximum: float
    inside: float

    @staticmethod
    def of(comparisons: Iterable[RadialComparison]) -> RadialAgreement | None:
        """Of comparisons at other times, one behind another; None without any."""
        squares, count, maximum, inside = np.zeros(2), 0, 0.0, 0.0
        for each in comparisons:
            squares += ((each.estimate - each.reference) ** 2).sum(axis=0)
            count += len(each.stamp_ns)
            maximum = max(maximum, each.maximum)
            inside += each.inside * len(each.stamp_ns)
        return RadialAgreement(float(np.sqrt(squares / count).max()), maximum, inside / count) if count else None


def compare_radial(
    stamp_ns: Times, motion: ErrorMotion, reference: RadialReference, times_ns: Times, radial: Array, period_ns: int
) -> RadialComparison:
    """Compare at the times of the estimate where both are known.

    Args:
        stamp_ns: (n,) times of the estimate, ticks of `period_ns`.
        motion: error motion at these times.
        reference: where the reference stands.
        times_ns: (k,) times of the reference's samples.
        radial: (k, 2) the samples, m.
        period_ns: distance of two estimates, ns.

    Raises:
        InputError: at no time are both known.
    """
    sampled = resample(times_ns, radial, stamp_ns, period_ns, MAX_GAP_NS)
    both = sampled.valid & motion.observable[:, [0, 1, 3, 4]].all(axis=1)
    if not both.any():
        raise InputError(
            "reference and estimate have no time in common, or radial and tilt error motion are not observable"
        )
    spread = radial_covariance_at(motion.covariance[both], reference.height)
    noise = sampled.gain[both] * reference.noise**2
    return RadialComparison(
        stamp_ns[both],
        radial_error_motion_at(motion.components[both], reference.height),
        sampled.values[both] - rotate(reference.artefact_eccentricity, motion.theta[both]),
        np.sqrt(np.stack([spread[:, 0, 0], spread[:, 1, 1]], axis=1) + noise[:, None]),
    )
