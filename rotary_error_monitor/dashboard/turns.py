"""The last turns of the stage, each as a picture of its own, all as many times too large."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.last_turn import LastTurn, TurnPicture, magnification_of
from rotary_error_monitor.units import TURN


class LastTurns:
    """Keeps what the last passes of each angle showed: `most` turns, the one under way among them."""

    def __init__(self, radius: float, most: int = 4) -> None:
        """Of a stage whose ring has that radius, m."""
        self.radius = radius
        self._most = most
        self._views: dict[int, LastTurn] = {}

    def add(self, motion: ErrorMotion) -> None:
        """Take in error motion at some more times, in their order."""
        turn = np.floor(motion.theta / TURN).astype(np.int64)
        for piece in np.split(np.arange(len(turn)), np.flatnonzero(np.diff(turn)) + 1):
            number = int(turn[piece[0]])
            view = self._views.pop(number, None) or LastTurn(self.radius)  # the latest stands last
            view.add(motion.at(piece))
            self._views[number] = view
        while len(self._views) > self._most:
            del self._views[next(iter(self._views))]

    def pictures(self) -> list[TurnPicture]:
        """A picture a turn, the one under way last; of one magnification."""
        largest = max((view.largest for view in self._views.values()), default=0.0)
        magnification = magnification_of(largest, self.radius)
        return [view.picture(magnification) for view in self._views.values()]
