"""The zero from which heads count, held against what it was before a silence."""

from __future__ import annotations

import math
from collections import deque

from rotary_error_monitor.pipeline.evidence import LONG, SHORT
from rotary_error_monitor.pipeline.turn_memory import TurnMemory


class ZeroKeeping:
    """Holds the distance of rotation and command against what it was before a silence, at the same angle or at last.

    Distances are kept with the speed (rad, rad/s) at which they were seen: what a delay has in both is told by the
    delay as it is known when they are compared, which may not have been seen before.

    Attributes:
        open: whether it is being compared.
        off: by how much it is another since then, rad: mean over the windows of a second.
        untold: by how much it may be another, rad, where another speed and a delay that was not seen leave that open.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self._turn = TurnMemory()
        self._place: tuple[float, float] | None = None
        self._latest: deque[tuple[float, float, tuple[float, float]]] = deque()
        self._apart: deque[float] = deque(maxlen=LONG)
        self.open, self.off, self.untold = False, 0.0, 0.0
        self._told = False  # whether the latest window was compared at a speed that leaves nothing open

    def begin(self, *, sound: bool) -> None:
        """A silence has ended, or a fault of heads, of which the latest windows were not `sound`."""
        while sound and self._latest:
            self._keep()
        self._latest.clear()
        self._apart.clear()
        self.open = self._place is not None

    @property
    def latest(self) -> float:
        """The same in the latest window, rad."""
        return self._apart[-1] if self._apart else 0.0

    def judge(
        self,
        theta: float,
        moved: float,
        distance: tuple[float, float],
        delay: float,
        noise: float,
        hidden: float,
        unknown: float = 0.0,
    ) -> float:
        """Size of what it is off by, rad; of less than the `noise` (rad) of a reading for `SHORT` windows nothing.

        Args:
            theta: rotation, rad.
            moved: by the window, rad.
            distance: of rotation and command (rad), with the speed (rad/s).
            delay: of the heads against the command, s.
            noise: rad.
            hidden: by how much that delay may be another, s.
            unknown: part of the distance, rad, that shows nothing, for the speed is not known or it was
                interpolated.
        """
        before = (self._turn.get(theta, moved) or self._place) if self.open else None
        self.untold = 0.0
        if before is not None:
            faster = distance[1] - before[1]
            apart, open_to = distance[0] - before[0] + delay * faster, unknown + hidden * abs(faster)
            before_told, self._told = self._told, not unknown and open_to <= noise
            if self._told:
                if not before_told:
                    self._apart.clear()
                self._apart.append(apart)
            else:
                self.untold = abs(apart) + open_to
                if abs(apart) > open_to:
                    self._apart.append(apart - math.copysign(open_to, apart))
            self.off = sum(self._apart) / len(self._apart) if self._apart else 0.0
            # what is only compatible with no change leaves it open
            self.open = not self._told or len(self._apart) < SHORT or abs(self.off) > noise
        if not self.open:
            self.off = self.untold = 0.0
            if not unknown:
                self._latest.append((theta, moved, distance))
            if len(self._latest) > LONG:  # a wrong head is found by then
                self._keep()
        return abs(self.off)

    def _keep(self) -> None:
        theta, moved, self._place = self._latest.popleft()
        self._turn.put(theta, moved, self._place)
