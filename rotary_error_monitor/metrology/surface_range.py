"""How far the flatness of a measured surface may be from the true one, given the noise of its heights."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWS = 1000
"""Simulated surfaces: 95 % are 93.6 to 96.4 % by them (two standard deviations)."""

DEGREES = range(2, 19)
"""Of polynomial surfaces that are tried: up to nine waves along a side."""

FURTHER = 2
"""Degrees beyond the best one."""

DEPENDENT = 1e-8
"""Part of the largest new direction below which a polynomial is a sum of the others: what is left is rounding."""

LACK = 4.0
"""Standard deviations of chi-square by which a surface has more than noise beside a polynomial."""


def flatness_bounds(first: Array, second: Array, heights: Array, noise: float) -> tuple[float, float] | None:
    """95 % interval for the range of true heights at points (n,) m about their least squares plane, m.

    `heights` (n,) m about their plane have independent errors of standard deviation `noise`, m, which make their range
    larger rather than smaller. So the interval is that of a polynomial surface through them, by simulated errors of its
    coefficients (a fixed seed), reversed about what was found (Davison and Hinkley, Bootstrap Methods and their
    Application, 1997, Section 5.2.1). Its degree is two more than the best by Akaike's criterion (1974), so that what
    it misses is small beside its uncertainty. None where noise does not explain what is left.
    """
    u, v = _scaled(first), _scaled(second)
    degrees = [k for k in DEGREES if (k + 1) * (k + 2) <= heights.size]  # twice as many heights as coefficients
    if not degrees:
        return None
    basis, told = _orthonormal(_polynomials(u, v, degrees[-1]))
    columns = np.array([(k + 1) * (k + 2) // 2 for k in degrees])
    counts = np.cumsum(told)[columns - 1]
    squares = (float(heights @ heights) - np.cumsum((basis.T @ heights) ** 2)[counts - 1]) / noise**2
    best = min(int(np.argmin(squares + 2 * counts)) + FURTHER, len(degrees) - 1)
    freedom = heights.size - counts[best]
    if squares[best] > freedom + LACK * np.sqrt(2 * freedom):
        return None
    basis = basis[:, : counts[best]]
    rng = np.random.default_rng(0)
    fitted = basis @ (basis.T @ heights)
    # noise of all points, of which the fit takes its part, for the signs of the basis are nobody's choice
    drawn = [float(np.ptp(fitted + noise * (basis @ (basis.T @ rng.normal(size=heights.size))))) for _ in range(DRAWS)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    middle = 2 * float(np.ptp(fitted))
    return max(0.0, middle - float(high)), max(0.0, middle - float(low))


def _orthonormal(columns: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(n, m) orthonormal directions of (n, k) columns in their order, and (k,) which are no sum of those before.

    On a grid of few rows high degrees across them are sums of lower ones: their directions would be rounding.
    """
    told = np.ones(columns.shape[1], dtype=np.bool_)
    while True:
        basis, upper = np.linalg.qr(columns[:, told])
        size = np.abs(np.diag(upper))
        small = np.flatnonzero(size <= DEPENDENT * size.max())
        if not small.size:
            return basis, told
        told[np.flatnonzero(told)[small[0]]] = False  # what comes after it has been freed of a direction that is none


def _scaled(positions: Array) -> Array:
    """From -1 to 1."""
    middle, half = (positions.max() + positions.min()) / 2, float(np.ptp(positions)) / 2
    return np.asarray((positions - middle) / half, dtype=np.float64)


def _polynomials(u: Array, v: Array, degree: int) -> Array:
    """(n, k) products of Legendre polynomials of this total degree, the plane first."""
    both = legendre.legvander2d(u, v, [degree, degree])
    total = np.add.outer(np.arange(degree + 1), np.arange(degree + 1)).ravel()
    chosen = np.argsort(total, kind="stable")[: int((total <= degree).sum())]
    return np.asarray(both[:, chosen], dtype=np.float64)
