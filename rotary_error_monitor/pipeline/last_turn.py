"""Error motion as a picture in space: where the axis of rotation was at each angle, large enough to be seen.

Nanometres beside a ring of decimetres show nothing, so that displacements are drawn many times too large, as roundness
and error motion always are (ISO 230-7:2015, polar plots). How many times is a part of the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.error_motion import ErrorMotion

CELLS = 360
"""Angles that are told apart: orders up to a quarter of that keep their shape."""

LARGEST_PART = 0.25
"""Part of the ring's radius that the largest displacement may take in the picture."""


@dataclass(frozen=True)
class TurnPicture:
    """Lines in the stage's frame, m, as they are drawn.

    Attributes:
        orbit: (k, 3) where the axis of rotation was at the ring, over a turn, `magnification` times too far off.
        polar: (k, 3) polar plot of the radial error motion, rotating sensitive direction, as large, about the ring.
        magnification: of orbit and polar plot; 0 where there are none.
        axis: (2, 3) axis of rotation, from the ring on, its tilt `tilt_magnification` times too large.
        tilt_magnification: 0 where the tilt is not observable.
    """

    orbit: NDArray[np.float64]
    polar: NDArray[np.float64]
    magnification: float
    axis: NDArray[np.float64]
    tilt_magnification: float


class LastTurn:
    """What the last pass of each angle showed, in bounded memory however long the stage turns."""

    def __init__(self, radius: float) -> None:
        """Of a stage whose ring has that radius, m."""
        self._radius = radius
        self._radial = np.full((CELLS, 2), np.nan)
        self._tilt = np.full(2, np.nan)

    def add(self, motion: ErrorMotion) -> None:
        """Take in error motion at some more times."""
        seen = motion.observable[:, :2].all(axis=1)
        cell = np.floor(np.mod(motion.theta[seen], 2 * np.pi) * (CELLS / (2 * np.pi))).astype(np.int64) % CELLS
        self._radial[cell] = motion.components[seen, :2]
        tilted = motion.observable[-1, 3:5].all()
        self._tilt = motion.components[-1, 3:5].copy() if tilted else np.full(2, np.nan)

    @property
    def largest(self) -> float:
        """Largest displacement of the axis of rotation at the ring, m; 0 where none is observable."""
        return float(np.hypot(*self._radial[np.isfinite(self._radial).all(axis=1)].T).max(initial=0.0))

    def picture(self, magnification: float | None = None) -> TurnPicture:
        """The lines as they are now; a line without points where nothing is observable.

        Args:
            magnification: of orbit and polar plot, by default the largest that has room.
        """
        seen = np.isfinite(self._radial).all(axis=1)
        radial = self._radial[seen]
        if magnification is None:
            magnification = magnification_of(self.largest, self._radius)
        angle = (np.flatnonzero(seen) + 0.5) * (2 * np.pi / CELLS)
        across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        towards = (radial * across).sum(axis=1, keepdims=True)
        orbit, polar = magnification * radial, (self._radius + magnification * towards) * across
        if seen.all():
            orbit, polar = (np.concatenate([line, line[:1]]) for line in (orbit, polar))
        tilts = bool(np.isfinite(self._tilt).all())
        shift = self._radius * np.array([self._tilt[1], -self._tilt[0]]) if tilts else np.zeros(2)
        lean = magnification_of(float(np.hypot(*shift)), self._radius)
        axis = np.array([[0.0, 0.0, 0.0], [*(lean * shift), self._radius]]) if tilts else np.zeros((0, 3))
        return TurnPicture(
            _flat(orbit), _flat(polar), magnification if seen.any() else 0.0, axis, lean if tilts else 0.0
        )


def magnification_of(largest: float, radius: float) -> float:
    """The largest of 1, 2, 5, 10, … by which a displacement (m) takes no more than `LARGEST_PART` of the radius (m)."""
    return max(1.0, rounded_down(LARGEST_PART * radius / largest)) if largest > 0.0 else 1.0


def rounded_down(size: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a size (> 0)."""
    decade = 10.0 ** math.floor(math.log10(size))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step == 1.0 or step * decade <= size)


def _flat(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3) a line (k, 2) in the plane of the ring."""
    return np.column_stack([line, np.zeros(len(line))])
