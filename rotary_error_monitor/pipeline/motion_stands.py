"""Error motion that stands to the last bit while the rotor turns: what no estimate of a rotor in motion does."""

from __future__ import annotations

import math

import numpy as np

from rotary_error_monitor.arrays import Mask
from rotary_error_monitor.metrology.error_motion import ErrorMotion

LASTS_NS = 500_000_000
"""For how long all components have the same bits, ns, before they are taken for stuck."""

TURNED = 0.05
"""By how much the rotor has turned meanwhile, rad: eccentricity, graduation and noise change each bit long before."""

LEAST = 2
"""Components that stand together at least: one alone, such as that of an axial probe of coarse resolution, may."""


class MotionStands:
    """Tells ticks whose components stand to the last bit, all that are observable, though the rotor has turned.

    A rotor at rest may show the same bits for as long as it rests, by instruments of coarse resolution; so may an
    estimate that is handed on more than once. Neither turns meanwhile.
    """

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self.forget()

    def forget(self) -> None:
        """Forget what was before."""
        self._last: ErrorMotion | None = None
        self._since = (0, 0.0)  # time (ns) and rotation (rad) from which on the bits are the same
        self._has_turned = False

    def judge(self, motion: ErrorMotion) -> Mask | None:
        """(m,) which ticks stand for too long; none where none does."""
        stands, stuck = self._stands(motion), np.zeros(len(motion.theta), np.bool_)
        times, turns = motion.times_ns.tolist(), motion.theta.tolist()
        if not stands.any():
            self._since, self._has_turned = (times[-1], turns[-1]), False
            return None
        for i, (time_ns, theta) in enumerate(zip(times, turns, strict=True)):
            if not stands[i]:
                self._since, self._has_turned = (time_ns, theta), False
                continue
            since_ns, since = self._since
            self._has_turned = self._has_turned or abs(math.remainder(theta - since, 2 * math.pi)) >= TURNED
            stuck[i] = self._has_turned and time_ns - since_ns >= LASTS_NS
        return stuck if stuck.any() else None

    def _stands(self, motion: ErrorMotion) -> Mask:
        """(m,) which ticks have the bits of the tick before."""
        before, self._last = self._last, motion.at(slice(-1, None))
        known = motion if before is None else ErrorMotion.joined((before, motion))
        components, seen = known.components, known.observable
        same = ((components[1:] == components[:-1]) | ~seen[1:]) & (seen[1:] == seen[:-1])
        stands: Mask = same.all(axis=1) & (seen[1:].sum(axis=1) >= LEAST)
        return stands if before is not None else np.concatenate([[False], stands])
