"""Flatness that a machine's straightness leaves on a workpiece, and what compensation by a third axis makes of it.

Zhou et al. 2023, Section 3: the curve of each guideway is rotated as a whole until it is monotone, the error matrix of
the machining area is made of the two, and the workpiece's part is cut out of it. That is also what a machine file
states and what the compensation corrects by.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.known_readings import known_readings
from rotary_error_monitor.calibration.straightness_doubts import LEAST_OF_TRAVEL
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import MOST_LINES
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.machine.topology import branches
from rotary_error_monitor.metrology.guideway_compensation import (
    GrindingComparison,
    GroundSurface,
    VerticalAxis,
    WorkpieceCurve,
    compare_compensation,
    cut_workpiece,
    predict_corrections,
    predict_error_matrix,
    rotate_as_stated,
)
from rotary_error_monitor.metrology.straightness import estimate_straightness

Workpiece = Mapping[str, tuple[float, float]]

ROWS = 281
"""Positions along a side of the workpiece, one each 5 mm of 1400 mm: of a wave of 100 mm the range is found to 1 %."""

NEAR = 0.01
"""Part of a step of positions within which two are one: the slope between them would be rounding."""

PHASES = 8
"""Places of the positioning error's wave that are tried: the worst of them is within 8 % of the worst of all."""

SAMPLES = 16
"""Points of its wave: straight lines between them leave 2 %."""

AROUND = 1e-3
"""Way of the vertical axis, either side, over which its wave is laid out, m: corrections are a part of that."""


SHORTEST = 1e-7
"""Shortest wave of a positioning error, m: the finest scales have signal periods of some tenths of a micrometre."""


@dataclass(frozen=True)
class VerticalErrors:
    """What the vertical axis does by itself.

    Attributes:
        reversal: reversal errors that are tried, m.
        positioning: range of its positioning error, m.
        period: of the wave of that, m.
    """

    reversal: tuple[float, ...]
    positioning: float
    period: float


@dataclass(frozen=True)
class FlatnessPrediction:
    """Surfaces over two feed axes.

    Attributes:
        feeds: letters of the feed axes; passes go along the first.
        vertical: that of the axis that compensates.
        curves: straightness of the feeds over the workpiece, positive where the surface becomes higher.
        errors: of the vertical axis.
        comparisons: one for each reversal error, each surface the worst by where the positioning error's wave lies.
    """

    feeds: tuple[str, str]
    vertical: str
    curves: tuple[WorkpieceCurve, WorkpieceCurve]
    errors: VerticalErrors
    comparisons: tuple[GrindingComparison, ...]

    @property
    def trajectory(self) -> Array:
        """(n, m) what the vertical axis adds over the workpiece, m (Zhou et al. 2023, Figure 15)."""
        return predict_corrections(*self.curves)

    @property
    def break_even(self) -> float | None:
        """Reversal error above which the rotated curves leave less, m, by straight lines between those that were tried;
        None if they do not cross.
        """
        gain = np.array([each.unrotated.flatness - each.rotated.flatness for each in self.comparisons])
        crossing = np.flatnonzero((gain[:-1] <= 0) & (gain[1:] > 0))
        if not crossing.size:
            return None
        at = int(crossing[-1])
        low, high = self.errors.reversal[at : at + 2]
        return float(low - gain[at] * (high - low) / (gain[at + 1] - gain[at]))


def predict_flatness(
    machine: MachineDescription, vertical: str, workpiece: Workpiece, errors: VerticalErrors
) -> FlatnessPrediction:
    """Flatness of a workpiece ground over the two axes of `workpiece` (low and high position, m).

    Passes go along the first of them. The machine's straightness in the direction of the `vertical` axis goes into the
    surface; its slope does not count. Reversal errors ascend.

    Raises:
        InputError: other than two linear feed axes, the vertical one among them, or a workpiece beyond their travel,
            beyond what was measured of it, or over hardly any of it.
    """
    if len(workpiece) != 2 or vertical in workpiece:
        raise InputError(f"workpiece over {', '.join(workpiece)}; expected two axes other than {vertical}")
    _check_workpiece(machine, workpiece)
    if errors.period < SHORTEST:
        raise InputError(
            f"positioning error in waves of {errors.period * 1e6:g} µm; expected {SHORTEST * 1e6:g} µm or more, as the "
            "signal periods of scales are"
        )
    up = int(np.argmax(np.abs(machine.axis(vertical).direction)))
    first, second = (
        _curve(machine, machine.axis(letter), up, np.linspace(*limits, ROWS)) for letter, limits in workpiece.items()
    )
    letters = tuple(workpiece)
    comparisons = tuple(_worst(first, second, reversal, errors) for reversal in errors.reversal)
    return FlatnessPrediction((letters[0], letters[1]), vertical, (first, second), errors, comparisons)


