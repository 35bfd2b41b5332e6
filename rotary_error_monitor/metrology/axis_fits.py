"""Lines, planes and circles in space, axis average lines, squareness and location errors (ISO 230-1, ISO 230-7).

Each fit takes points (n, 3) m and, if known, their covariances (n, 3, 3) m². With covariances the fit is weighted and
its covariance follows from them; without, all directions count alike and the residuals' scatter gives the covariance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.distributions import f_limit

MEDIAN_OF_TWO_SQUARES = 2 * math.log(2)
"""Median of the sum of two squared standard normal values."""

MEDIAN_EFFICIENCY = 0.4
"""Information in the median of squares beside that in their mean, for normal values."""


@dataclass(frozen=True)
class LineFit:
    """A line in space, such as the path of a linear axis or the axis average line of a rotary one.

    Attributes:
        point: (3,) the point of the line nearest to the points' centre, m.
        direction: (3,) unit vector.
        point_covariance: (3, 3) m².
        direction_covariance: (3, 3) rad².
        cross_covariance: (3, 3) of point (rows) and direction (columns), m rad.
        scatter: root mean square distance of the points from what was fitted, m.
        departures: (n,) distance of each point from what was fitted, over what its covariance or, without one, the
            scatter of all explains.
        ratio: root mean square residual over what the covariances explain, freedom counted; 1 without covariances.
    """

    point: Array
    direction: Array
    point_covariance: Array
    direction_covariance: Array
    scatter: float
    departures: Array = field(default_factory=lambda: np.zeros(0))
    ratio: float = 1.0
    cross_covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def reversed(self) -> LineFit:
        """The same line, running the other way."""
        return replace(self, direction=-self.direction, cross_covariance=-self.cross_covariance)

    def moved_along(self, distance: float) -> LineFit:
        """The same line by its point that lies `distance` m further along it."""
        mixed = distance * (self.cross_covariance + self.cross_covariance.T)
        return replace(
            self,
            point=self.point + distance * self.direction,
            point_covariance=self.point_covariance + mixed + distance**2 * self.direction_covariance,
            cross_covariance=self.cross_covariance + distance * self.direction_covariance,
        )


@dataclass(frozen=True)
class FittedSquareness:
    """Angle between two directions less 90 degrees, and its standard uncertainty, rad."""

    angle: float
    uncertainty: float


@dataclass(frozen=True)
class LocationErrors:
    """How the axis average line of a rotary axis lies beside its nominal one (ISO 230-7, 3.2.5 and ISO 230-1, 3.6).

    Attributes:
        shift: (3,) m, across the nominal axis, at the nominal point (x0c, y0c of a C axis).
        rotation: (3,) rotation vector, rad, across the nominal axis (a0c, b0c of a C axis).
        shift_uncertainty, rotation_uncertainty: (3,) standard uncertainties.
    """

    shift: Array
    rotation: Array
    shift_uncertainty: Array
    rotation_uncertainty: Array


def fit_line_in_space(points: Array, covariances: Array | None = None) -> LineFit:
    """Line of least distances; its direction runs from the first point towards the last.

    Raises:
        InputError: fewer than three points, points that coincide, shapes that do not fit, numbers that are not finite.
    """
    centre, across = _principal(points, covariances, least=3, rank=1)
    direction, first, second = across[0], across[1], across[2]

    def residuals(parameters: Array) -> Array:
        _, e1, e2 = _tilted(direction, first, second, parameters[:2])
        away = points - centre - parameters[2] * first - parameters[3] * second
        return _whitened(away, [e1, e2], covariances)

    parameters, covariance, scatter, ratio = _refine(residuals, np.zeros(4), points, covariances)
    departures = np.linalg.norm(residuals(parameters).reshape(-1, 2), axis=1)
    departures = departures if covariances is not None else departures / max(scatter, np.finfo(np.float64).tiny)
    tilted, _, _ = _tilted(direction, first, second, parameters[:2])
    sense = 1.0 if tilted @ (points[-1] - points[0]) >= 0 else -1.0
    basis = np.stack([first, second], axis=1)
    return _line(centre, basis, sense * tilted, parameters, covariance, (scatter, departures, ratio), sense)


def fit_axis_average_line(tracks: Sequence[Array], covariances: Sequence[Array] | None = None) -> LineFit:
    """Axis average line of a rotary axis from one or more targets that it carries round (ISO 230-7, 3.1.6).

    Each track (n, 3) is a circle about the same axis with a radius and a height of its own. One track defines the
    direction by its plane alone; two at different heights define it better. `point` is near the first track's centre.

    Raises:
        InputError: no track, fewer than four points in one, points on a line, numbers that are not finite.
    """
    if not tracks:
        raise InputError("no track; give the points of at least one target that the axis carries round")
    centre, axes = _principal(tracks[0], None if covariances is None else covariances[0], least=4, rank=2)
    for track in tracks[1:]:
        _principal(track, None, least=4, rank=2)
    normal = axes[2]
    turning = np.cross(tracks[0] - centre, np.roll(tracks[0], -1, axis=0) - centre)[:-1].sum(axis=0)
    normal = normal if turning @ normal >= 0 else -normal
    first, second = axes[0], np.cross(normal, axes[0])
    weights = [None] * len(tracks) if covariances is None else covariances

    def residuals(parameters: Array) -> Array:
        tilted, _, _ = _tilted(normal, first, second, parameters[:2])
        origin = centre + parameters[2] * first + parameters[3] * second
        rows = []
        for track, weight, (radius, height) in zip(tracks, weights, parameters[4:].reshape(-1, 2), strict=True):
            away = track - origin
            along = away @ tilted
            radial = away - along[:, None] * tilted
            distance = np.linalg.norm(radial, axis=1)
            outward = radial / distance[:, None]
            rows.append(_scaled(distance - radius, outward, weight))
            rows.append(_scaled(along - height, np.broadcast_to(tilted, outward.shape), weight))
        return np.concatenate(rows)

    start = _ring_start(tracks, centre, np.stack([first, second, normal]))
    points = np.concatenate(list(tracks))
    stacked = None if covariances is None else np.concatenate(list(covariances))
    parameters, covariance, scatter, ratio = _refine(residuals, start, points, stacked)
    halves = np.split(residuals(parameters), 2 * np.cumsum([len(track) for track in tracks])[:-1])
    departures = np.concatenate([np.linalg.norm(half.reshape(2, -1), axis=0) for half in halves])
    departures = departures if covariances is not None else departures / max(scatter, np.finfo(np.float64).tiny)
    tilted, _, _ = _tilted(normal, first, second, parameters[:2])
    basis = np.stack([first, second], axis=1)
    return _line(centre, basis, tilted, parameters, covariance, (scatter, departures, ratio))


def _line(
    centre: Array,
    basis: Array,
    direction: Array,
    parameters: Array,
    covariance: Array,
    left: tuple[float, Array, float],
    sense: float = 1.0,
) -> LineFit:
    """The line of fitted parameters (tilt 2, shift 2, others) along `basis` (3, 2), and what is left of the points."""
    return LineFit(
        centre + basis @ parameters[2:4],
        direction,
        basis @ covariance[2:4, 2:4] @ basis.T,
        basis @ covariance[:2, :2] @ basis.T,
        *left,
        cross_covariance=sense * basis @ covariance[2:4, :2] @ basis.T,
    )


def _ring_start(tracks: Sequence[Array], centre: Array, axes: Array) -> Array:
    """Parameters to begin with: no tilt, the first ring's centre, mean radius and height of each ring."""
    start = np.zeros(4 + 2 * len(tracks))
    start[2:4] = _planar_centre((tracks[0] - centre) @ axes[:2].T)
    for k, track in enumerate(tracks):
        x, y, height = axes @ (track - centre - start[2:4] @ axes[:2]).T
        start[4 + 2 * k] = np.hypot(x, y).mean()
        start[5 + 2 * k] = height.mean()
    return start


