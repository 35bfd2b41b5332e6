"""How sure the distance of rotation and command is: how much it scatters, and what interpolation may miss of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotary_error_monitor.metrology.error_motion import KINK
from rotary_error_monitor.pipeline.evidence import LONG, SHORT, EvidenceWindow
from rotary_error_monitor.pipeline.trailing import Trailing

Variances = tuple[float, float]
"""Of the means of windows about their neighbours', and of the ticks within windows, rad²."""


class DistanceNoise:
    """Learns the noise of a distance from windows that follow one another.

    Attributes:
        variances: by the windows up to the latest; none of too few.
        earlier: by those before the latest: a step that began within that is no noise.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self._squares, self._within = Trailing(LONG), Trailing(LONG)
        self._course: list[float] = []  # distances of the last two windows
        self.variances: Variances | None = None
        self.earlier: Variances | None = None

    def clear(self) -> None:
        """Forget all that was seen."""
        self._squares.clear()
        self._within.clear()
        self._course.clear()
        self.variances = self.earlier = None

    def interrupt(self) -> None:
        """What comes does not follow upon what was."""
        self._course.clear()

    def add(self, distances: Sequence[float], scatters: Sequence[float]) -> list[Variances | None]:
        """Take in distances (rad) and the scatter (rad) of the ticks within each; give `variances` after each."""
        course = [*self._course, *distances]
        self._course = course[-2:]
        squares = [
            (here - 0.5 * (before + after)) ** 2
            for before, here, after in zip(course, course[1:], course[2:], strict=False)
        ]
        without = len(distances) - len(squares)  # the first windows have not two before them
        within = self._within.add([each**2 for each in scatters[without:]])
        found = [self.variances] * without
        for end, end_within in zip(self._squares.add(squares), within, strict=True):
            known = self._squares.count(end, SHORT) == SHORT
            variances = self._squares.mean(end, LONG) / 1.5, self._within.larger_mean(end_within, (LONG, SHORT))
            found.append(variances if known else None)
        self.earlier = found[-2] if len(found) > 1 else self.variances
        self.variances = found[-1]
        return found


def deviation(variances: Variances | None, samples: float) -> float:
    """Standard deviation of a single one of so many samples of a window, rad; 0 where it is not known."""
    return 0.0 if variances is None else math.sqrt(max(variances[0] * samples, variances[1]))


def scatter_in(window: EvidenceWindow, variances: Variances | None) -> float:
    """The same in a window, rad."""
    return deviation(variances, max(1.0, window.ticks * window.mean.head_samples))


def missed_of(head_bend: float, command_bend: float) -> float:
    """What interpolation of heads and of command may miss of their mean distance in a window, rad.

    Both by their third differences: of a jump of acceleration all of these have one sign, and those of noise cancel.
    """
    return KINK * (abs(head_bend) + abs(command_bend))


def missed_in(window: EvidenceWindow) -> float:
    """The same of a window's mean third differences, rad."""
    return missed_of(window.mean.head_bend, window.mean.command_bend)
