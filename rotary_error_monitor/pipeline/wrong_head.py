"""Which head causes a contradiction: told by what the stage can do, then by how its motion goes on."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.agreement import (
    Isolation,
    isolate_drift,
    isolate_head,
    isolate_implausible,
    isolate_step,
)
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.pipeline.evidence import LONG, PERSISTENT, SHORT
from rotary_error_monitor.pipeline.head_history import HeadHistory

RECENT = 30
"""Changes of each kind that are looked at: more of them would be noise from before the fault."""


def wrong_head(
    layout: HeadLayout, history: HeadHistory, limits: StageLimits, radius: float, *, slow: bool = True
) -> Isolation | None:
    """The wrong one of the heads of a layout by what they showed, window by window; None where nothing tells it.

    Args:
        layout: of the heads.
        history: what they showed.
        limits: of the stage.
        radius: of the ring, m.
        slow: whether a fault may have come too slowly to show in what the motion does meanwhile.
    """
    found = _isolations(layout, history, limits, radius)
    told = next((each for each in found if each is not None), None)
    if told is None and slow:
        shown, parity = history.unrepeated()
        return isolate_drift(layout, _motion(shown, radius), parity)
    return told


def _isolations(
    layout: HeadLayout, history: HeadHistory, limits: StageLimits, radius: float
) -> Iterable[Isolation | None]:
    shown, parity = history.all_shown()
    motion = _motion(shown, radius)
    if len(motion) >= PERSISTENT:
        last = slice(-PERSISTENT, None)
        radial = limits.radial / radius
        most = np.array([limits.following_error + limits.latency * limits.speed, radial, radial])
        yield isolate_implausible(layout, motion[last], parity[last], most)
    steps = slice(-RECENT * SHORT, None)
    for lag in (1, 2):  # a step within a window shows its rest in the next one
        yield isolate_step(layout, shown[steps, 0], motion[steps], parity[steps], lag)
    for lag in _lags(shown[:, 0]):
        recent = slice(-RECENT * lag, None)
        yield isolate_head(layout, motion[recent], parity[recent], lag)


def _motion(shown: Array, radius: float) -> Array:
    """(n, 3) rotation against the command and radial components, rad: the angle by which the readings differ.

    Also where it is large (Lou et al. 2019, Equation 3).
    """
    return np.column_stack([shown[:, 1], np.arctan(shown[:, 2:] / radius)])


def _lags(theta: Array) -> Iterable[int]:
    """Steps over which to look for changes: one window, 0.1 s, 1 s, and a turn, where what turns is the same."""
    yield from (lag for lag in (1, SHORT, LONG) if len(theta) > 2 * lag)
    turned = np.flatnonzero(np.abs(theta[-1] - theta) >= 2 * np.pi)
    if len(turned):
        lag = len(theta) - 1 - int(turned[-1])
        if lag > SHORT and len(theta) > 2 * lag:
            yield lag


def fault_in_words(fault: Array, resolution: float) -> str:
    """What a fault of a head (n,) is, rad, whose counts are `resolution` apart, rad."""
    recent = fault[-2:]  # the windows before may hold but a part of it
    spread, mean = float(recent.std()), float(recent.mean())
    if spread < 0.2 * abs(mean):
        return f"off by {mean / resolution:.4g} counts against the others"
    size = math.sqrt(float(np.mean(recent**2)))
    return f"differs from the others by {size / resolution:.3g} counts (root mean square)"
