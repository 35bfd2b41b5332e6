"""How much less rows of a stage's recording weigh than the stated noise of their sensors says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.kinds.stage.load_cells import ForceNoise
from rotary_error_monitor.kinds.stage.rounding import repeated_squares
from rotary_error_monitor.sensors.library import sensor_of
from rotary_error_monitor.twin.stage import StageTwin

LOUDER = 1e-2
"""Part by which noise may be louder and be the same: far less than that by which it is known."""


def row_weights(twin: StageTwin, steps: Mapping[str, float], force_noise: ForceNoise) -> dict[str, Array]:
    """(n, fields) weight of the rows of streams that are louder than stated: one over by how much.

    They are so by their steps, see `repeated_squares`, and where a force acts by the noise of the load cell: the twin
    yields to what was read.
    """
    found = {}
    for name in twin.times:  # of a stretch of a recording, which may lack a sensor
        step, stated = steps.get(name, 0.0), sensor_of(name).noise(twin.stage, name)
        squares = repeated_squares(twin, name, step) if step else np.ones((len(twin.times[name]), 1))
        if force_noise.pushed and stated:
            squares = squares + force_noise.squares(twin, name) / stated**2
        louder = np.sqrt(squares)
        if np.max(louder, initial=0.0) > 1 + LOUDER:
            found[name] = 1 / louder
    return found
