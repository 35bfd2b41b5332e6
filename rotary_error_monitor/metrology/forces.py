"""Force on the shaft from readings of load cells that look along directions of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.listed_sensors import ListedSensor

UNSEEN = 1e-3
"""Part of the information on a force below which a direction counts as unseen: cells less than 2° from parallel."""

GAP = 3.5
"""Periods of a load cell without a sample between which nothing is known of its force."""


@dataclass(frozen=True)
class LoadCell:
    """One load cell; its second axis stands 90° about +z from the first.

    Attributes:
        azimuth: of its first axis, rad about +z.
        axes: 1 or 2.
        zeros: readings without a force, N.
        gain: reading per force.
        deviation: standard deviation of a reading, rounding included, N.
    """

    azimuth: float
    axes: int
    zeros: tuple[float, ...]
    gain: float
    deviation: float

    @property
    def directions(self) -> Array:
        """(axes, 2) unit vectors of its axes along x and y of the stage."""
        cos, sin = math.cos(self.azimuth), math.sin(self.azimuth)
        return np.array([[cos, sin], [-sin, cos]])[: self.axes]

    def force(self, readings: Array) -> Array:
        """(n, 2) force along x and y of the stage, N, from readings (n, 2); 0 across a cell of one axis."""
        along = (readings - np.array(self.zeros)) / self.gain
        return np.asarray(along[:, : self.axes] @ self.directions)


def load_cell(sensor: ListedSensor) -> LoadCell:
    """The load cell that a stage lists."""
    deviation = math.hypot(sensor.noise, sensor.resolution / math.sqrt(12)) or 1e-9 * sensor.range
    axes = round(sensor.place.get("axes", 2))
    return LoadCell(sensor.place["azimuth"], axes, sensor.zeros, sensor.gain, deviation)


def shares(cells: Sequence[LoadCell]) -> list[Array]:
    """(2, 2) matrices of which `sum(share @ force)` over the cells is the force by weighted least squares.

    A direction that no cell looks along has none: the force is 0 there.
    """
    weights = [(cell.gain / cell.deviation) ** 2 for cell in cells]
    information = sum(w * cell.directions.T @ cell.directions for w, cell in zip(weights, cells, strict=True))
    covariance = np.linalg.pinv(information, rcond=UNSEEN, hermitian=True)
    return [np.asarray(w * covariance) for w in weights]


def joined_force(cells: Sequence[LoadCell], times: Sequence[Array], readings: Sequence[Array]) -> tuple[Array, Array]:
    """Times (m,) s and force (m, 2) N from times (n,) and readings (n, 2) of each cell, one or several.

    Times are those of the cell with most samples at which all others are known too.
    """
    forces = [cell.force(values) for cell, values in zip(cells, readings, strict=True)]
    if len(cells) == 1:
        return times[0], forces[0]
    at = max(times, key=len)
    for own in times:
        at = at[_known(at, own)]
    total = np.zeros((len(at), 2))
    for share, own, force in zip(shares(cells), times, forces, strict=True):
        total += np.column_stack([np.interp(at, own, column) for column in force.T]) @ share.T
    return at, total


def _known(at: Array, times: Array) -> NDArray[np.bool_]:
    """(m,) which times (m,) lie between neighbouring samples at times (n,), and not in a gap."""
    after = np.searchsorted(times, at)
    inside = (at >= times[0]) & (at <= times[-1])
    before, after = np.clip(after - 1, 0, len(times) - 1), np.clip(after, 0, len(times) - 1)
    return np.asarray(inside & (times[after] - times[before] <= GAP * float(np.median(np.diff(times)))))
