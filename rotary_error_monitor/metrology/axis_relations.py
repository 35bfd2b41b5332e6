"""How two axes lie beside each other: squareness, perpendicularity, parallelism, coplanarity and concentricity.

Each follows from the lines of both, with the uncertainty of their points and directions together. A relation of one
component has a sign; one of two components, such as a parallelism error, is their size, which is never negative: its
bounds are those of a size (Rice's distribution), not a value more or less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.axis_fits import LineFit

COVERED = 0.95
"""Probability with which the truth lies within the bounds."""

STEP = 1e-6
"""Of a numerical derivative, m or rad: its square, and rounding over it, both are far below any uncertainty."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)
"""For the integral of a density over a disc, which is smooth but for its edge."""

FARTHEST = 9.0
"""Standard deviations beyond which a normal density holds less than 1e-18."""

FAR = 20.0
"""Standard deviations from which a size is normal: across it, the circle departs from its tangent by less than 1/40."""

LEAST_SPREAD = 1e-3
"""Least standard deviation in one direction, as a part of that in the other: a smaller one does not matter."""

CIRCLE = np.stack([np.cos(np.arange(720) * math.pi / 360), np.sin(np.arange(720) * math.pi / 360)])
"""Directions from which the likeliest is taken, half a degree apart: at twenty standard deviations a sixth of one."""


@dataclass(frozen=True)
class Relation:
    """What was found of two axes.

    Attributes:
        value: rad or m; of one component less than 90 degrees, or less than nominal, is negative.
        uncertainty: standard uncertainty, rad or m.
        low, high: bounds between which the truth lies with a probability of 95 %.
    """

    value: float
    uncertainty: float
    low: float
    high: float


def squareness(first: LineFit, second: LineFit) -> Relation:
    """Angle between two directions less 90 degrees, rad (ISO 230-1, 3.6.7)."""

    def angle(lines: Array) -> Array:
        return np.array([-math.asin(float(_unit(lines[0, 3:]) @ _unit(lines[1, 3:])))])

    return _signed(angle, [first, second])


def perpendicularity(axis: LineFit, first: LineFit, second: LineFit) -> Relation:
    """Angle between an axis and the normal of the plane that two others span, rad."""
    normal = _unit(np.cross(first.direction, second.direction))
    across = _across(normal)

    def lean(lines: Array) -> Array:
        plane = np.cross(lines[1, 3:], lines[2, 3:])
        return _slopes(lines[0, 3:], normal, across) - _slopes(plane, normal, across)

    return _size(lean, [axis, first, second])


def parallelism(first: LineFit, second: LineFit) -> Relation:
    """Angle between two axes that should run alike, rad."""
    middle, across = second.direction, _across(second.direction)

    def lean(lines: Array) -> Array:
        return _slopes(lines[0, 3:], middle, across) - _slopes(lines[1, 3:], middle, across)

    return _size(lean, [first, second])


def coplanarity(first: LineFit, second: LineFit, nominal: float = 0.0) -> Relation:
    """Distance of two axes that cross, m, less the nominal one.

    Both are signed: along the cross product of the directions, from the second axis to the first.
    """

    def distance(lines: Array) -> Array:
        normal = _unit(np.cross(lines[0, 3:], lines[1, 3:]))
        return np.array([(lines[0, :3] - lines[1, :3]) @ normal - nominal])

    return _signed(distance, [first, second])


def concentricity(first: LineFit, second: LineFit, at: Array) -> Relation:
    """Distance of two axes that should coincide, m, in the plane through the point `at` (3,)."""
    return _size(_apart(second.direction, at), [first, second])


def distance_alike(first: LineFit, second: LineFit, at: Array, nominal: float) -> Relation:
    """Distance of two axes that run alike, m, less the nominal one, in the plane through the point `at` (3,)."""
    apart = _apart(second.direction, at)
    return _signed(lambda lines: np.array([np.linalg.norm(apart(lines)) - nominal]), [first, second])


