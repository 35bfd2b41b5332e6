"""Measured curves over a turn: their values, slopes and orders, and how far interpolation may miss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.periodic_tables import AngularTable, PeriodicTable, PlanarTable
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.metrology.encoder_heads import LEAST_SEEN, HeadLayout, seen_part
from rotary_error_monitor.metrology.harmonics import angular_sum, planar_sum

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


HALL_MEYER = 5 / 384
"""Of h⁴ max|f''''|: largest distance of a cubic spline through values of f from f (Hall and Meyer 1976, J. Approx.
Theory 16, 105-122)."""

TO_A_WAVE = 8
"""Angles of a table to a wave of the highest order that it tells: interpolation misses 0.5 % of that one."""

MOST_DOUBTED = 16
"""Orders over which the uncertainty of a curve is spread at most: each costs a diagnosis as many predictions as it has
coefficients, and orders of error motion and graduation that matter are lower."""

_SAMPLES = 8192
"""Of a turn from which orders of a spline are taken: two to each angle of the finest table."""


@lru_cache(maxsize=64)
def curve(table: PeriodicTable) -> CubicSpline:
    """The periodic cubic spline through a table, of the angle in rad; its values have the table's columns."""
    from scipy.interpolate import CubicSpline  # loads for a third of a second, and most stages have no measured curve

    angles, values = table.knots
    return CubicSpline(angles, values, bc_type="periodic")


@lru_cache(maxsize=64)
def _slope(table: PeriodicTable) -> CubicSpline:
    return curve(table).derivative()


def graduation_error(encoder: Encoder, psi: Array) -> Array:
    """Error of the graduation, rad, at ring positions `psi`, rad, of any shape: harmonics and measured curve."""
    total = angular_sum(encoder.graduation, psi)
    return total if encoder.graduation_table is None else total + angular_values(encoder.graduation_table, psi)


def mirror_form(mirror: Mirror, theta: Array) -> Array:
    """(m, 2) tilt that a mirror shows because it is not flat, rad, at rotations (m,): harmonics and measured curve."""
    total = planar_sum(mirror.flatness, theta)
    return total if mirror.flatness_table is None else total + planar_values(mirror.flatness_table, theta)


def angular_values(table: AngularTable, psi: Array) -> Array:
    """Values of a curve at angles of any shape, rad."""
    return np.asarray(curve(table)(psi)[..., 0], np.float64)


def angular_slopes(table: AngularTable, psi: Array) -> Array:
    """Slopes of a curve at angles of any shape, rad/rad."""
    return np.asarray(_slope(table)(psi)[..., 0], np.float64)


def planar_values(table: PlanarTable, theta: Array) -> Array:
    """(m, 2) values of a curve of a vector at rotations (m,)."""
    return np.asarray(curve(table)(theta), np.float64)


def steepest(table: PeriodicTable) -> float:
    """Largest slope of a curve, rad/rad: of a vector its length."""
    at = np.linspace(0.0, 2 * np.pi, _SAMPLES, endpoint=False)
    return float(np.linalg.norm(_slope(table)(at), axis=1).max())


def interpolation_bound(orders: Sequence[int], amplitudes: Sequence[float], gap: float) -> float:
    """How far the spline through values of a sum of waves may be from it, where angles stand `gap` rad apart at most.

    Args:
        orders: of the waves.
        amplitudes: of the waves.
        gap: largest one between neighbouring angles, rad.
    """
    size = np.abs(np.asarray(amplitudes, np.float64))
    return float(HALL_MEYER * np.sum((np.asarray(orders, np.float64) * gap) ** 4 * size))


def angular_orders(table: AngularTable, highest: int) -> tuple[AngularHarmonic, ...]:
    """Orders 0 to `highest` of a curve; what remains of it is of higher ones."""
    cos, sin = _orders(table, highest)
    return tuple(AngularHarmonic(k, float(cos[k, 0]), float(sin[k, 0])) for k in range(highest + 1))


def planar_orders(table: PlanarTable, highest: int) -> tuple[PlanarHarmonic, ...]:
    """Orders 0 to `highest` of a curve of a vector."""
    cos, sin = _orders(table, highest)
    rows = np.stack([cos, sin], axis=2)
    pairs = [[(float(row[axis, 0]), float(row[axis, 1])) for axis in range(2)] for row in rows]
    return tuple(PlanarHarmonic(k, x, y) for k, (x, y) in enumerate(pairs))


def _orders(table: PeriodicTable, highest: int) -> tuple[Array, Array]:
    """(highest + 1, c) cosine and sine of the orders of a spline."""
    values = curve(table)(np.arange(_SAMPLES) * (2 * np.pi / _SAMPLES))
    waves = np.fft.rfft(values, axis=0)[: highest + 1] * (2 / _SAMPLES)
    waves[0] /= 2
    return np.asarray(waves.real, np.float64), np.asarray(-waves.imag, np.float64)


def doubted_orders(table: PeriodicTable) -> tuple[tuple[int, ...], float]:
    """Orders among which the uncertainty of a curve lies, and the standard uncertainty of each coefficient, rad.

    These are as many orders as stand `TO_A_WAVE` angles to the shortest wave, from the second on: the first is that of
    eccentricity and tilt of the mirror, which have uncertainties of their own. Together they make each value as
    uncertain as the table says. Where the values of a table err one by one, its low orders are surer than that.
    """
    count = min(MOST_DOUBTED, max(1, (len(table.knots[0]) - 1) // TO_A_WAVE))
    return tuple(range(2, 2 + count)), table.uncertainty / float(np.sqrt(count))


def curve_in_radial(encoder: Encoder) -> float:
    """Variance that the uncertainty of a measured graduation adds to the radial error motion along x or y, m².

    It is taken to lie in the orders that heads between centres tell: what all heads see alike is no displacement, and
    a curve that the same heads measured has nothing of it.
    """
    table = encoder.graduation_table
    if table is None or table.uncertainty == 0.0 or len(encoder.azimuths) < 2:
        return 0.0
    azimuths = tuple(encoder.azimuths.values())
    highest = 1 + max(1, (len(table.knots[0]) - 1) // TO_A_WAVE)
    orders = [k for k in range(2, highest + 1) if seen_part(np.array(azimuths), k) >= LEAST_SEEN]
    parts = [view.as_radial for view in HeadLayout(azimuths).graduation_view(orders)]
    share = float(np.mean(np.square(parts))) if parts else 0.0
    return share * (encoder.disc_radius * table.uncertainty) ** 2


STANDS_OUT = 4.0
"""Standard uncertainties of a coefficient from which an order of a curve is more than its noise: of some hundred
orders hardly one is by chance."""


def stage_by_orders(stage: StageDescription, highest: int, least: tuple[float, float]) -> StageDescription:
    """The stage with its measured curves as harmonics, up to `highest`, as far as they stand out.

    Order 1 of a graduation is left out: it is eccentricity, which nothing tells from it. What a table says of its
    uncertainty is then that of its coefficients.

    Args:
        stage: as described.
        highest: order beyond which nothing is taken.
        least: amplitudes in the curves of ring and mirror below which an order is none, rad.
    """
    encoder, mirror, doubts = stage.encoder, stage.mirror, dict(stage.uncertainty)
    if encoder is not None and encoder.graduation_table is not None:
        limit = max(least[0], STANDS_OUT * coefficient_std(encoder.graduation_table))
        _doubt(doubts, "encoder.graduation", encoder.graduation_table)
        found = angular_orders(encoder.graduation_table, highest)
        more = tuple(row for row in found if row.order != 1 and np.hypot(row.cos, row.sin) > limit)
        encoder = replace(encoder, graduation=_with_angular(encoder.graduation, more), graduation_table=None)
    if mirror.flatness_table is not None:
        limit = max(least[1], STANDS_OUT * coefficient_std(mirror.flatness_table))
        _doubt(doubts, "mirror.flatness", mirror.flatness_table)
        forms = planar_orders(mirror.flatness_table, highest)
        flat = tuple(row for row in forms if np.linalg.norm([*row.x, *row.y]) > limit)
        mirror = replace(mirror, flatness=_with_planar(mirror.flatness, flat), flatness_table=None)
    return replace(stage, encoder=encoder, mirror=mirror, uncertainty=doubts)


def _doubt(doubts: dict[str, float], name: str, table: PeriodicTable) -> None:
    """Add to the uncertainties of a stage that of coefficients that are from a table, if it states one."""
    if table.uncertainty:
        doubts[name] = float(np.hypot(doubts.get(name, 0.0), coefficient_std(table)))


def coefficient_std(table: PeriodicTable) -> float:
    """Standard uncertainty of a coefficient of one of the orders that a table tells, rad."""
    return table.uncertainty / float(np.sqrt(max(1, (len(table.knots[0]) - 1) // TO_A_WAVE)))


def _with_angular(rows: tuple[AngularHarmonic, ...], more: tuple[AngularHarmonic, ...]) -> tuple[AngularHarmonic, ...]:
    """Rows with others added to those of the same order."""
    sums: dict[int, AngularHarmonic] = {}
    for row in (*rows, *more):
        old = sums.get(row.order, AngularHarmonic(row.order, 0.0, 0.0))
        sums[row.order] = AngularHarmonic(row.order, old.cos + row.cos, old.sin + row.sin)
    return tuple(sums[order] for order in sorted(sums))


def _with_planar(rows: tuple[PlanarHarmonic, ...], more: tuple[PlanarHarmonic, ...]) -> tuple[PlanarHarmonic, ...]:
    """Rows with others added to those of the same order."""
    sums: dict[int, PlanarHarmonic] = {}
    for row in (*rows, *more):
        old = sums.get(row.order, PlanarHarmonic(row.order, (0.0, 0.0), (0.0, 0.0)))
        x, y = ((a[0] + b[0], a[1] + b[1]) for a, b in ((old.x, row.x), (old.y, row.y)))
        sums[row.order] = PlanarHarmonic(row.order, x, y)
    return tuple(sums[order] for order in sorted(sums))
