"""Orders of rows over the rotation, by a Fourier transform of their sums over narrow arcs.

An arc is so narrow that the wave of the highest order that is asked for hardly turns in it: a sum over rows is as good
as exact, and takes as long for hundreds of orders as for one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.gap.problem import Array

ARCS_A_WAVE = 80
"""Arcs that one wave of the highest order is cut into, at least: its power comes out 0.06 % too small at most."""

SHOWN = 1e-6
"""Part of the squares of an order's cosine below which its sine is rounding of the arcs."""


def order_sums(angle: Array, rows: Array, orders: int) -> NDArray[np.complex128]:
    """(orders + 1,) sums of rows (n,) times `exp(-i k angle)` for whole orders k = 0, 1, … of angles (n,) in rad."""
    arcs = int(2 ** np.ceil(np.log2(ARCS_A_WAVE * max(orders, 1))))
    place = (np.mod(angle, 2 * np.pi) * (arcs / (2 * np.pi))).astype(np.intp) % arcs
    sums = np.fft.rfft(np.bincount(place, rows, minlength=arcs))[: orders + 1]
    # An arc stands for its middle.
    return np.asarray(sums * np.exp(-1j * np.pi / arcs * np.arange(orders + 1)), np.complex128)


def order_spectrum(angle: Array, rows: Array, orders: int) -> Array:
    """(orders,) squares that each whole order 1, 2, … explains of white rows, taken alone.

    Chi-square with two degrees of freedom under noise, wherever the rotor was: on an arc a cosine and a sine are not as
    large as one another, nor independent.
    """
    rows_at, waves_at = order_sums(angle, rows, orders)[1:], order_sums(angle, np.ones(len(rows)), 2 * orders)
    twice, count = waves_at[2::2], max(len(rows), 1)
    # Along the axes of the products of cosine and sine: what an arc shows of an order, and what it hardly shows.
    turned = rows_at * np.exp(-0.5j * np.angle(twice))
    length = np.abs(twice)
    more, less = 0.5 * (count + length), 0.5 * (count - length)
    shown = np.square(turned.real) / more
    hidden = np.divide(np.square(turned.imag), less, out=np.zeros(orders), where=less > SHOWN * more)
    return np.asarray(shown + hidden, np.float64)


def wave_products(angle: Array, rows: Array, orders: int) -> tuple[Array, Array]:
    """Products of the waves of orders 0 to `orders` with one another, (p, p), and with the rows, (p,).

    The p = 2 orders + 1 waves are the cosines of 0, 1, … and then the sines of 1, 2, …
    """
    wave = order_sums(angle, np.ones(len(rows)), 2 * orders)
    # The same arcs for both: the fit is then exact for angles that are rounded to them.
    with_rows = order_sums(angle, rows, 2 * orders)[: orders + 1]
    first, second = np.meshgrid(np.arange(orders + 1), np.arange(orders + 1), indexing="ij")
    apart, together = wave[np.abs(first - second)], wave[first + second]
    # cos a sin b = (sin(a + b) + sin(b - a)) / 2, and so on; a transform holds cosines and minus the sines.
    mixed = 0.5 * (-together.imag - np.sign(second - first) * apart.imag)[:, 1:]
    cosines, sines = 0.5 * (apart.real + together.real), 0.5 * (apart.real - together.real)[1:, 1:]
    moment = np.concatenate([with_rows.real, -with_rows.imag[1:]])
    return np.block([[cosines, mixed], [mixed.T, sines]]), moment
