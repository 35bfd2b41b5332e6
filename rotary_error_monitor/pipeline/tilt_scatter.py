"""How the readings of an autocollimator scatter, against what its stated noise explains."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.pipeline.evidence import LONG, SHORT
from rotary_error_monitor.pipeline.tilt_look import Look
from rotary_error_monitor.pipeline.trailing import Trailing

_SPANS = SHORT, LONG, 10 * LONG
"""Squares among windows of which a mean tells the noise: the more, the less of it chance can make."""


class TiltScatter:
    """Measures by how much the noise is more than is stated, among windows and within them."""

    def __init__(self) -> None:
        """It is as stated."""
        self._scale = 1.0
        self._squares, self._within = Trailing(_SPANS[-1]), Trailing(LONG)
        self._bounds_of: tuple[tuple[int, ...], float, int] | None = None  # counts of squares that `_bounds` hold for
        self._bounds: list[float] = []

    def measure(
        self,
        earlier: Sequence[tuple[float, float]],
        looks: Sequence[Look],
        scatters: Sequence[tuple[float, ...]],
        inner: Sequence[float],
        drifted: float,
    ) -> list[float]:
        """By which stated standard deviations are to be multiplied after each of some windows.

        Args:
            earlier: surplus of the windows right before them, rad.
            looks: at the windows.
            scatters: within each of them, about a straight line, rad.
            inner: independent readings behind each of these.
            drifted: what turbulence changes from one window to the next, over the root of two, rad.
        """
        without = min(max(0, 2 - len(earlier)), len(looks))  # the first windows have not two before them
        among = _among([*earlier, *(look.surplus for look in looks)], looks[without:], drifted)
        within = list[float]()
        for (x, y), look in zip(scatters[without:], looks[without:], strict=True):
            within += min(x**2 / look.variance, 1e6), min(y**2 / look.variance, 1e6)
        ends = list(zip(self._squares.add(among, 2), self._within.add(within, 2), strict=True))
        before = self._squares.end - len(among), self._within.end - len(within)
        found = []
        for look, end, each in zip(looks, [before] * without + ends, inner, strict=True):
            self._scale = self._noise_by(*end, each, look.apart) if end[0] >= SHORT else self._scale
            found.append(self._scale)
        return found

    def _noise_by(self, end: int, end_within: int, each: float, apart: int) -> float:
        """By how much noise is more than is stated, by squares among windows and within up to places."""
        among, within = self._squares, self._within
        spans = [(among, end, span) for span in _SPANS] + [(within, end_within, span) for span in (2 * SHORT, LONG)]
        counts = 2, *(scatter.count(place, span) for scatter, place, span in spans)
        if (counts, each, apart) != self._bounds_of:
            self._bounds_of, self._bounds = (counts, each, apart), _bounds_of(counts, len(_SPANS), each, apart)
        last, *bounds = self._bounds
        found = [one.significant(place, span, most) for (one, place, span), most in zip(spans, bounds, strict=True)]
        return math.sqrt(max(among.mean(end, 2) / last, *found))


def _among(course: Sequence[tuple[float, float]], looks: Sequence[Look], drifted: float) -> list[float]:
    """Squares of both components of the last windows about earlier ones over what the stated noise makes of them.

    Where readings are further apart than windows, neighbours show the same one: what the rotor does between two
    readings, which nobody sees, shows only in windows that are as far apart.
    """
    squares = list[float]()
    for place, look in enumerate(looks, start=len(course) - len(looks)):
        apart = min(look.apart, place // 2)
        (x, y), (x1, y1), (x2, y2) = course[place - 2 * apart], course[place - apart], course[place]
        variance = 1.5 * look.stated**2 + apart * drifted**2
        squares += min((x1 - 0.5 * (x + x2)) ** 2 / variance, 1e6), min((y1 - 0.5 * (y + y2)) ** 2 / variance, 1e6)
    return squares


def _bounds_of(counts: Sequence[int], spans: int, each: float, apart: int) -> list[float]:
    """Bounds on means of so many squares: the first and those of so many `spans` among windows, the others within.

    Within windows, of which a straight line takes two, there are `each` independent readings; among them only one of
    so many that are `apart` shows a reading of its own, and neighbours share windows, which leaves about half.
    """
    among = [0.5 * count / apart for count in counts[: 1 + spans]]
    within = [max(1, round(each * count)) for count in counts[1 + spans :]]
    return [chi_square_bound(freedom) for freedom in (*among, *within)]
