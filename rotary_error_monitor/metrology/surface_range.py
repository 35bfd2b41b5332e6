"""How far the flatness of a measured surface may be from the true one, given the noise of its heights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array

DRAWS = 1000
"""Simulated surfaces: 95 % are 93.6 to 96.4 % by them (two standard deviations)."""

PART = 100
"""Surfaces that are simulated at once, so that ten thousand points need some 30 MB."""

FEWEST_POINTS = 12
"""Twice as many heights as a surface of degree 2 has coefficients."""

HIGHEST_DEGREE = 30
"""Of polynomial surfaces: up to fifteen waves along a side."""

DETERMINED = 0.75
"""Coefficients for each point at most: the others tell the noise."""

DEPENDENT = 1e-8
"""Part of the largest new direction below which a polynomial is a sum of the others: what is left is rounding."""

POWERS = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 16.0, 23.0, 32.0])
"""Of the degree by which the variance of coefficients falls off, which are tried: 0 is detail from point to point, 4
to 6 a corner, 32 a surface of degree 2 alone."""

SIZES = np.geomspace(1e-4, 10.0, 21)
"""Variance of coefficients that is tried, in that of those found."""

STATED = 50.0
"""Readings that the stated noise counts for beside those of the surface: it is known to a tenth (1 / sqrt(2 * 50))."""

QUIET = 0.2
"""Part of a coefficient that is of the surface, below which it tells of the noise."""

LACK = 4.0
"""Standard deviations of chi-square by which a surface has more than noise beside a polynomial, or less."""


@dataclass(frozen=True)
class _Told:
    """Heights as coefficients of orthonormal polynomials.

    Attributes:
        basis: (n, k) polynomials at the points.
        plane: (k,) which are of the plane.
        groups: (k,) each, which are along the first, along the second, and over both, with their degrees.
        found: (k,) coefficients, m.
    """

    basis: Array
    plane: NDArray[np.bool_]
    groups: tuple[tuple[NDArray[np.bool_], Array], ...]
    found: Array

    def shares(self, noise: float) -> Iterator[tuple[NDArray[np.bool_], Array, Array]]:
        """Of each group: (g, j) parts of its coefficients that are of the surface, and (g,) how probable they are."""
        for chosen, degrees in self.groups:
            found = self.found[chosen]
            shape = (degrees / 2) ** -POWERS[:, None]
            usual = float(found @ found) / shape.sum(axis=1)
            prior = ((usual[:, None] * SIZES)[:, :, None] * shape[:, None]).reshape(-1, found.size)
            total = prior + noise**2
            log = -0.5 * (np.square(found) / total + np.log(total)).sum(axis=1)
            weight = np.exp(log - log.max())
            yield chosen, prior / total, weight / weight.sum()


def flatness_bounds(first: Array, second: Array, heights: Array, noise: float) -> tuple[float, float] | None:
    """95 % interval for the range of true heights at points (n,) m about their least squares plane, m.

    `heights` (n,) m about their plane have independent errors of standard deviation `noise`, m, known to a tenth, which
    make their range larger rather than smaller. By how much is simulated (a fixed seed): probable surfaces are drawn
    from the posterior of polynomial coefficients, whose prior variance falls off with a power of the degree (size and
    power as probable as the heights make them), and noise is added to each. The interval is that of range less error.
    Where noise may make all of the range, the upper end is at least that of the probable surfaces themselves, for how
    errors lie to those is not told then. None where noise does not explain what polynomials leave, where it is far
    louder than that, and of fewer than 12 points.
    """
    if heights.size < FEWEST_POINTS:
        return None
    told = _expand(_scaled(first), _scaled(second), heights)
    squares, freedom = _noise_squares(told, heights, noise)
    if squares / noise**2 > freedom + LACK * np.sqrt(2 * freedom) or _is_overstated(squares / noise**2, freedom):
        return None
    known = STATED + freedom
    common = float(np.sqrt((STATED * noise**2 + squares) / known))
    ranges, larger = _enlarged(told, common, known)
    low, high = float(np.ptp(heights)) - np.quantile(larger, [0.975, 0.025])
    if low <= 0:
        return 0.0, max(float(np.quantile(ranges, 0.975)), float(high))
    return float(low), float(high)


def _is_overstated(squares: float, freedom: float) -> bool:
    """Whether noise alone, `squares` in units of the stated variance, is far below it; both are known to a part.

    The logarithm of the ratio of two variances is about normal.
    """
    return bool(squares < freedom * np.exp(-LACK * np.sqrt(2 / max(freedom, 1.0) + 2 / STATED)))


def _noise_squares(told: _Told, heights: Array, noise: float) -> tuple[float, float]:
    """Sum of squares of what is noise alone, m², and its degrees of freedom."""
    share = np.zeros(told.found.size)
    for chosen, parts, weight in told.shares(noise):
        share[chosen] = weight @ parts
    quiet = (share < QUIET) & ~told.plane
    squares = float(heights @ heights - told.found @ told.found)
    squares += float(np.square(told.found[quiet]) @ (1 - share[quiet]))
    return squares, float(heights.size - told.found.size + quiet.sum())


def _enlarged(told: _Told, noise: float, known: float) -> tuple[Array, Array]:
    """(DRAWS,) ranges of probable surfaces, and by how much noise makes each larger, m; it has `known` freedom."""
    rng = np.random.default_rng(0)
    groups, plane = list(told.shares(noise)), told.basis[:, told.plane]
    ranges, larger = [], []
    for _ in range(DRAWS // PART):
        share = np.zeros((PART, told.found.size))
        for chosen, parts, weight in groups:
            share[:, chosen] = parts[rng.choice(weight.size, PART, p=weight)]
        scale = noise * np.sqrt(known / rng.chisquare(known, PART))[:, None]
        # noise of all points and its part in the basis, for the signs of the basis are nobody's choice
        other = rng.normal(size=(PART, len(told.basis))) @ told.basis
        surface = (share * told.found + scale * np.sqrt(share) * other) @ told.basis.T
        errors = scale * rng.normal(size=(PART, len(told.basis)))
        errors -= (errors @ plane) @ plane.T
        ranges.append(np.ptp(surface, axis=1))
        larger.append(np.ptp(surface + errors, axis=1) - ranges[-1])
    return np.concatenate(ranges), np.concatenate(larger)


def _expand(u: Array, v: Array, heights: Array) -> _Told:
    """Heights (n,) m by polynomials of positions (n,) from -1 to 1: products of Legendre's, the plane first."""
    degree = HIGHEST_DEGREE
    while (degree + 1) * (degree + 2) / 2 > DETERMINED * heights.size:
        degree -= 1
    one, other = (part.ravel() for part in np.indices((degree + 1, degree + 1)))
    order = np.argsort(one + other, kind="stable")
    # on a grid of few rows higher degrees across them are sums of lower ones
    order = order[
        (one + other <= degree)[order] & (one < np.unique(u).size)[order] & (other < np.unique(v).size)[order]
    ]
    columns = np.asarray(legendre.legvander2d(u, v, [degree, degree])[:, order], dtype=np.float64)
    basis, kept = _orthonormal(columns)
    i, k = one[order][kept], other[order][kept]
    groups = ((k == 0) & (i > 1), (i == 0) & (k > 1), (i > 0) & (k > 0))
    sorted_out = tuple((chosen, (i + k)[chosen].astype(np.float64)) for chosen in groups if chosen.any())
    return _Told(basis, i + k <= 1, sorted_out, basis.T @ heights)


def _orthonormal(columns: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(n, m) orthonormal directions of (n, k) columns in their order, and (k,) which are no sum of those before."""
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
