"""Which head causes a contradiction: told by what the stage can do, then by how its motion goes on."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.agreement import Isolation, isolate_head, isolate_implausible, isolate_step
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.pipeline.evidence import LONG, PERSISTENT, SHORT

RECENT = 30
"""Changes of each kind that are looked at: more of them would be noise from before the fault."""


Shown: TypeAlias = tuple[tuple[float, float, float, float], list[float]]
"""What heads show in a window: rotation and distance from the command, rad, two components of the radial error motion,
m; and their contradiction (P,), rad. Lists, for they are kept: a view would keep the block that it is of."""


def wrong_head(layout: HeadLayout, history: Iterable[Shown], limits: StageLimits, radius: float) -> Isolation | None:
    """The wrong one of the heads of a layout by what they showed, window by window; None where nothing tells it.

    Args:
        layout: of the heads.
        history: what they showed.
        limits: of the stage.
        radius: of the ring, m.
    """
    shown, parity = zip(*history, strict=True)
    # the angle by which the readings differ, also where it is large (Lou et al. 2019, Equation 3)
    motion = np.array([(theta, ecc, math.atan(x / radius), math.atan(y / radius)) for theta, ecc, x, y in shown])
    found = _isolations(layout, motion, np.array(parity), limits, radius)
    return next((each for each in found if each is not None), None)


def _isolations(
    layout: HeadLayout, motion: Array, parity: Array, limits: StageLimits, radius: float
) -> Iterable[Isolation | None]:
    if len(motion) >= PERSISTENT:
        last = slice(-PERSISTENT, None)
        radial = limits.radial / radius
        most = np.array([limits.following_error + limits.latency * limits.speed, radial, radial])
        yield isolate_implausible(layout, motion[last, 1:], parity[last], most)
    steps = slice(-RECENT * SHORT, None)
    for lag in (1, 2):  # a step within a window shows its rest in the next one
        yield isolate_step(layout, motion[steps, 1:], parity[steps], lag)
    for lag in _lags(motion[:, 0]):
        recent = slice(-RECENT * lag, None)
        yield isolate_head(layout, motion[recent, 1:], parity[recent], lag)


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