def _apart(middle: Array, at: Array) -> Callable[[Array], Array]:
    """What gives the (2,) distance of two lines across `middle`, in the plane through `at`."""
    across = _across(middle)

    def distance(lines: Array) -> Array:
        places = [line[:3] + line[3:] * ((at - line[:3]) @ middle) / (line[3:] @ middle) for line in lines]
        return np.asarray(across @ (places[0] - places[1]), dtype=np.float64)

    return distance


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _across(direction: Array) -> Array:
    """(2, 3) two unit vectors across a direction."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = _unit(np.cross(direction, least))
    return np.stack([first, np.cross(direction, first)])


def _slopes(direction: Array, middle: Array, across: Array) -> Array:
    """(2,) slopes of a direction against `middle`, whichever way it runs."""
    return np.asarray(across @ direction / (middle @ direction), dtype=np.float64)


def _propagated(function: Callable[[Array], Array], lines: Sequence[LineFit]) -> tuple[Array, Array]:
    """Value (k,) and covariance (k, k) of a function of lines (m, 6), each a point and a direction."""
    middle = np.array([[*line.point, *line.direction] for line in lines])
    columns, covariance = [], np.zeros((middle.size, middle.size))
    for number, line in enumerate(lines):
        place = slice(6 * number, 6 * number + 6)
        covariance[place, place] = np.block(
            [
                [line.point_covariance, line.cross_covariance],
                [line.cross_covariance.T, line.direction_covariance],
            ]
        )
    for k in range(middle.size):
        step = np.zeros(middle.size)
        step[k] = STEP
        moved = step.reshape(middle.shape)
        columns.append((function(middle + moved) - function(middle - moved)) / (2 * STEP))
    jacobian = np.stack(columns, axis=1)
    return function(middle), np.asarray(jacobian @ covariance @ jacobian.T)


def _signed(function: Callable[[Array], Array], lines: Sequence[LineFit]) -> Relation:
    value, covariance = _propagated(function, lines)
    uncertainty = math.sqrt(max(float(covariance[0, 0]), 0.0))
    margin = -float(ndtri((1 - COVERED) / 2)) * uncertainty
    found = float(value[0])
    return Relation(found, uncertainty, found - margin, found + margin)


def _size(function: Callable[[Array], Array], lines: Sequence[LineFit]) -> Relation:
    value, covariance = _propagated(function, lines)
    size = float(np.linalg.norm(value))
    along = value / size if size > 0 else np.array([1.0, 0.0])
    uncertainty = math.sqrt(max(float(along @ covariance @ along), 0.0))
    low, high = size_bounds(value, covariance)
    return Relation(size, uncertainty, low, high)


def size_bounds(value: Array, covariance: Array) -> tuple[float, float]:
    """Bounds of the true size of a vector (2,) that was measured with a covariance (2, 2), at 95 %.

    Each bound is the true size for which a measured one as small, or as large, has a probability of 2.5 %; the true
    direction is the likeliest for that size, as in a profile likelihood. What is smaller than noise mostly makes it
    would have an upper bound near zero, or at it: there it is that of the median which noise alone makes (power
    constrained limits: Cowan et al. 2011, arXiv:1105.3166).
    """
    variances, axes = np.linalg.eigh(covariance)
    spread = np.sqrt(np.maximum(variances, 0.0))
    size = float(np.linalg.norm(value))
    if spread[1] == 0.0:
        return size, size
    spread = np.maximum(spread, LEAST_SPREAD * spread[1])
    seen, tail = axes.T @ value, (1 - COVERED) / 2
    own = float(np.linalg.norm(spread * seen) / size) if size > 0 else 0.0
    if size > FAR * float(spread[1]):
        margin = -float(ndtri(tail)) * own
        return size - margin, size + margin

    def excess(true: float, probability: float) -> float:
        places = true * CIRCLE
        likeliest = int(np.argmin((((places - seen[:, None]) / spread[:, None]) ** 2).sum(axis=0)))
        return _within(size, places[:, likeliest], spread) - probability

    most, near = size + FARTHEST * float(spread[1]), 1e-3 * float(spread[0])
    low = 0.0 if excess(0.0, 1 - tail) <= 0 else float(brentq(excess, 0.0, most, args=(1 - tail,), xtol=near))
    usual = float(brentq(lambda radius: _within(radius, np.zeros(2), spread) - 0.5, 0.0, most, xtol=near))
    if size < usual:
        seen, size = (seen * usual / size if size > 0 else np.array([0.0, usual])), usual
    return low, float(brentq(excess, 0.0, most, args=(tail,), xtol=near))


def _within(radius: float, centre: Array, spread: Array) -> float:
    """Probability that a normal vector (2,) with this centre and these standard deviations is shorter than `radius`."""
    low = max(-radius, float(centre[0] - FARTHEST * spread[0]))
    high = min(radius, float(centre[0] + FARTHEST * spread[0]))
    if low >= high:
        return 0.0
    first = 0.5 * (high - low) * NODES + 0.5 * (high + low)
    half = np.sqrt(np.maximum(radius**2 - first**2, 0.0))
    inside = ndtr((half - centre[1]) / spread[1]) - ndtr((-half - centre[1]) / spread[1])
    density = np.exp(-0.5 * ((first - centre[0]) / spread[0]) ** 2) / (spread[0] * math.sqrt(2 * math.pi))
    return float(0.5 * (high - low) * (WEIGHTS * density * inside).sum())
