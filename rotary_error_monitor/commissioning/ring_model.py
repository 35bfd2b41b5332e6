"""What heads at azimuths see of a ring that goes round, by orders of the rotation, and how likely a layout is.

A head at azimuth phi shows of the ring's centre c and of its graduation g

    theta + (-c_x sin(phi) + c_y cos(phi)) / r + g(phi - theta)

beside a zero, a scale and a delay of its own. By orders of theta that is linear in eccentricity, error motion and
graduation, and nearly so in how far a head stands from its azimuth. Each unknown has a Gaussian prior, so that a layout
has a marginal likelihood in closed form; it is the only thing by which layouts are compared. Of a graduation that was
measured the unknown is what is left beside the measured curve, and the curve shows a turn common to all azimuths.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import helmert, solve_triangular

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.commissioning.response_fit import STRAIGHT, FittedCoefficients

ROUNDS = 4
"""Rounds of Gauss and Newton: azimuths that are off turn what is linear in the eccentricity by some hundredths."""

NUDGE = 1e-4
"""Angle, rad, over which the change with the azimuth is taken: its own error is of the order of its square."""


@dataclass(frozen=True)
class RingPrior:
    """What is known of ring and rotor before: standard deviations.

    Attributes:
        radius: of the graduation, m.
        eccentricity: of the ring on its rotor, in each direction, m.
        motion: of a coefficient of the rotor's radial error motion, m.
        graduation: of a coefficient of order 1; of order k a k-th of it, rad.
        azimuth: of a head from the place where it is described, rad.
        curve: (k, 2) cosine and sine of orders 1 to k of a graduation that was measured, rad, by the rotation as the
            readings count it; None where none was.
        doubt: of a coefficient from that curve, rad; None for as much as without a curve.
    """

    radius: float
    eccentricity: float
    motion: float
    graduation: float
    azimuth: float
    curve: Array | None = None
    doubt: float | None = None

    def graduation_std(self, order: int) -> float:
        """Of a coefficient of one order, rad: from the curve where there is one."""
        return self.graduation / order if self.doubt is None else self.doubt


@dataclass(frozen=True)
class OrderCoefficients:
    """Coefficients of orders 1 to `highest` that heads show, as they are compared.

    Attributes:
        highest: order.
        channels: (n, c) as in `FittedCoefficients`.
        whitened: (c, 2 highest) coefficients of each channel times `whitener`.
        whitener: (c, 2 highest, 2 highest) inverse of a square root of their covariance.
    """

    highest: int
    channels: Array
    whitened: Array
    whitener: Array


def orders_of(response: FittedCoefficients, highest: int | None = None) -> OrderCoefficients:
    """The orders of a response up to `highest`, by default all."""
    count = (response.coefficients.shape[1] - STRAIGHT) // 2
    highest = count if highest is None else min(highest, count)
    part = slice(STRAIGHT, STRAIGHT + 2 * highest)
    values = response.channels.T @ response.coefficients[:, part]
    roots = [np.linalg.cholesky(covariance[part, part]) for covariance in response.covariances]
    whitener = np.array([solve_triangular(root, np.eye(len(root)), lower=True) for root in roots])
    return OrderCoefficients(highest, response.channels, np.einsum("cij,cj->ci", whitener, values), whitener)


def head_rows(azimuth: float, highest: int, radius: float) -> Array:
    """(2 highest, 6 highest - 2) cosine and sine of each order that a head shows by unit unknowns.

    Unknowns: eccentricity x and y; what goes round against the rotation x and y; then of each order from 2 on cos and
    sin of the motion along x, of that along y, cos and sin of the graduation.
    """
    s, c = np.sin(azimuth) / radius, np.cos(azimuth) / radius
    rows = np.zeros((2 * highest, 6 * highest - 2))
    rows[0, :4] = -s, c, -s, c
    rows[1, :4] = c, s, -c, -s
    for order in range(2, highest + 1):
        row, at = 2 * (order - 1), 6 * (order - 2) + 4
        cos, sin = np.cos(order * azimuth), np.sin(order * azimuth)
        rows[row, at : at + 6] = -s, 0.0, c, 0.0, cos, sin
        rows[row + 1, at : at + 6] = 0.0, -s, 0.0, c, sin, -cos
    return rows


def curve_rows(azimuth: float, highest: int, curve: Array | None) -> Array:
    """(2 highest,) cosine and sine of each order that a head shows of a measured graduation (k, 2), rad."""
    rows = np.zeros(2 * highest)
    if curve is None:
        return rows
    told = curve[:highest]
    phase = azimuth * np.arange(1, len(told) + 1)
    cos, sin = np.cos(phase), np.sin(phase)
    rows[0 : 2 * len(told) : 2] = cos * told[:, 0] + sin * told[:, 1]
    rows[1 : 2 * len(told) : 2] = sin * told[:, 0] - cos * told[:, 1]
    return rows


def prior_std(prior: RingPrior, highest: int, turns: int) -> Array:
    """(q,) standard deviation of each unknown of `head_rows`, then of as many combinations of the azimuths."""
    found = [prior.eccentricity] * 2 + [prior.motion] * 2
    for order in range(2, highest + 1):
        found += [prior.motion] * 4 + [prior.graduation_std(order)] * 2
    return np.array(found + [prior.azimuth] * turns)


@dataclass(frozen=True)
class RingFit:
    """Ring and rotor for one layout of heads.

    Attributes:
        evidence: logarithm of the marginal likelihood, up to a constant that all layouts of one recording share.
        values: (q,) unknowns as in `prior_std`.
        covariance: (q, q) of them.
        azimuth_offsets: (n,) of the heads, rad, zero on average, for a turn common to all is the direction of x; but
            not where a measured graduation tells that turn.
        turn: (n, m) unit vectors of the azimuths by the m unknowns that they have.
        chi_square: of what the layout leaves, and its degrees of freedom.
    """

    evidence: float
    values: Array
    covariance: Array
    azimuth_offsets: Array
    turn: Array
    chi_square: tuple[float, int]

    @property
    def highest(self) -> int:
        """Highest order."""
        return int(len(self.values) - self.turn.shape[1] + 2) // 6

    def graduation(self, order: int) -> tuple[Array, Array]:
        """Cosine and sine (2,) of an order of the graduation from 2 on, rad, with their covariance (2, 2)."""
        at = slice(6 * (order - 2) + 8, 6 * (order - 2) + 10)
        return self.values[at], self.covariance[at, at]

    @property
    def eccentricity(self) -> Array:
        """(2,) of the ring and of what else goes round with the rotor, m."""
        return self.values[:2]

    @cached_property
    def azimuth_covariance(self) -> Array:
        """(n, n) of the azimuth offsets, rad²."""
        turns = self.turn.shape[1]
        return np.asarray(self.turn @ self.covariance[-turns:, -turns:] @ self.turn.T)


def fit_ring(orders: OrderCoefficients, azimuths: Array, prior: RingPrior) -> RingFit:
    """Ring and rotor by what heads at azimuths (n,) show."""
    count, highest = len(azimuths), orders.highest
    turn = helmert(count).T if prior.curve is None else np.eye(count)
    turns = turn.shape[1]
    std = prior_std(prior, highest, turns)
    offsets, values = np.zeros(count), np.zeros(len(std))
    for _ in range(ROUNDS):
        at = azimuths + offsets
        rows = np.array([head_rows(each, highest, prior.radius) for each in at])
        ahead = np.array([head_rows(each + NUDGE, highest, prior.radius) for each in at])
        curve, curve_ahead = (
            np.array([curve_rows(each, highest, prior.curve) for each in there]) for there in (at, at + NUDGE)
        )
        shown = values[: rows.shape[2]]
        slope = ((ahead - rows) @ shown + curve_ahead - curve) / NUDGE
        linear = np.einsum("nc,nij->cij", orders.channels, rows)
        turned = np.einsum("nc,ni,na->cia", orders.channels, slope, turn)
        design = np.concatenate([linear, turned], axis=2)
        # the slope is taken where the azimuths stand by now
        moved = np.einsum("cia,a->ci", turned, turn.T @ offsets)
        target = orders.whitened + np.einsum("cij,cj->ci", orders.whitener, moved - orders.channels.T @ curve)
        white = np.einsum("cij,cjq->ciq", orders.whitener, design).reshape(-1, len(std)) * std
        information = np.eye(len(std)) + white.T @ white
        right = white.T @ target.ravel()
        scaled = np.linalg.solve(information, right)
        values = scaled * std
        offsets = turn @ values[-turns:]
    residual = target.ravel() - white @ scaled
    evidence = -0.5 * (float(residual @ residual) + float(scaled @ scaled)) - 0.5 * np.linalg.slogdet(information)[1]
    covariance = np.linalg.inv(information) * np.outer(std, std)
    return RingFit(
        float(evidence),
        values,
        covariance,
        offsets,
        turn,
        (float(residual @ residual) + float(scaled @ scaled), residual.size),
    )
