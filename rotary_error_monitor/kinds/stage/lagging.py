"""Parts of a stage that warm later than its thermometer: a thermal mass behind a thermal resistance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.twin.stage import StageInputs

LAGS = (1 / 16, 1 / 4, 1.0)
"""Time constants in parts of the recording, in four-fold steps: what is much shorter does not show, and what is longer
is a drift."""

_GRID = 2000
"""Instants of a recording between which a course is straight."""

Course = Callable[[Array], Array]


def late(warming: Course, duration: float, lag: float) -> Course:
    """The warming (n,), K, at times (n,), s, of what follows a warming within `lag` s.

    It begins as warm as that is then. Response of first order to each change on a grid.
    """
    grid = np.linspace(0.0, duration, _GRID)
    outside = warming(grid)
    passed = np.arange(0.5, _GRID - 1) * duration / (_GRID - 1)
    followed = np.convolve(np.diff(outside), -np.expm1(-passed / lag))[: _GRID - 1]
    return partial(_interpolated, grid, outside[0] + np.concatenate([[0.0], followed]))


def all_late(inputs: StageInputs, duration: float, lag: float) -> StageInputs:
    """The same inputs with every warming that late."""
    places = {place: late(warming, duration, lag) for place, warming in inputs.warmings.items()}
    return replace(inputs, warming=late(inputs.warming, duration, lag), warmings=places)


def _interpolated(grid: Array, values: Array, time: Array) -> Array:
    return np.interp(time, grid, values)
