"""Single poses whose readings the fit to all of them does not explain.

A machine of many parameters is fitted to many poses: one reading that was taken before the axes stood, or with a chip
under the probe, moves root mean squares over all poses by little, and the parameters by much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.distributions import chi_square_limit, f_tail
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM

MEDIAN_INFORMATION = 0.4
"""Information in a median of squares about a variance beside that in their mean, for normal readings."""

LEAST_CHECKED = 1e-6
"""Part of a reading's variance below which the fit follows it wholly, so that its residual tells nothing."""


@dataclass(frozen=True)
class OutlyingPose:
    """A pose that stands off from what the others let expect.

    Attributes:
        number: of the pose, from 0, in the order of the file.
        size: length of its residual over the stated noise: a part of what is wrong, for the fit follows it.
        ratio: the residual over its standard deviation, root mean square over what the fit leaves of it.
        probability: that the largest of as many clean poses would be as far off.
    """

    number: int
    size: float
    ratio: float
    probability: float


def find_outlying_poses(seen: Array, residual: Array) -> tuple[OutlyingPose, ...]:
    """Poses whose studentized residual is too large for the largest of n, worst first.

    The scale is robust, the median over all poses: outliers do not hide one another, and neither a stated noise that is
    too large hides them nor one that is too small makes them.

    Args:
        seen: (n, 3, r) orthonormal columns of what the fitted combinations of parameters move at each pose.
        residual: (n, 3) of the fit, over the stated noise.
    """
    squares, freedom = _studentized(seen, residual)
    checked = freedom > 0
    if not np.any(checked):
        return ()
    usual = np.array([chi_square_limit(0.5, each) for each in freedom[checked]])
    scale = float(np.median(squares[checked] / usual))
    if scale == 0.0:
        return ()
    known = max(1.0, MEDIAN_INFORMATION * (residual.size - seen.shape[2]))
    count, found = int(checked.sum()), []
    for number in np.flatnonzero(checked):
        mean = float(squares[number] / freedom[number])
        probability = count * f_tail(mean / scale, float(freedom[number]), known)
        if probability < FALSE_ALARM:
            size = float(np.linalg.norm(residual[number]))
            found.append(OutlyingPose(int(number), size, float(np.sqrt(mean / scale)), probability))
    return tuple(sorted(found, key=lambda pose: -pose.ratio))


def _studentized(seen: Array, residual: Array) -> tuple[Array, Array]:
    """(n,) squares of residuals (n, 3) by their covariance beside the fit, and the degrees of freedom that it leaves.

    Directions in which the fit follows a pose wholly tell nothing and do not count.
    """
    left = np.eye(3) - seen @ np.swapaxes(seen, 1, 2)
    values, vectors = np.linalg.eigh(left)
    kept = values > LEAST_CHECKED
    along = np.einsum("nji,nj->ni", vectors, residual)
    squares = np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0).sum(axis=1)
    return np.asarray(squares, dtype=np.float64), kept.sum(axis=1).astype(np.float64)
