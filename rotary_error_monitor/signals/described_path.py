"""Readings by their description over a turn: which of them a rotor that goes on turning shows.

What turns with a rotor is a curve in the plane of its readings, and each reading near it tells a rotation, whatever the
speed. So of an instrument that gives few readings a turn it need not be known how fast the rotor turns to tell what
jumps off from what goes on along the curve, nor need anything be waited for: the readings themselves tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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

NEGLIGIBLE = 1e-6
"""Part of the largest wave of a curve below which a wave counts for nothing."""

MOST = 2.25
"""Times its amplitude by which a cubic between four readings misses a wave at most: the wave itself, and as much of its
readings as the cubic's weights sum up to."""

_AT_ONCE = 64
"""Readings that are held against the curve at once."""


@dataclass(frozen=True, eq=False)
class DescribedPath:
    """Closed curve of described readings.

    Attributes:
        points: (`PLACES`, 2) reading at each of as many even rotations of a turn, in the units of the readings.
    """

    points: Array

    def goes_on(self, readings: Array, off: Array) -> Mask:
        """Whether the rotation goes on, as the curve tells it, at the middle one of three readings in a row.

        Args:
            readings: (m, 3, 2) three in a row each, m not 0.
            off: (m,) how far the middle one stands off from its neighbours without the curve.

        Returns:
            (m,) true where the middle reading is off the curve by no more than `LEFT` of that and the rotor turns on
            past it in one direction, no more than `UNEVEN` times as far on one side as on the other.
        """
        places, left = self._nearest_of(readings)
        before, behind = (_turned(places[:, i + 1] - places[:, i]) for i in (0, 1))
        least, most = np.minimum(np.abs(before), np.abs(behind)), np.maximum(np.abs(before), np.abs(behind))
        return np.asarray((left[:, 1] <= LEFT * off) & (before * behind > 0.0) & (most <= UNEVEN * least))

    def missed(self, turned: float) -> float:
        """What a cubic through four readings of the curve misses of it at most, in the units of the readings.

        Args:
            turned: angle by which the rotor turns from one reading to the next, rad.
        """
        table = self._missed
        place = abs(turned) / TURN * PLACES
        return float(table[min(int(place) + 1, len(table) - 1)]) if place > 0.0 else 0.0

    @cached_property
    def _missed(self) -> Array:
        """The same where it turns by each of the `PLACES` of a turn; last by more than a turn."""
        waves = np.abs(np.fft.fft(self.points[:, 0] + 1j * self.points[:, 1])) / PLACES
        sizes = waves[: PLACES // 2].copy()
        sizes[1:] += waves[: PLACES // 2 : -1]  # which go round the other way
        sizes[0] = 0.0
        orders = np.flatnonzero(sizes > NEGLIGIBLE * sizes.max())
        phases = np.linspace(0.0, TURN, PLACES + 1)[:, None] * orders
        between = np.linspace(0.0, 1.0, 17)
        nodes = np.arange(-1, 3)
        off = np.zeros(phases.shape)
        for place in between:
            left = np.exp(1j * phases * place)
            for node in nodes:
                others = nodes[nodes != node]
                left -= np.prod((place - others) / (node - others)) * np.exp(1j * phases * node)
            np.maximum(off, np.abs(left), out=off)
        return np.append(np.maximum.accumulate(off @ sizes[orders]), MOST * sizes.sum())

    def _nearest_of(self, readings: Array) -> tuple[Array, Array]:
        """The same as `_nearest`, in memory that is bounded however many there are."""
        parts = [self._nearest(readings[begin : begin + _AT_ONCE]) for begin in range(0, len(readings), _AT_ONCE)]
        return np.concatenate([place for place, _ in parts]), np.concatenate([left for _, left in parts])

    def _nearest(self, readings: Array) -> tuple[Array, Array]:
        """(m, 3) place on the curve, in `PLACES` of a turn, nearest to each reading, and how far it is off."""
        begin = self.points
        chord = np.roll(begin, -1, axis=0) - begin
        square = np.maximum((chord**2).sum(axis=1), np.finfo(np.float64).tiny)
        from_begin = readings[:, :, None, :] - begin
        part = np.clip((from_begin * chord).sum(axis=-1) / square, 0.0, 1.0)
        apart = np.hypot(*np.moveaxis(from_begin - part[..., None] * chord, -1, 0))
        nearest = np.argmin(apart, axis=2)[..., None]
        place, left = nearest + np.take_along_axis(part, nearest, 2), np.take_along_axis(apart, nearest, 2)
        return place[..., 0], left[..., 0]


def _turned(places: Array) -> Array:
    """Differences of places as the shorter way round."""
    return np.asarray(places - PLACES * np.rint(places / PLACES))
