"""The components of the monitored axis as the machine model takes them: at its body's origin, in machine directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.kernel import chosen_kernel

UNKNOWN_UNCERTAINTY = np.nan


class Carrier:
    """Carries error motion from the ring, in the stage's directions, to the body's origin in the machine's.

    What depends on a component that is not observable is not observable either.
    """

    def __init__(self, height: float, azimuth: float) -> None:
        """`height` (m) of the body's origin above the ring, `azimuth` (rad) from the machine's x to the stage's x."""
        self._weights = _transfer(height, azimuth)
        self._taken = self._weights != 0.0

    def components(self, motion: ErrorMotion) -> NDArray[np.float64]:
        """(m, 6) components in m and rad, NaN where not observable."""
        kernel = chosen_kernel()
        if kernel is not None:
            return kernel.components(self._weights, motion.components, motion.observable)
        missing = ~motion.observable
        known = np.where(missing, 0.0, motion.components)
        moved = np.stack([_dot(weights, known) for weights in self._weights], axis=1)
        return np.where(self._lost(missing), np.nan, moved)

    def covariance(self, motion: ErrorMotion) -> NDArray[np.float64]:
        """(m, 6, 6) covariance of the components, with NaN on the diagonal where they are not observable."""
        half = np.stack([_dot(weights, motion.covariance) for weights in self._weights], axis=2)
        full = np.stack([_dot(weights, np.moveaxis(half, 2, 1).swapaxes(1, 2)) for weights in self._weights], axis=1)
        diagonal = np.arange(6)
        lost = self._lost(~motion.observable)
        full[:, diagonal, diagonal] = np.where(lost, UNKNOWN_UNCERTAINTY, full[:, diagonal, diagonal])
        return full

    def _lost(self, missing: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.asarray((missing[:, None, :] & self._taken).any(axis=2))


def _transfer(height: float, azimuth: float) -> NDArray[np.float64]:
    """(6, 6) from components at the ring, in the stage's directions, to those at the body's origin in the machine's."""
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    abbe = np.eye(6)
    abbe[0, 4], abbe[1, 3] = height, -height
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    carried = both @ abbe
    carried[np.abs(carried) < 1e-15] = 0.0
    return np.asarray(carried)


def _dot(weights: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sum over the second axis, written out so that the bits do not depend on the batch."""
    total = np.zeros(columns.shape[:1] + columns.shape[2:])
    for i, weight in enumerate(weights):
        if weight != 0.0:
            total = total + weight * columns[:, i]
    return total