def _check_workpiece(machine: MachineDescription, workpiece: Workpiece) -> None:
    """Refuse sides that are not within the travel of a linear axis, and such as were meant in another unit.

    Raises:
        InputError: the workpiece cannot be there.
    """
    parts = []
    for letter, (low, high) in workpiece.items():
        axis = machine.axis(letter)
        if axis.kind != "linear":
            raise InputError(f"workpiece: {letter} is a rotary axis; expected two linear ones, which feed")
        lowest, highest = axis.travel
        side = f"workpiece {letter} {low * 1e3:g} to {high * 1e3:g} mm"
        if low >= high:
            raise InputError(f"{side}: expected the lower end first")
        if low < lowest or high > highest:
            raise InputError(f"{side} is not within the travel of {letter}, {lowest * 1e3:g} to {highest * 1e3:g} mm")
        parts.append((high - low) / (highest - lowest))
    if max(parts) < LEAST_OF_TRAVEL:
        raise InputError(
            f"the workpiece covers {max(parts):.2%} of the travel of {' and '.join(workpiece)} at most: are its limits "
            "in mm?"
        )


def _curve(machine: MachineDescription, axis: Axis, up: int, at: Array) -> WorkpieceCurve:
    """Straightness of a feed axis at the wheel, positions (n,) m, cut from the curve of its whole guideway."""
    number = machine.letters.index(axis.letter)
    component = machine.errors.get(f"E{'XYZ'[up]}{axis.letter}")
    nodes = np.linspace(*axis.travel, ROWS)
    if component is not None and component.table is not None:
        nodes = _among(np.array(component.table.positions), nodes)
    positions = np.zeros((len(machine.axes), nodes.size))
    positions[number] = nodes
    # angular errors lift the surface too, by the lever of the wheel
    lifted = arrange_components(machine).at(positions, None, None)[up, number]
    lifted = lifted + known_readings(machine, axis.letter, {f"E{'XYZ'[up]}{axis.letter}": 1.0}, nodes)
    stated = _side(machine, axis.letter) * lifted
    level = estimate_straightness(nodes, stated).deviations
    return cut_workpiece(nodes, level, rotate_as_stated(nodes, stated), at)


def _among(measured: Array, nodes: Array) -> Array:
    """Positions of a table, which hold its steepest steps, and the nodes between them, none as near as rounding.

    Runs hardly ever begin at the very end of the travel: a table that ends short of it by up to one of its steps counts
    to the end, its last value as in the machine's model.
    """
    near = NEAR * (nodes[1] - nodes[0])
    steps = np.diff(measured)
    reached = [
        end
        for end, short, step in zip(nodes[[0, -1]], _short_of(measured, nodes), steps[[0, -1]], strict=True)
        if 0 < short <= step
    ]
    apart = np.abs(measured[:, None] - np.array(reached)).min(axis=1, initial=np.inf)
    kept = np.union1d(measured[apart > near], reached)
    within = nodes[(nodes > kept[0]) & (nodes < kept[-1])]
    distance = np.abs(within[:, None] - kept).min(axis=1)
    return np.union1d(kept, within[distance > near])


def _short_of(measured: Array, nodes: Array) -> Array:
    """(2,) by how much a table ends short of the first and the last node, m; negative where it goes beyond."""
    return np.array([measured[0] - nodes[0], nodes[-1] - measured[-1]])


def _side(machine: MachineDescription, letter: str) -> float:
    """1 for an axis that carries the tool, whose errors lift the surface; -1 for one that carries the workpiece."""
    tool, _ = branches(machine)
    return 1.0 if any(body.axis == letter for body in tool) else -1.0


