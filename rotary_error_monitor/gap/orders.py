"""Orders of rows over the rotation, by a Fourier transform of their sums over narrow arcs.

An arc is so narrow that the wave of the highest order that is asked for hardly turns in it: a sum over rows is as good
as exact, and takes as long for hundreds of orders as for one.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array

ARCS_A_WAVE = 80
"""Arcs that one wave of the highest order is cut into, at least: its power comes out 0.06 % too small at most."""

SHOWN = 1e-6
"""Part of the squares of an order's cosine below which its sine is rounding of the arcs."""


class Angles:
    """Angles (n,) of rows, rad, with all that orders over them have in common whatever the rows are.

    Args:
        angle: (n,) rad.
    """

    def __init__(self, angle: Array) -> None:
        self._angle = angle
        self._arcs: dict[int, NDArray[np.intp]] = {}
        self._waves: dict[int, NDArray[np.complex128]] = {}
        self._squares: dict[int, Array] = {}
        self._directions: dict[tuple[int, int], tuple[Array, Array]] = {}

    def sums(self, rows: Array, orders: int) -> NDArray[np.complex128]:
        """(orders + 1,) sums of rows (n,) times `exp(-i k angle)` for the whole orders k from 0 on."""
        arcs = int(2 ** np.ceil(np.log2(ARCS_A_WAVE * max(orders, 1))))
        if arcs not in self._arcs:
            self._arcs[arcs] = (np.mod(self._angle, 2 * np.pi) * (arcs / (2 * np.pi))).astype(np.intp) % arcs
        sums = np.fft.rfft(np.bincount(self._arcs[arcs], rows, minlength=arcs))[: orders + 1]
        return np.asarray(sums * _middles(arcs, orders), np.complex128)

    def waves(self, orders: int) -> NDArray[np.complex128]:
        """(orders + 1,) the same of rows that are all one."""
        if orders not in self._waves:
            self._waves[orders] = self.sums(np.ones(len(self._angle)), orders)
        return self._waves[orders]

    def spectrum(self, rows: Array, orders: int) -> Array:
        """(orders,) squares that each whole order 1, 2, … explains of white rows, taken alone.

        Chi-square with two degrees of freedom under noise, wherever the rotor was: on an arc a cosine and a sine are
        not as large as one another, nor independent.
        """
        rows_at, waves_at = self.sums(rows, orders)[1:], self.waves(2 * orders)
        twice, count = waves_at[2::2], max(len(rows), 1)
        # Along the axes of the products of cosine and sine: what an arc shows of an order, and what it hardly shows.
        turned = rows_at * np.exp(-0.5j * np.angle(twice))
        length = np.abs(twice)
        more, less = 0.5 * (count + length), 0.5 * (count - length)
        shown = np.square(turned.real) / more
        hidden = np.divide(np.square(turned.imag), less, out=np.zeros(orders), where=less > SHOWN * more)
        return np.asarray(shown + hidden, np.float64)

    def products(self, orders: int) -> Array:
        """(p, p) of the waves of orders 0 to `orders` with one another.

        The p = 2 orders + 1 waves are the cosines of 0, 1, … and then the sines of 1, 2, …
        """
        wave = self.waves(2 * orders)
        first, second = np.meshgrid(np.arange(orders + 1), np.arange(orders + 1), indexing="ij")
        apart, together = wave[np.abs(first - second)], wave[first + second]
        # cos a sin b = (sin(a + b) + sin(b - a)) / 2, and so on; a transform holds cosines and minus the sines.
        mixed = 0.5 * (-together.imag - np.sign(second - first) * apart.imag)[:, 1:]
        cosines, sines = 0.5 * (apart.real + together.real), 0.5 * (apart.real - together.real)[1:, 1:]
        return np.block([[cosines, mixed], [mixed.T, sines]])

    def squares(self, orders: int) -> Array:
        """(p,) of those waves."""
        if orders not in self._squares:
            self._squares[orders] = np.diag(self.products(orders)).copy()
        return self._squares[orders]

    def moments(self, rows: Array, orders: int) -> Array:
        """(p,) products of those waves with rows (n,)."""
        # The same arcs for both: the fit is then exact for angles that are rounded to them.
        with_rows = self.sums(rows, 2 * orders)[: orders + 1]
        return np.concatenate([with_rows.real, -with_rows.imag[1:]])

    def explained(self, moments: Array, orders: int, first: int = 0) -> tuple[float, int]:
        """Squares that the waves explain of rows with these moments (p,), and their rank.

        Args:
            moments: as `moments` gives them.
            orders: highest order.
            first: waves before this one are left out.
        """
        if (orders, first) not in self._directions:
            values, vectors = np.linalg.eigh(self.products(orders)[first:, first:])
            seen = values > 1e-6 * values[-1]
            self._directions[orders, first] = values[seen], np.ascontiguousarray(vectors[:, seen].T)
        values, directions = self._directions[orders, first]
        return float(np.sum((directions @ moments[first:]) ** 2 / values)), len(values)


@cache
def _middles(arcs: int, orders: int) -> NDArray[np.complex128]:
    """(orders + 1,) what turns sums of arcs, each at its beginning, to their middles."""
    return np.asarray(np.exp(-1j * np.pi / arcs * np.arange(orders + 1)), np.complex128)


def order_spectrum(angle: Array, rows: Array, orders: int) -> Array:
    """`Angles.spectrum` of angles (n,) that are looked at once."""
    return Angles(angle).spectrum(rows, orders)


def trials_of_waves(independent: float, log_level: float) -> float:
    """How many independent waves have one above a level as often as the best of all between as many has.

    An order between two independent ones may explain more than both: `sqrt(pi z / 3)` times as many chances where the
    one wave explains `2 z` squares by chance at that level (Davies, Biometrika 74, 1987; Baluev, MNRAS 385, 2008,
    Equation 6, for samples spread evenly).

    Args:
        independent: waves that are orthogonal over the rotation.
        log_level: logarithm of the chance of one of them.
    """
    return independent * float(np.sqrt(max(-log_level * np.pi / 3, 1.0)))
