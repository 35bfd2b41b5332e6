"""Short periods of an axis: teeth of its worm, of strain wave gears and belts, lines of an encoder.

Neighbours on the sky are degrees apart, and do not share what repeats every few degrees: only a wave along the axis's
own reading tells it from noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.orders import trials_of_waves
from rotary_error_monitor.gap.problem import StructureTest
from rotary_error_monitor.gap.structure import HIGHEST_LEVEL

MOST_TEETH = 720
"""Highest order that is looked for, a period of half a degree: that of the largest worm wheels."""

OVERSAMPLED = 5
"""Orders that are tried for each turn more over the axis's travel: between two a wave loses 3 % of its power."""

SHOWN = 1e-6
"""Part of the squares of a wave's cosine below which its sine is rounding."""


class AxisPeriods:
    """Waves of any order along one axis, from one above those of whole shapes up to so many teeth.

    Args:
        position: (n,) of the axis, rad.
        turned: (n,) what a turn of the axis moves along its way.
        lowest: order from which waves are looked for.
    """

    def __init__(self, position: Array, turned: Array, lowest: int) -> None:
        self._position, self._turned = position - position.mean(), turned
        span = max(float(np.ptp(position)), 1e-9)
        first = max(float(lowest), 2 * np.pi / span)
        step = 2 * np.pi / (OVERSAMPLED * span)
        self._orders = first + step * np.arange(max(int((MOST_TEETH - first) / step), 1))
        # As many independent ones as over positions that are spread evenly with the same variance (Baluev 2008, 5).
        evenly = np.sqrt(12 * np.mean(np.square(self._position))) / (2 * np.pi)
        self._independent = max(float((self._orders[-1] - self._orders[0]) * evenly), 1.0)

    def finding(self, white: Array, kept: NDArray[np.bool_], channel: str, axis: str) -> StructureTest:
        """The wave that explains most of white rows (n,) of one channel.

        What else is left raises all waves alike, since pointings lie unevenly: one stands out of that, be it noise or
        up to four times as much (`HIGHEST_LEVEL`).
        """
        squares = self.spectrum(white, kept)
        best, count = int(np.argmax(squares)), max(int(np.count_nonzero(kept)) - 2, 1)
        whole = float(np.sum(np.square(white[kept])))
        half = _misfit(whole, count) - _misfit(max(whole - float(squares[best]), 0.0), count)
        chance = float(np.log(trials_of_waves(self._independent, -half))) - half
        pattern = f"pose, {axis}: period of {360 / self._orders[best]:.3g}°"
        return StructureTest(channel, "period", min(0.0, chance), max(0.0, float(squares[best]) - 2), pattern)

    def spectrum(self, white: Array, kept: NDArray[np.bool_]) -> Array:
        """Squares that each order explains of white rows (n,), taken alone: chi-square of two dof under noise."""
        weight = self._turned * kept
        shown, twice = self._sums(weight * white, 1), self._sums(np.square(weight), 2)
        # Along the axes of the products of cosine and sine, as in `gap/orders.py`.
        turned, length, count = shown * np.exp(-0.5j * np.angle(twice)), np.abs(twice), float(np.sum(np.square(weight)))
        more, less = 0.5 * (count + length), 0.5 * (count - length)
        hidden = np.divide(np.square(turned.imag), less, out=np.zeros(len(less)), where=less > SHOWN * more)
        return np.asarray(np.square(turned.real) / np.maximum(more, 1e-300) + hidden, np.float64)

    def _sums(self, rows: Array, times: int) -> NDArray[np.complex128]:
        """Sums of rows (n,) times `exp(-i times order position)`, of each order.

        Orders are evenly spaced: each is a multiple of a coarse step and one of a fine step, and their waves products.
        """
        count = len(self._orders)
        fine = int(np.ceil(np.sqrt(count)))
        near = np.exp(-1j * times * np.outer(self._position, self._orders[:fine]))
        steps = (self._orders[::fine] - self._orders[0])[:, None] * self._position
        far = np.exp(-1j * times * steps) * rows
        return np.asarray((far @ near).ravel()[:count], np.complex128)


def _misfit(squares: float, count: int) -> float:
    """Minus log likelihood of so many rows with these squares, whose level lies between 1 and `HIGHEST_LEVEL`."""
    level = float(np.clip(squares / count, 1.0, HIGHEST_LEVEL))
    return 0.5 * (squares / level + count * float(np.log(level)))
