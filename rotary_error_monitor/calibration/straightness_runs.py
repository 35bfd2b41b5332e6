"""Readings of a straightness test: its placements, and what the runs of each have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.measurements import Placement, read_straightness
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.reference_mirror import PlacementReadings, ReferenceMirror
from rotary_error_monitor.metrology.repeated_runs import RepeatedRuns, Run, combine_runs
from rotary_error_monitor.metrology.splicing import SplicedProfile, splice_segments


@dataclass(frozen=True)
class ReadingSettings:
    """How the readings of a straightness test are to be taken.

    Attributes:
        noise: standard deviation of one, m.
        position_noise: standard deviation of the position of a stop, m.
        drop_outliers: leave out readings that stand off from those of other runs.
    """

    noise: float
    position_noise: float = 0.0
    drop_outliers: bool = False


@dataclass(frozen=True)
class Placed:
    """A placement's runs, what they have in common, and that without the readings that stand off."""

    segment: PlacementReadings
    runs: tuple[Run, ...]
    combined: RepeatedRuns
    without: RepeatedRuns

    def departures(self) -> list[Array]:
        """(n,) of each run, its readings less the mean of its direction and less the run's own height, m."""
        if not self.combined.stops:
            return list(self.combined.residuals)
        found = []
        for run in self.runs:
            mean = self.combined.mean
            if self.combined.reversal is not None:
                mean = mean + run.direction * self.combined.reversal / 2
            departure = run.readings - np.interp(run.positions, self.combined.positions, mean)
            found.append(np.asarray(departure - departure.mean(), dtype=np.float64))
        return found


@dataclass(frozen=True)
class Measured:
    """The placements of a file, and the profile spliced from them."""

    parts: tuple[Placed, ...]
    spliced: SplicedProfile


def measure_straightness(
    path: Path,
    axis: Axis,
    mirror: ReferenceMirror | None,
    reading: ReadingSettings,
    spacing: float | None = None,
    layout: ColumnLayout | None = None,
) -> Measured:
    """Profile of an axis's guideway from a file of readings along a mirror; without one, of the whole axis at once.

    Raises:
        InputError: the table is wrong, segments do not fit, or there are several and no mirror; the file is named.
    """
    try:
        parts = tuple(place_runs(placement, reading) for placement in read_straightness(path, axis, layout).values())
        spliced = splice_segments([part.segment for part in parts], mirror, spacing=spacing)
    except InputError as error:
        raise (error if str(path) in str(error) else InputError(f"{path}: {error}")) from error
    return Measured(parts, spliced)


def place_runs(placement: Placement, reading: ReadingSettings) -> Placed:
    """What the runs along one placement have in common, and the segment that it makes."""
    runs = placement.runs
    combined = combine_runs(runs, noise=reading.noise, position_noise=reading.position_noise)
    without = combined
    if combined.outliers:
        without = combine_runs(runs, noise=reading.noise, position_noise=reading.position_noise, drop_outliers=True)
    if reading.drop_outliers:
        combined = without
    stated = reading.noise * np.sqrt(combined.weights)
    noise = stated
    if combined.uncertainty is not None:
        # repeated runs tell the noise themselves; readings that hardly change may hide it; where neighbours go
        # together, a spline that averages about two of them averages less
        noise = np.maximum(combined.uncertainty * math.sqrt(1 + combined.correlation), stated / 2)
    start = min(float(run.positions.min()) for run in runs)
    segment = PlacementReadings(combined.positions, combined.mean, noise, start, placement.turned)
    return Placed(segment, runs, combined, without)
