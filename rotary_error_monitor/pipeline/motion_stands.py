"""Error motion that repeats itself to the last bit while the rotor turns: no estimate of a rotor in motion does."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion

LASTS_NS = 500_000_000
"""For how long all components have bits that were there before, ns, before they are taken for stuck."""

TURNED = 0.05
"""By how much the rotor has turned meanwhile, rad: eccentricity, graduation and noise change each bit long before."""

LEAST = 2
"""Components that repeat together at least: one alone, such as that of an axial probe of coarse resolution, may."""

LONGEST = 64
"""Ticks after which the same come again at most: who is stuck may repeat a tick, or a whole block of them."""


class MotionStands:
    """Tells ticks whose components are those of so many ticks before, all that are observable, though the rotor turned.

    It is always the same number of ticks, 1 for what stands: readings of coarse instruments come back by chance, not in
    order. A rotor at rest may show the same bits for as long as it rests; so may an estimate that is handed on more
    than once. Neither turns meanwhile.
    """

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self.forget()

    def forget(self) -> None:
        """Forget what was before."""
        nothing = np.full((LONGEST, len(COMPONENTS)), np.nan)  # which equals nothing
        self._before: deque[tuple[Array, Mask]] = deque([(nothing, np.zeros(nothing.shape, np.bool_))])
        self._kept = LONGEST  # ticks of them, as many at least
        self._sums: list[float] = []  # of the components of each of the last ticks
        # by the number of ticks, last first
        self._since_ns, self._since = np.zeros(LONGEST, np.int64), np.zeros(LONGEST)
        self._has_turned = np.zeros(LONGEST, np.bool_)

    def judge(self, motion: ErrorMotion) -> Mask | None:
        """(m,) which ticks repeat others for too long; none where none does."""
        repeats = self._repeats(motion) if self._may_repeat(motion) else None
        self._keep(motion)
        if repeats is None or not repeats.any():
            self._since_ns[:], self._since[:], self._has_turned[:] = motion.times_ns[-1], motion.theta[-1], False
            return None
        stuck = np.zeros(len(motion.theta), np.bool_)
        for i, (time_ns, theta) in enumerate(zip(motion.times_ns.tolist(), motion.theta.tolist(), strict=True)):
            new = ~repeats[i]
            self._since_ns[new], self._since[new], self._has_turned[new] = time_ns, theta, False
            away = theta - self._since
            self._has_turned |= np.abs(away - 2 * np.pi * np.rint(away / (2 * np.pi))) >= TURNED
            stuck[i] = (self._has_turned & (time_ns - self._since_ns >= LASTS_NS)).any()
        return stuck if stuck.any() else None

    def _may_repeat(self, motion: ErrorMotion) -> bool:
        """Whether any two sums of components are the same, as those of equal components are: mostly none are."""
        self._sums = [*self._sums[-LONGEST:], *motion.components.sum(axis=1).tolist()]
        return len(set(self._sums)) < len(self._sums)

    def _keep(self, motion: ErrorMotion) -> None:
        """Keep what the next ticks may repeat."""
        self._before.append((motion.components, motion.observable))
        self._kept += len(motion.theta)
        while self._kept - len(self._before[0][0]) >= LONGEST:
            self._kept -= len(self._before.popleft()[0])

    def _latest(self) -> tuple[Array, Mask]:
        """(LONGEST, 6) components of the last ticks, the oldest first, and which of them were observable.

        They are kept as one piece from here on: what repeats itself does so tick after tick, and is asked for at each.
        """
        components, seen = (np.concatenate(parts)[-LONGEST:] for parts in zip(*self._before, strict=True))
        self._before, self._kept = deque([(components, seen)]), LONGEST
        return components, seen

    def _repeats(self, motion: ErrorMotion) -> Mask:
        """(m, LONGEST) whether each tick has the bits of the one so many before, the oldest first."""
        before, was_seen = self._latest()
        earlier = sliding_window_view(np.concatenate([before, motion.components])[:-1], LONGEST, axis=0)
        same: Mask = np.repeat((motion.observable.sum(axis=1) >= LEAST)[:, None], LONGEST, axis=1)
        for component, (now, is_seen) in enumerate(zip(motion.components.T, motion.observable.T, strict=True)):
            same &= (now[:, None] == earlier[:, component]) | ~is_seen[:, None]
            if not same.any():  # mostly at the first one
                return same
        seen = sliding_window_view(np.concatenate([was_seen, motion.observable])[:-1], LONGEST, axis=0)
        same &= (motion.observable[:, :, None] == seen).all(axis=1)
        return same
