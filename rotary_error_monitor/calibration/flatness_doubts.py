"""How sure a predicted flatness is, by the covariance of the straightness curves, which a file beside them holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.grinding import FlatnessPrediction, ground_by_phase
from rotary_error_monitor.calibration.machine_poses import SAME_POSITION
from rotary_error_monitor.calibration.measurements import LENGTH, LINEAR_ERROR
from rotary_error_monitor.calibration.straightness_doubts import StraightnessUncertainty
from rotary_error_monitor.calibration.straightness_step import MOST_TABLE_ROWS, StraightnessResult
from rotary_error_monitor.description.csv_tables import Column, read_table
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.ground_range import compensated_bounds, level_factor, uncompensated_bounds
from rotary_error_monitor.metrology.splicing import SplicedProfile

Bounds = tuple[float, float]

SMALL = 1e-9
"""Part of the largest variance below which one is rounding."""

SAME = 2e-9
"""By which a value of the machine file and of the file of its covariance may be apart, m: digits of both."""


@dataclass(frozen=True)
class CurveDoubt:
    """The uncertainty of a straightness curve.

    Attributes:
        path: its file.
        positions, values: (n,) of the curve, m.
        factor: (n, m) of its covariance, which is the factor times its transpose, m.
        further: what a value may be off beside that, standard uncertainty in m: between readings, or where it was not
            repeated or does not fit.
    """

    path: Path
    positions: Array
    values: Array
    factor: Array
    further: float = 0.0


@dataclass(frozen=True)
class FlatnessBounds:
    """95 % intervals, m: before compensation, and after it for each reversal error, as measured and rotated."""

    before: Bounds
    unrotated: tuple[Bounds, ...]
    rotated: tuple[Bounds, ...]


def covariance_csv(result: StraightnessResult) -> str:
    """The curve of a straightness step as the machine file has it, and components of its covariance.

    A column each, and what they share is nothing: the covariance of two values is the sum over the columns of their
    products. What lies between readings, and what does not fit, has a column of its own.
    """
    positions, values = result.table
    factor = covariance_factor(result.spliced, result.doubts, positions)
    further = math.hypot(result.doubts.between, result.doubts.doubt)
    head = ["position_mm", "value_um", "further_um", *(f"component_{k}_um" for k in range(1, factor.shape[1] + 1))]
    rows = [
        ",".join([f"{x * 1e3:.9g}", f"{y * 1e6:.6f}", f"{further * 1e6:.6g}", *(f"{part * 1e6:.6g}" for part in parts)])
        for x, y, parts in zip(positions, values, factor, strict=True)
    ]
    return "\n".join([",".join(head), *rows]) + "\n"


def covariance_factor(spliced: SplicedProfile, doubts: StraightnessUncertainty, positions: Array) -> Array:
    """(n, m) factor of the covariance of a spliced curve about its line at `positions` (n,), m, the largest first."""
    at = np.stack([np.interp(positions, spliced.positions, row) for row in np.eye(spliced.positions.size)], axis=1)
    covariance = at @ spliced.deviation_covariance() @ at.T * (1 + doubts.correlation)
    squares, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    kept = squares > SMALL * squares.max()
    return np.asarray((vectors[:, kept] * np.sqrt(squares[kept]))[:, ::-1], dtype=np.float64)


def read_covariance(path: Path) -> CurveDoubt:
    """Curve and covariance as `covariance_csv` writes them.

    Raises:
        InputError: there is no such file, or it holds something else.
    """
    first = [Column("position_mm", LENGTH), *(Column(name, LINEAR_ERROR) for name in ("value_um", "further_um"))]
    parts = [Column(f"component_{k}_um", LINEAR_ERROR) for k in range(1, MOST_TABLE_ROWS + 1)]
    choices = [[*first, *parts[:count]] for count in range(1, len(parts) + 1)]
    table = read_table(
        path, choices, "position_mm,value_um,further_um,component_1_um,… as `straightness --covariance` writes it"
    )
    positions = table.numbers["position_mm"]
    fallen = np.flatnonzero(np.diff(positions) <= 0)
    if fallen.size:
        row = int(fallen[0]) + 1
        raise table.error(row, f"position_mm {positions[row] * 1e3:g} does not rise; expected rising positions")
    columns = [table.numbers[column.name] for column in parts if column.name in table.numbers]
    further = float(np.abs(table.numbers["further_um"]).max())
    return CurveDoubt(Path(path), positions, table.numbers["value_um"], np.stack(columns, axis=1), further)


def check_curve(machine: MachineDescription, vertical: str, letter: str, doubt: CurveDoubt) -> None:
    """Hold that a covariance belongs to the straightness curve that the machine file has.

    Raises:
        InputError: the file has no such curve, or another one.
    """
    up = "XYZ"[int(np.argmax(np.abs(machine.axis(vertical).direction)))]
    name = f"E{up}{letter}"
    component = machine.errors.get(name)
    if component is None or component.table is None:
        raise InputError(
            f"{doubt.path}: the machine file has no table {name}; expected one by `calibrate straightness`"
        )
    table = component.table
    values = (np.array(table.forward) + np.array(table.backward)) / 2
    if len(table.positions) == doubt.positions.size and np.allclose(
        table.positions, doubt.positions, rtol=0, atol=SAME_POSITION
    ):
        off = np.abs(values - doubt.values)
        if off.max() <= SAME:
            return
        at = int(np.argmax(off))
        what = (
            f"{doubt.values[at] * 1e6:.4f} µm at {doubt.positions[at] * 1e3:g} mm, the machine {values[at] * 1e6:.4f}"
        )
    else:
        what = f"{doubt.positions.size} positions, the machine {len(table.positions)} or others"
    raise InputError(
        f"{doubt.path}: not of the curve {name} of the machine file: it has {what}; expected the file that "
        "`calibrate straightness --covariance` wrote with it"
    )


def predict_bounds(prediction: FlatnessPrediction, doubts: Mapping[str, CurveDoubt]) -> FlatnessBounds:
    """95 % intervals for the flatness that a workpiece has, by the covariances of both curves, by axis."""
    curves = prediction.curves
    factors = [
        level_factor(doubts[letter].positions, doubts[letter].factor, curve.positions)
        for letter, curve in zip(prediction.feeds, curves, strict=True)
    ]
    level = [np.asarray(c.errors - np.polyval(np.polyfit(c.positions, c.errors, 1), c.positions)) for c in curves]
    further = tuple(doubts[letter].further for letter in prediction.feeds)
    unrotated, rotated = [], []
    for reversal in prediction.errors.reversal:
        found = ground_by_phase(*curves, reversal, prediction.errors)
        unrotated.append(compensated_bounds([each.unrotated.heights for each in found], factors, further))
        rotated.append(compensated_bounds([each.rotated.heights for each in found], factors, further))
    return FlatnessBounds(uncompensated_bounds(level, factors, further), tuple(unrotated), tuple(rotated))


def bounds_text(prediction: FlatnessPrediction, bounds: FlatnessBounds) -> str:
    """The intervals in µm, beside the reversal errors that were tried."""
    lines = [
        f"95 % interval before compensation {_shown(bounds.before)} µm; after it, wherever the positioning error lies:",
        f"reversal error of {prediction.vertical}, µm   curves as measured, µm   rotated to be monotone, µm",
    ]
    for reversal, one, other in zip(prediction.errors.reversal, bounds.unrotated, bounds.rotated, strict=True):
        lines.append(f"{reversal * 1e6:22.3f} {_shown(one):>24} {_shown(other):>27}")
    return "\n".join(lines)


def _shown(bounds: Bounds) -> str:
    return f"{bounds[0] * 1e6:.3f} to {bounds[1] * 1e6:.3f}"