def find_outlying_points(line: LineFit, false_alarm: float) -> NDArray[np.int64]:
    """Indices of points that stand off from what was fitted further than the others let expect, farthest first.

    The scale is the median distance, so that what all points have in common, such as the straightness of the axis,
    counts as their scatter. `false_alarm` bounds the probability that clean points show any.
    """
    squares = line.departures**2
    scale = float(np.median(squares)) / MEDIAN_OF_TWO_SQUARES
    freedom = max(1.0, MEDIAN_EFFICIENCY * 2 * len(squares))
    limit = 2 * f_limit(false_alarm / max(1, len(squares)), 2, freedom)
    found = np.flatnonzero(squares > limit * scale)
    return np.asarray(found[np.argsort(-squares[found])], dtype=np.int64)


def estimate_squareness(first: LineFit, second: LineFit) -> FittedSquareness:
    """Squareness error between two axes: the angle between their directions less 90 degrees (ISO 230-1, 3.6.7)."""
    cosine = float(first.direction @ second.direction)
    variance = float(
        second.direction @ first.direction_covariance @ second.direction
        + first.direction @ second.direction_covariance @ first.direction
    )
    sine = math.sqrt(max(1e-12, 1 - cosine**2))
    return FittedSquareness(math.acos(max(-1.0, min(1.0, cosine))) - math.pi / 2, math.sqrt(variance) / sine)


