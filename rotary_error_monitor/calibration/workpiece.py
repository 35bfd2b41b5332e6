"""The measured surface of a ground workpiece, beside what straightness lets expect (Zhou et al. 2023, Figs 16, 17)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.copies import refuse_copies
from rotary_error_monitor.calibration.grinding import FlatnessPrediction
from rotary_error_monitor.calibration.measurements import LENGTH, LINEAR_ERROR
from rotary_error_monitor.calibration.quietness import FINEST_LENGTH
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.csv_tables import Column, Table, read_table
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.repeated_points import RepeatedPoints, combine_repeated
from rotary_error_monitor.metrology.repeated_runs import FALSE_ALARM
from rotary_error_monitor.metrology.surface_range import STATED, flatness_bounds

FEWEST_POINTS = 9
"""Points of a surface: three each way, for a plane and what bends it along, across and over the corners."""

LEAST_COVERED = 0.5
"""Part of the workpiece, each way, that the points span at least: a plane through less takes off what they should show,
and metres taken for mm span a thousandth."""

EDGE = 1e-6
"""By which a point may be beyond the workpiece, m: rounding of a file in mm."""

ON_A_LINE = 0.99
"""Correlation of the two positions from which points lie about one line: they spread a tenth as far across it."""

OTHER_UNIT = 100.0
"""Times what is predicted from which heights are in another unit, as is less than its reciprocal."""


@dataclass(frozen=True)
class MeasuredSurface:
    """Heights of a ground surface; of points that were measured more than once their means.

    Attributes:
        first, second: (n,) positions of the feed axes, m.
        heights: (n,) about the least squares plane, positive where the vertical axis is higher, m.
        predicted: (n,) what straightness alone predicts there before compensation, about its plane, m.
        points: the same as measured, with how often each was, and how much that scatters.
    """

    first: Array
    second: Array
    heights: Array
    predicted: Array
    points: RepeatedPoints

    @property
    def flatness(self) -> float:
        """Range of the heights, m."""
        return float(np.ptp(self.heights))

    @property
    def explained(self) -> float:
        """Part of the heights' mean square that goes when the prediction is taken off; below 0 where it adds to it."""
        rest = self.heights - self.predicted
        return 1 - float(rest @ rest) / float(self.heights @ self.heights)

    @property
    def contradiction(self) -> str | None:
        """Why the prediction is not that of this surface, in words; None where taking it off leaves less.

        A compensation takes the prediction off: one that leaves more than it takes makes the workpiece worse.
        """
        if self.explained >= 0:
            return None
        shared = float(self.heights @ self.predicted)
        opposite = -shared > float(self.predicted @ self.predicted) / 2
        return (
            f"the surface is flatter without what straightness predicts ({self.explained:.0%} of the variance), so "
            "compensation would make it worse: "
            + (
                "it is like the prediction negated: are heights positive where the vertical axis is, or is a curve of "
                "the machine file of the wrong sign?"
                if opposite
                else "are positions those of the axes, and is it of this machine?"
            )
        )


