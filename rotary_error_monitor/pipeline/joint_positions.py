"""Where a machine's axes stand, and how far they go from one joint state to another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.units import TURN


class JointPositions(NamedTuple):
    """A joint state: stamp, timestamp (ns), and position of each axis, m or rad."""

    stamp_ns: int
    row: Array


class AxisSteps:
    """Steps of axes from differences of their positions: a rotary one may be told modulo a turn."""

    def __init__(self, axes: Sequence[Axis]) -> None:
        self._per_turn = np.array([1.0 / TURN if axis.kind == "rotary" else 0.0 for axis in axes])

    def __call__(self, difference: Array, which: slice | NDArray[np.intp] = slice(None)) -> Array:
        """(…, axes) steps of all axes, or (k,) of those whose numbers are `which`, m or rad."""
        return np.asarray(difference - TURN * np.rint(difference * self._per_turn[which]))