def estimate_location_errors(line: LineFit, nominal_point: Array, nominal_direction: Array) -> LocationErrors:
    """Location errors of an axis average line, all in the frame of the machine.

    The nominal axis runs through `nominal_point` (3,) m along the unit vector `nominal_direction` (3,).

    Raises:
        InputError: the two directions are more than 0.1 rad apart.
    """
    sense = 1.0 if line.direction @ nominal_direction >= 0 else -1.0
    direction = sense * line.direction
    along = float(direction @ nominal_direction)
    rotation = np.cross(nominal_direction, direction / along)
    if np.linalg.norm(rotation) > 0.1:
        raise InputError(
            f"the axis lies {math.degrees(math.acos(along)):.1f}° off its nominal direction: another axis?"
        )
    distance = float((nominal_point - line.point) @ nominal_direction)
    shift = line.point + distance / along * direction - nominal_point
    across = np.eye(3) - np.outer(nominal_direction, nominal_direction)
    point_variance = across @ line.moved_along(sense * distance).point_covariance @ across
    turn = np.cross(nominal_direction, np.eye(3)).T
    turn_variance = turn @ line.direction_covariance @ turn.T
    return LocationErrors(
        shift=across @ shift,
        rotation=rotation,
        shift_uncertainty=np.sqrt(np.maximum(np.diag(point_variance), 0.0)),
        rotation_uncertainty=np.sqrt(np.maximum(np.diag(turn_variance), 0.0)),
    )


def _principal(points: Array, covariances: Array | None, *, least: int, rank: int) -> tuple[Array, Array]:
    """Centre of the points and their principal axes as rows, longest first; holds that the fit is possible."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points of shape {points.shape}; expected (n, 3)")
    if len(points) < least:
        raise InputError(f"{len(points)} points; this fit needs at least {least}")
    if not np.all(np.isfinite(points)):
        raise InputError(f"point {int(np.argmin(np.isfinite(points).all(axis=1)))} is not finite")
    if covariances is not None and covariances.shape != (len(points), 3, 3):
        raise InputError(f"covariances of shape {covariances.shape}; expected ({len(points)}, 3, 3)")
    centre = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - centre, full_matrices=False)
    if sizes[rank - 1] <= 1e-9 * max(1.0, sizes[0]):
        raise InputError("the points coincide" if rank == 1 else "the points lie on one line: they define no plane")
    return centre, axes


def _tilted(direction: Array, first: Array, second: Array, tilt: Array) -> tuple[Array, Array, Array]:
    """The direction tilted towards `first` and `second`, and two unit vectors across it."""
    tilted = direction + tilt[0] * first + tilt[1] * second
    tilted = tilted / np.linalg.norm(tilted)
    e1 = first - (first @ tilted) * tilted
    e1 = e1 / np.linalg.norm(e1)
    return tilted, e1, np.cross(tilted, e1)


def _planar_centre(points: Array) -> Array:
    """Centre of a circle through points (n, 2) by linear least squares (Kåsa): the start of the refinement."""
    design = np.column_stack([2 * points, np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0][:2], dtype=np.float64)


def _scaled(distances: Array, directions: Array, covariances: Array | None) -> Array:
    """Distances (n,) along directions (n, 3) over their standard deviation."""
    if covariances is None:
        return distances
    variance = ((directions[:, None, :] @ covariances)[:, 0, :] * directions).sum(axis=1)
    return np.asarray(distances / np.sqrt(variance), dtype=np.float64)


def _whitened(away: Array, directions: Sequence[Array], covariances: Array | None) -> Array:
    """Components of (n, 3) along one or two directions, uncorrelated and over their standard deviation."""
    basis = np.stack(directions)
    components = away @ basis.T
    if covariances is None:
        return components.ravel()
    lower = np.linalg.cholesky(basis @ covariances @ basis.T)
    return np.asarray(np.linalg.solve(lower, components[..., None]), dtype=np.float64).ravel()


def _refine(
    residuals: Callable[[Array], Array], start: Array, points: Array, covariances: Array | None
) -> tuple[Array, Array, float, float]:
    """Parameters of least squares, their covariance, the scatter of the points in m, and its ratio to the noise."""
    size = float(np.ptp(points, axis=0).max())
    scale = np.maximum(np.abs(start), min(size, 1.0))
    solution = least_squares(residuals, start, method="lm", x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    jacobian = np.array(solution.jac, dtype=np.float64)
    normal = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    square = float(solution.fun @ solution.fun)
    scatter = math.sqrt(square / len(points))
    freedom, ratio = max(1, len(solution.fun) - len(start)), 1.0
    if covariances is None:
        normal = normal * square / freedom
    else:
        scatter *= math.sqrt(float(np.trace(covariances.mean(axis=0))) / 3)
        ratio = math.sqrt(square / freedom)
    return np.asarray(solution.x, dtype=np.float64), np.asarray(normal, dtype=np.float64), scatter, ratio
