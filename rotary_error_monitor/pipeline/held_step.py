"""A sudden change of the distance of rotation and command while the command accelerates: a step, or the drive."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.pipeline.distance_places import WindowDistance
from rotary_error_monitor.pipeline.evidence import SHORT, SIGMAS

SEEN = 5
"""Windows behind which it is seen how the command accelerated at a change: the second difference takes one more, and
interpolation two samples, which are no further apart than `max_gap`, 25 ms."""


class HeldStep:
    """Holds a change until it is told whether a drive makes it.

    A drive may stay behind its command by what goes with the acceleration of that: one whose feed-forward of inertia
    is off, or that has none. Up to the stated following error that is no step: it is over with the acceleration, and a
    step stays. What the command's acceleration is, command and rotation tell together: a step is in one of them alone.

    Attributes:
        before: what was before the change; none where nothing is held.
        passed: windows from there to the one in which it was seen.
        size: of what it may be, rad; 0 where nothing is held.
        scatter: of the distance before it, rad.
    """

    def __init__(self, following_error: float) -> None:
        """Nothing is held, of a drive with a largest `following_error` (rad)."""
        self._largest = following_error
        self.clear()

    def clear(self) -> None:
        """Hold nothing."""
        self.before: WindowDistance | None = None
        self.passed, self.size, self.scatter = 0, 0.0, 0.0
        self._outcome, self._lasting = "", 0  # how it comes out, and in how many windows one behind another
        self._course: deque[tuple[float, float]] = deque(maxlen=3)  # command and rotation of the latest windows, rad
        # rad per window²: acceleration before the change, in the latest windows, the largest, and what noise makes
        self._began = self._most = self._unseen = 0.0
        self._latest: deque[float] = deque(maxlen=SHORT)
        self._give = math.inf  # largest distance per acceleration before the change

    def hold(self, before: WindowDistance, last: int, earlier: tuple[Array, Array], noise: float) -> None:
        """Hold a change that is seen in the next window.

        Args:
            before: what was before.
            last: number of the last window.
            earlier: (n,) angles of the command and distances (rad) in windows one behind another up to that.
            noise: standard deviation of the distance, rad.
        """
        self.before, self.passed, self.scatter = before, last + 1 - before.number, noise
        self._unseen = SIGMAS * math.sqrt(6.0) * noise
        command, distance = earlier
        rotor = command + distance
        self._course.extend(zip(command[-2:].tolist(), rotor[-2:].tolist(), strict=True))
        agreed = _agreed(np.diff(command, 2), np.diff(rotor, 2))
        self._latest.extend(agreed[-SHORT:].tolist())
        sound = len(command) - self.passed  # windows before that one
        agreed = agreed[: max(sound - 1, 0)]
        if not len(agreed):
            return
        self._began, self._most = float(agreed[-1]), float(np.abs(agreed).max())
        if len(agreed) > SHORT:
            lasting = np.convolve(agreed, np.full(SHORT, 1.0 / SHORT), "valid")
            if (varied := float(np.ptp(lasting))) > self._unseen:
                self._give = (float(np.ptp(distance[:sound])) + SIGMAS * noise) / varied

    def add(self, theta: float, distance: float, change: float) -> None:
        """Take in the next window: rotation and distance (rad), and what the change is in it (rad)."""
        self.size = max(change, self._largest) + SIGMAS * self.scatter
        self._course.append((theta - distance, theta))
        if len(self._course) == 3:
            bend = np.diff(np.array(self._course), 2, axis=0)
            self._latest.append(float(_agreed(*bend.T)[0]))
            self._most = max(self._most, abs(self._latest[-1]))

    def lasts(self, outcome: str) -> bool:
        """Whether it comes out the same for so long that it is seen how the command accelerated meanwhile."""
        self._lasting = self._lasting + 1 if outcome == self._outcome else 1
        self._outcome = outcome
        return self._lasting > SEEN

    @property
    def explained(self) -> float:
        """What of the change can go with the acceleration, rad.

        At the largest acceleration that was seen it is the largest following error, and no more than was seen to go
        with accelerations before. The drive may follow them within `SHORT` windows.
        """
        if self._most <= self._unseen:
            return 0.0
        varied = max(self._began, *self._latest) - min(self._began, *self._latest)
        return min(self._give, self._largest / self._most) * max(varied - self._unseen, 0.0)


def _agreed(command: Array, rotor: Array) -> Array:
    """Second differences (n,) in which both agree: what command or rotation shows alone is the change itself."""
    return np.where(np.abs(rotor) < np.abs(command), rotor, command) * (rotor * command > 0.0)
