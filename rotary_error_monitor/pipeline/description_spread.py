"""How far the description of the monitored axis is from what is measured there: its uncertainty, should it stand in."""

from __future__ import annotations

import math

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.machine.error_model import described_components, stated_deviations
from rotary_error_monitor.machine.kinematics import MachineModel

MEMORY = 60.0
"""Time over which differences are averaged, s: some turns of a slow axis."""

ENOUGH = 1.0
"""Time of measurement, s, from which the differences count and not what was assumed before them."""

AROUND = 64
"""Positions over a turn at which the size of a description is found."""


class DescriptionSpread:
    """Standard uncertainty of each described component of the monitored axis, m and rad.

    Before anything was measured it is what the machine file states, or else what the limits of the stage allow; a
    component that nothing measures is as uncertain as it is large. After that it is the root mean square of measured
    minus described, and not less than stated.
    """

    def __init__(self, model: MachineModel, limits: StageLimits) -> None:
        """Uncertainty for a machine whose monitored axis is a stage with these limits."""
        self._model = model
        self._stated = stated_deviations(model)
        self._assumed = np.where(self._stated > 0.0, self._stated, self._unstated(limits))
        self._squares = np.zeros(6)
        self._measured = np.zeros(6)
        self._last_ns = 0

    @property
    def deviations(self) -> Array:
        """(6,) standard uncertainties."""
        learned = np.sqrt(self._squares / np.maximum(self._measured, 1e-9))
        return np.where(self._measured >= ENOUGH, np.maximum(learned, self._stated), self._assumed)

    def learn(self, time_ns: int, live: Array, described: Array) -> None:
        """Take in measured and described components (6,) at a time (ns); NaN for what is not measured."""
        passed = min(max((time_ns - self._last_ns) * 1e-9, 0.0), 0.1)
        self._last_ns = time_ns
        seen = np.isfinite(live)
        keep = math.exp(-passed / MEMORY)
        square = np.where(seen, live - described, 0.0) ** 2
        self._squares = np.where(seen, keep * self._squares + passed * square, self._squares)
        self._measured = np.where(seen, keep * self._measured + passed, self._measured)

    def _unstated(self, limits: StageLimits) -> Array:
        """Rectangular within what the stage can do at most; axial motion, which nothing limits, by its own size."""
        radial, tilt, turn = limits.radial, limits.tilt, limits.following_error
        largest = np.array([radial, radial, 0.0, tilt, tilt, turn]) / math.sqrt(3.0)
        axis = self._model.monitored
        if axis is None:
            return largest
        positions = np.zeros((AROUND, len(self._model.letters)))
        positions[:, axis] = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
        size = np.sqrt(np.mean(described_components(self._model, positions) ** 2, axis=0))
        return np.asarray(np.maximum(largest, size))