def read_workpiece(path: Path, prediction: FlatnessPrediction, layout: ColumnLayout | None = None) -> MeasuredSurface:
    """Surface from a CSV file with the feed axes' positions and `height_um`, wherever its points lie.

    With a `layout` from a table as an instrument writes it.

    Raises:
        InputError: what `read_table` raises, points beyond the workpiece, too few or too close ones, or heights in
            another unit.
    """
    names = [f"{letter}_mm" for letter in prediction.feeds]
    columns = [*(Column(name, LENGTH) for name in names), Column("height_um", LINEAR_ERROR)]
    table = read_table(path, [columns], layout=layout)
    at, heights = np.stack([table.numbers[name] for name in names], axis=1), table.numbers["height_um"]
    refuse_copies(table, {f"point {row + 1}": [row] for row in range(len(at))}, at, heights, FINEST_LENGTH)
    points = combine_repeated(*(table.numbers[name] for name in (*names, "height_um")))
    if len(points.counts) < FEWEST_POINTS:
        raise table.error(
            -1, f"the surface ends here with {len(points.counts)} point(s); {FEWEST_POINTS} are needed, three each way"
        )
    for name, curve in zip(prediction.feeds, prediction.curves, strict=True):
        at = table.numbers[f"{name}_mm"]
        _check_places(table, name, at, float(curve.positions[0]), float(curve.positions[-1]))
    places = [points.first, points.second]
    predicted = sum(
        np.interp(at, curve.positions, curve.errors) for at, curve in zip(places, prediction.curves, strict=True)
    )
    plane = np.stack([np.ones_like(places[0]), places[0] - places[0].mean(), places[1] - places[1].mean()], axis=1)
    if abs(float(np.corrcoef(places[0], places[1])[0, 1])) > ON_A_LINE:
        raise InputError(f"{path}: all points lie about one line; a surface takes points both ways")
    heights, predicted = (
        np.asarray(z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0])
        for z in (points.heights, np.asarray(predicted))
    )
    ratio = float(np.ptp(heights)) / max(float(np.ptp(predicted)), np.finfo(np.float64).tiny)
    if not 1 / OTHER_UNIT < ratio < OTHER_UNIT:
        raise InputError(
            f"{path}: flatness {np.ptp(heights) * 1e6:.3g} µm, where straightness makes {np.ptp(predicted) * 1e6:.3g}: "
            "are the heights in µm?"
        )
    return MeasuredSurface(places[0], places[1], heights, predicted, points)


def _check_places(table: Table, name: str, at: Array, low: float, high: float) -> None:
    table.refuse(
        (at < low - EDGE) | (at > high + EDGE),
        lambda row: (
            f"{name} {at[row] * 1e3:g} mm is beyond the workpiece, {low * 1e3:g} to {high * 1e3:g} mm: in "
            "another unit, or from another zero?"
        ),
    )
    if np.ptp(at) < LEAST_COVERED * (high - low):
        raise InputError(
            f"{table.path}: the points span {np.ptp(at) * 1e3:g} mm of the workpiece's {(high - low) * 1e3:g} mm along "
            f"{name}; at least half is needed: are they in mm?"
        )


def measured_text(name: str, surface: MeasuredSurface, noise: float | None) -> str:
    """Flatness as measured, in µm; `name` is when: before or after. `noise` is that of a reading, m, if stated.

    Where none is stated, points that were measured more than once tell it, as soon as they tell it to a tenth.
    """
    points = surface.points
    text = f"measured {name} compensation: flatness {surface.flatness * 1e6:.3f} µm over {surface.heights.size} points"
    if points.repeated:
        text += (
            f"\n  {points.repeated} of them measured more than once: the means count; readings scatter about them by "
            f"{points.scatter * 1e6:.3f} µm (degrees of freedom {points.freedom})"
        )
    if noise is None and points.freedom >= STATED and points.scatter > 0:
        noise = points.scatter
    if noise is not None:
        text += f"\n  {_interval(surface, noise)}"
    if name == "before":
        rest = surface.heights - surface.predicted
        text += (
            f"\n  predicted there {np.ptp(surface.predicted) * 1e6:.3f} µm, what is left {np.ptp(rest) * 1e6:.3f} µm; "
            f"straightness explains {surface.explained:.0%} of the variance"
        )
    return text


def _interval(surface: MeasuredSurface, noise: float) -> str:
    """The 95 % interval of the true flatness, or why there is none; `noise` is that of a reading, m."""
    probability = surface.points.p_value(noise)
    if probability < FALSE_ALARM:
        return (
            f"no 95 % interval: noise of {noise * 1e6:g} µm does not explain how repeated readings scatter (p-value "
            f"{probability:.1g})"
        )
    bounds = flatness_bounds(surface.first, surface.second, surface.heights, surface.points.noise_of_means(noise))
    if bounds is None:
        return f"no 95 % interval: it has more detail than noise of {noise * 1e6:.3g} µm explains, or is far smoother"
    return f"95 % interval without noise {bounds[0] * 1e6:.3f} to {bounds[1] * 1e6:.3f} µm"
