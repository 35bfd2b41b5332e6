"""How far the ring's centre scatters from window to window without redundancy, or heads against one another."""

from __future__ import annotations

import math
from collections import deque

KEPT = 100
"""Windows over which the scatter is averaged, 1 s of each kind: where noise prevails, and where stamps do."""

STATED = 10
"""Windows as which the stated noise and the stated timing count beside those that are seen: so many tell a scatter to
half of itself."""

PREVAILS = math.sqrt(2.0)
"""Standard deviation, that of noise being 1, from which stamps make more of it than noise does."""

WANDERS = 2.0
"""By which the square of what stamps make may change within seconds: errors of clocks come and go."""

SECOND_DIFFERENCE = 1.5
"""Variance of a window about the mean of its neighbours over that of a window."""


class RingScatter:
    """Scatter of windows about their neighbours, beyond the stated noise: some of it at rest, some with the speed.

    Stamps that scatter move the centre by the way that the ring goes meanwhile, which in a fast stage is more than the
    noise of its heads.
    """

    def __init__(self, timing: float) -> None:
        """`timing` is the stated standard uncertainty of a stamp, s."""
        self._timing = timing
        self.reset()

    def reset(self) -> None:
        """Nothing was seen."""
        self._excess = _Mean()
        self._stamps = _Mean()
        self.forget_last()

    def forget_last(self) -> None:
        """What comes next is no neighbour of what was."""
        self._places: deque[tuple[int, float, float]] = deque(maxlen=3)

    def add(self, number: int, place: tuple[float, float], variance: float, rate: float) -> None:
        """Take in a window.

        Args:
            number: of the window.
            place: of the ring's centre, m.
            variance: of each component by the stated noise, m²; beside none no scatter is told.
            rate: speed of a head's reading over the noise of it, 1/s.
        """
        self._places.append((number, *place))
        if len(self._places) < 3 or self._places[0][0] != number - 2 or variance == 0.0:
            return
        before, here, after = self._places
        squares = [(here[i] - 0.5 * (before[i] + after[i])) ** 2 for i in (1, 2)]
        excess = sum(squares) / 2.0 / (SECOND_DIFFERENCE * variance) - 1.0
        if self._timing * rate < 1.0:
            self._excess.add(excess, 1.0)
        else:
            self._stamps.add(excess - self._at_rest(), rate**2)

    def scale(self, rate: float) -> float:
        """By which the stated standard deviation is to be multiplied at a rate as of `add`."""
        return math.sqrt(1.0 + self._at_rest() + rate**2 * self._stamps.beside(self._timing**2, rate**2))

    def _at_rest(self) -> float:
        return self._excess.beside(0.0, 1.0)


class StampsScatter:
    """By how much heads contradict one another at speeds at which their stamps prevail, against what is stated."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._found = self._stated = 0.0

    def add(self, agreement: float, tolerance: float) -> None:
        """Take in a window by its chi-square over degrees of freedom, and the standard deviation beside noise of 1."""
        if tolerance < PREVAILS:
            return
        fading = 1.0 - 1.0 / KEPT
        self._found = fading * self._found + agreement
        self._stated = fading * self._stated + tolerance**2

    def at(self, tolerance: float) -> float:
        """Chi-square over degrees of freedom that is usual at such a tolerance; 0 where nothing was seen."""
        if tolerance < PREVAILS or self._stated == 0.0:
            return 0.0
        return WANDERS * self._found / self._stated * tolerance**2


class _Mean:
    """Slope of values over a weight through zero, by least squares; what is older than `KEPT` of them fades."""

    def __init__(self) -> None:
        self._product = self._square = 0.0

    def add(self, value: float, weight: float) -> None:
        fading = 1.0 - 1.0 / KEPT
        self._product = fading * self._product + value * weight
        self._square = fading * self._square + weight**2

    def beside(self, stated: float, weight: float) -> float:
        """The slope, beside which a stated one counts as much as `STATED` values of a weight; never negative."""
        counted = STATED * weight**2
        whole = self._square + counted
        return max(0.0, (self._product + counted * stated) / whole) if whole > 0.0 else 0.0