def _worst(
    first: WorkpieceCurve, second: WorkpieceCurve, reversal: float, errors: VerticalErrors
) -> GrindingComparison:
    found = ground_by_phase(first, second, reversal, errors)

    def flatness(surface: GroundSurface) -> float:
        return surface.flatness

    return GrindingComparison(
        before=found[0].before,
        unrotated=max((each.unrotated for each in found), key=flatness),
        rotated=max((each.rotated for each in found), key=flatness),
    )


def ground_by_phase(
    first: WorkpieceCurve, second: WorkpieceCurve, reversal: float, errors: VerticalErrors
) -> list[GrindingComparison]:
    """Surfaces by where the wave of the positioning error lies, each place as probable as the others."""
    reach = np.linspace(-AROUND, AROUND, math.ceil(2 * AROUND / min(errors.period, AROUND) * SAMPLES) + 1)
    return [
        compare_compensation(
            first,
            second,
            VerticalAxis(
                reversal,
                reach,
                errors.positioning / 2 * np.sin(2 * math.pi * (reach / errors.period + phase / PHASES)),
            ),
        )
        for phase in range(PHASES if errors.positioning > 0 else 1)
    ]


def trajectory_csv(prediction: FlatnessPrediction, step: float) -> str:
    """Over the workpiece, each `step` m or a little less: what straightness adds to the height and the wheel to it.

    In mm and µm.

    Raises:
        InputError: more rows than a table may have.
    """
    axes = []
    for curve in prediction.curves:
        low, high = float(curve.positions[0]), float(curve.positions[-1])
        axes.append(np.linspace(low, high, max(2, math.ceil((high - low) / step * (1 - 1e-9)) + 1)))
    if axes[0].size * axes[1].size > MOST_LINES:
        raise InputError(
            f"a trajectory of {axes[0].size * axes[1].size} points, {step * 1e3:g} mm apart; expected {MOST_LINES} at "
            "most: give a longer step"
        )
    first, second = prediction.curves
    matrices = [
        predict_error_matrix(
            *(np.interp(at, c.positions, v) for at, c, v in zip(axes, (first, second), pair, strict=True))
        )
        for pair in ((first.errors, second.errors), (first.rotated, second.rotated))
    ]
    lines = [f"{prediction.feeds[0]}_mm,{prediction.feeds[1]}_mm,error_um,{prediction.vertical}_correction_um"]
    for i, x in enumerate(axes[0] * 1e3):
        lines += [
            f"{x:.9g},{z:.9g},{matrices[0][i, k] * 1e6:.4f},{-matrices[1][i, k] * 1e6:.4f}"
            for k, z in enumerate(axes[1] * 1e3)
        ]
    return "\n".join(lines) + "\n"


def flatness_text(prediction: FlatnessPrediction) -> str:
    """Flatness in µm before compensation, and after it over the reversal errors."""
    first = prediction.comparisons[0]
    errors = prediction.errors
    before = first.before.flatness * 1e6
    lines = [
        f"flatness over the workpiece before compensation {before:.3f} µm; after it, at worst by where",
        f"the positioning error of {errors.positioning * 1e6:g} µm lies (waves of {errors.period * 1e6:g} µm):",
        f"reversal error of {prediction.vertical}, µm   curves as measured, µm   rotated to be monotone, µm",
    ]
    for reversal, each in zip(errors.reversal, prediction.comparisons, strict=True):
        lines.append(
            f"{reversal * 1e6:22.3f} {each.unrotated.flatness * 1e6:24.3f} {each.rotated.flatness * 1e6:27.3f}"
        )
    counts = f"{first.unrotated.reversals:13d} {first.rotated.reversals:27d}"
    lines.append(f"reversals of {prediction.vertical} while grinding {counts}")
    if prediction.break_even is not None:
        lines.append(f"the rotated curves leave less above a reversal error of {prediction.break_even * 1e6:.2f} µm")
    for letter, curve in zip(prediction.feeds, prediction.curves, strict=True):
        rotation = curve.rotation
        lines.append(
            f"{letter}: the whole curve is rotated by {rotation.angle * 1e6:+.2f} µrad and "
            f"{'rises' if rotation.rising else 'falls'}"
        )
    return "\n".join(lines)
