"""Poses of a machine at the times at which offsets are computed, as the machine model takes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import MachineModel


@dataclass(frozen=True)
class TimedPoses:
    """Poses at n ticks, as the machine model takes them.

    Attributes:
        stamps: (n,) time of each tick, ns.
        positions, directions: (n, axes) in m or rad; sign of travel.
        turned: (n, axes) probability that the direction is another by then.
        age: (n,) of the joint state that they come from, s.
        temperature, temperature_deviation: (n,) °C, and its standard uncertainty, K.
        live: (n, 6) live components of the monitored axis; none where the description alone says them.
        covariance: gives the (k, 6, 6) covariance of the live components of some of the ticks.
    """

    stamps: NDArray[np.int64]
    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    turned: NDArray[np.float64]
    age: NDArray[np.float64]
    temperature: NDArray[np.float64]
    temperature_deviation: NDArray[np.float64]
    live: NDArray[np.float64] | None
    covariance: Callable[[NDArray[np.int64]], NDArray[np.float64]]

    def at(self, chosen: NDArray[np.int64]) -> TimedPoses:
        """Some of the poses."""
        return TimedPoses(
            self.stamps[chosen],
            self.positions[chosen],
            self.directions[chosen],
            self.turned[chosen],
            self.age[chosen],
            self.temperature[chosen],
            self.temperature_deviation[chosen],
            None if self.live is None else self.live[chosen],
            lambda index: self.covariance(chosen[index]),
        )

    def offsets(self, model: MachineModel) -> NDArray[np.float64]:
        """(n, 6) tool-to-workpiece offsets, m and rad."""
        return predict_tool_offset(
            model, self.positions, direction=self.directions, temperature=self.temperature, monitored=self.live
        )
