"""Readings by their description over a turn: which of them a rotor that goes on turning shows.

What turns with a rotor is a curve in the plane of its readings, and each reading near it tells a rotation, whatever the
speed. So of an instrument that gives few readings a turn it need not be known how fast the rotor turns to tell what
jumps off from what goes on along the curve, nor need anything be waited for: the readings themselves tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.units import TURN

PLACES = 720
"""Rotations at which the curve is known: the chord of one of a turning vector is 1e-5 of the vector off its arc."""

LEFT = 0.25
"""Part of what a reading stands off by that may be left beside the curve where the curve explains it."""

UNEVEN = 3.0
"""How many times as far the rotor may turn up to a reading as behind it, or the other way round: the second distance of
a rotor that begins to turn at constant acceleration is three times the first, and where a reading is lost, two."""

BRANCHES = 32
"""Places that one reading may stand at, at most: a curve of order n passes near to a point 2 n times."""

NEGLIGIBLE = 1e-6
"""Part of the largest wave of a curve below which a wave counts for nothing."""


@dataclass(frozen=True, eq=False)
class DescribedPath:
    """Closed curve of described readings.

    Attributes:
        points: (`PLACES`, 2) reading at each of as many even rotations of a turn, in the units of the readings.
    """

    points: Array

    def goes_on(self, readings: Array, off: Array) -> Mask:
        """Whether the rotation goes on, as the curve tells it, at the middle one of three readings in a row.

        A curve of several orders crosses itself, and lies within noise of itself: a reading may stand at any of the
        places that it is near to.

        Args:
            readings: (m, 3, 2) three in a row each.
            off: (m,) how far the middle one stands off from its neighbours without the curve.

        Returns:
            (m,) true where the middle reading is off the curve by no more than `LEFT` of that and the rotor turns on
            past it in one direction, no more than `UNEVEN` times as far on one side as on the other.
        """
        return np.array([self._turns_past(*pair) for pair in zip(readings, LEFT * off, strict=True)], np.bool_)

    def _turns_past(self, readings: Array, near: float) -> bool:
        """The same of three readings (3, 2), of which the middle one is off by no more than `near`."""
        last, here, following = (self._places(each) for each in readings)
        places = here.within(near)
        if not len(places):
            return False
        # a neighbour that is off by more, for a spike of its own or an unknown motion, stands where it is nearest to
        before = _turned(places - last.within(max(near, last.least))[:, None])[:, None]
        behind = _turned(following.within(max(near, following.least))[:, None] - places)[None]
        least, most = np.minimum(np.abs(before), np.abs(behind)), np.maximum(np.abs(before), np.abs(behind))
        return bool(((before * behind > 0.0) & (most <= UNEVEN * least)).any())

    def followed(self, most: float) -> float:
        """Angle between two readings, rad, up to which a cubic through four of them misses no more of the curve.

        Args:
            most: what may be missed, in the units of the readings.

        Returns:
            The largest such angle, to the `PLACES` of a turn; infinite where no more is missed at any, and 0 where
            rounding alone is more.
        """
        waves = np.abs(np.fft.fft(self.points[:, 0] + 1j * self.points[:, 1])) / PLACES
        sizes = waves[: PLACES // 2].copy()
        sizes[1:] += waves[: PLACES // 2 : -1]  # which go round the other way
        sizes[0] = 0.0
        orders = np.flatnonzero(sizes > NEGLIGIBLE * sizes.max())
        turned = np.minimum(np.arange(PLACES + 1)[:, None] * orders, PLACES)
        beyond = np.flatnonzero(_missed_of_a_wave()[turned] @ sizes[orders] > most)
        return float(max(beyond[0] - 1, 0)) * (TURN / PLACES) if len(beyond) else math.inf

    def _places(self, reading: Array) -> _Places:
        """Places on the curve, in `PLACES` of a turn, nearer to a reading (2,) than those beside them."""
        begin = self.points
        chord = np.roll(begin, -1, axis=0) - begin
        square = np.maximum((chord**2).sum(axis=1), np.finfo(np.float64).tiny)
        from_begin = reading - begin
        part = np.clip((from_begin * chord).sum(axis=1) / square, 0.0, 1.0)
        apart = np.hypot(*(from_begin - part[:, None] * chord).T)
        nearest = np.flatnonzero((apart < np.roll(apart, 1)) & (apart <= np.roll(apart, -1)))
        if len(nearest) == 0:  # of a curve that is a point
            nearest = np.array([np.argmin(apart)])
        nearest = nearest[np.argsort(apart[nearest], kind="stable")[:BRANCHES]]
        return _Places(nearest + part[nearest], apart[nearest])


class _Places(NamedTuple):
    """Places (k,) on a curve, at least one, the nearest to a reading first, and how far it is off each."""

    places: Array
    off: Array

    @property
    def least(self) -> float:
        """How far the reading is off the nearest."""
        return float(self.off[0])

    def within(self, near: float) -> Array:
        """Those that are no further off."""
        return self.places[self.off <= near]


@lru_cache(maxsize=1)
def _missed_of_a_wave() -> Array:
    """(`PLACES` + 1,) what a cubic misses at most of a wave of size 1 that turns by up to so many places per reading.

    From a whole turn on, where it looks as if it stood, that is twice its size.
    """
    phases = np.linspace(0.0, TURN, PLACES + 1)
    nodes = np.arange(-1, 3)
    off = np.zeros(PLACES + 1)
    for place in np.linspace(0.0, 1.0, 17):
        left = np.exp(1j * phases * place)
        for node in nodes:
            others = nodes[nodes != node]
            left -= np.prod((place - others) / (node - others)) * np.exp(1j * phases * node)
        np.maximum(off, np.abs(left), out=off)
    return np.asarray(np.maximum.accumulate(off))


def _turned(places: Array) -> Array:
    """Differences of places as the shorter way round."""
    return np.asarray(places - PLACES * np.rint(places / PLACES))
