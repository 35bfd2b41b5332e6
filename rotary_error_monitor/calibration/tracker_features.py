"""What a laser tracker saw, feature by feature, and whether one feature is one line or one circle.

Headers (columns in any order):
    feature,distance_mm,elevation_deg,azimuth_deg    as the instrument reads
    feature,x_mm,y_mm,z_mm    in the frame of the instrument, as point lists have them
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.measurements import LENGTH, LINEAR_ERROR
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.tracker import estimate_points, estimate_readings

SPHERICAL = (Column("distance_mm", LENGTH), Column("elevation_deg", math.pi / 2), Column("azimuth_deg", 2 * math.pi))
CARTESIAN = tuple(Column(f"{name}_mm", LENGTH) for name in "xyz")

BACK = 0.01
"""Part of what a feature spans by which a point may lie before one that came earlier: stations closer together than
that tell no direction, and readings repeated at one station scatter by less."""


BETTER = 0.1
"""Part of the departures from one curve that two may leave: noise, which two follow better as well, leaves more."""


@dataclass(frozen=True)
class Feature:
    """Readings of one feature, in the order of the file.

    Attributes:
        distance: (n,) m.
        elevation, azimuth: (n,) rad.
        path: the file.
        lines: (n,) line of each reading in it.
    """

    distance: Array
    elevation: Array
    azimuth: Array
    path: Path
    lines: NDArray[np.int64]

    @property
    def points(self) -> Array:
        """(n, 3) m, in the frame of the instrument."""
        return estimate_points(self.distance, self.elevation, self.azimuth)

    def error(self, row: int, problem: str) -> InputError:
        """An error that says where in the file it is."""
        return InputError(f"{self.path}:{self.lines[row]}: {problem}")


def read_tracker(path: Path | str, layout: ColumnLayout | None = None) -> dict[str, Feature]:
    """Features by name, in the order of the file.

    With a `layout` from a table as an instrument writes it.

    Raises:
        InputError: what `read_table` raises, or a point at the instrument itself.
    """
    name = Column("feature", text=True)
    table = read_table(path, [[name, *SPHERICAL], [name, *CARTESIAN]], layout=layout)
    readings = _readings(table)
    features = np.array(table.words["feature"])
    found = {}
    for each in dict.fromkeys(table.words["feature"]):
        rows = features == each
        distance, elevation, azimuth = (column[rows] for column in readings)
        found[each] = Feature(distance, elevation, azimuth, table.path, table.lines[rows])
    return found


def _readings(table: Table) -> tuple[Array, Array, Array]:
    """Distance, elevation and azimuth of each row."""
    if CARTESIAN[0].name in table.numbers:
        readings = estimate_readings(np.stack([table.numbers[column.name] for column in CARTESIAN], axis=1))
        what = "a point at the instrument itself; expected coordinates in the instrument's own frame"
    else:
        distance, elevation, azimuth = (table.numbers[column.name] for column in SPHERICAL)
        readings = distance, elevation, azimuth
        what = "a distance that is not above 0; drop that reading"
    table.refuse(readings[0] <= 0, lambda row: what)
    return readings


def check_line(name: str, feature: Feature) -> None:
    """Hold that the points of a linear axis lie on one line and run along it one way.

    Raises:
        InputError: they lie on two, one after the other, or go back.
    """
    points = feature.points
    _check_one(name, feature, 3, _off_line, "line; name each axis by its own letter")
    along = (points - points[0]) @ (points[-1] - points[0])
    # of points that come back to where they began the farthest tells the direction
    if math.sqrt(abs(along[-1])) < 0.5 * float(np.linalg.norm(np.ptp(points, axis=0))):
        away = points - points[0]
        along = away @ away[int(np.argmax((away**2).sum(axis=1)))]
    behind = np.maximum.accumulate(along) - along
    if np.any(behind > BACK * np.ptp(along)):
        row = int(np.argmax(behind > BACK * np.ptp(along)))
        raise feature.error(
            row,
            f"feature {name}: this point lies {behind[row] / math.sqrt(np.ptp(along)) * 1e3:.6g} mm before one that "
            "came earlier; give the points of a linear axis once, in the order of its positive direction",
        )


def check_circle(name: str, feature: Feature) -> None:
    """Hold that the points of a target that turns lie on one circle.

    Raises:
        InputError: they lie on two, one after the other.
    """
    target = name if "." in name else f"{name}.1"
    _check_one(name, feature, 4, _off_circle, f"circle; name each target, such as {target} and another number")


def _check_one(name: str, feature: Feature, least: int, off: Callable[[Array], float], told: str) -> None:
    """Refuse points that are far from one curve, and near two where they are parted; `least` define one."""
    points = feature.points
    whole = off(points) if len(points) >= 2 * least else 0.0
    if whole <= LINEAR_ERROR:
        return
    parts = range(least, len(points) - least + 1)
    worst = [max(off(points[:k]), off(points[k:])) for k in parts]
    best = int(np.argmin(worst))
    if worst[best] <= min(LINEAR_ERROR, BETTER * whole):
        raise feature.error(
            parts[best], f"feature {name}: two features under one name? From here on the points lie on another {told}"
        )


def _off_line(points: Array) -> float:
    """Largest distance of points (n, 3) from their line of least squares, m."""
    away = points - points.mean(axis=0)
    direction = np.linalg.svd(away, full_matrices=False)[2][0]
    return float(np.linalg.norm(away - np.outer(away @ direction, direction), axis=1).max())


def _off_circle(points: Array) -> float:
    """Largest distance of points (n, 3) from a circle of least squares (Kåsa) in their plane, m."""
    away = points - points.mean(axis=0)
    first, second, normal = np.linalg.svd(away, full_matrices=False)[2]
    flat = np.stack([away @ first, away @ second], axis=1)
    design = np.column_stack([2 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(design, (flat**2).sum(axis=1), rcond=None)[0]
    radius = math.sqrt(max(float(rest + x**2 + y**2), 0.0))
    return float(np.hypot(np.linalg.norm(flat - [x, y], axis=1) - radius, away @ normal).max())
