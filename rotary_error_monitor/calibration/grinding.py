"""Flatness that a machine's straightness leaves on a workpiece, and what compensation by a third axis makes of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.components import arrange_components
from rotary_error_monitor.metrology.guideway_compensation import GrindingComparison, VerticalAxis, compare_compensation
from rotary_error_monitor.metrology.straightness import estimate_straightness

Array = NDArray[np.float64]

ROWS = 281
PERIOD = 20e-6
"""Wave of the vertical axis's positioning error, m: shorter than the corrections, so that all of it shows."""


@dataclass(frozen=True)
class FlatnessPrediction:
    """Surfaces over two feed axes: positions (n,), (m,) in m, and the comparison."""

    feeds: tuple[str, str]
    first: Array
    second: Array
    comparison: GrindingComparison


def predict_flatness(
    machine: MachineDescription,
    vertical: str,
    workpiece: Mapping[str, tuple[float, float]],
    reversal_error: float,
    positioning_error: float,
) -> FlatnessPrediction:
    """Flatness of a workpiece ground over the two axes of `workpiece` (low and high position, m).

    Passes go along the first of them. The machine's straightness in the direction of the `vertical` axis goes into the
    surface; its slope does not count. The vertical axis has a reversal error and a positioning error (range, m) of
    these sizes.

    Raises:
        InputError: other than two linear feed axes, the vertical one among them, or a workpiece beyond their travel.
    """
    if len(workpiece) != 2 or vertical in workpiece:
        raise InputError(f"workpiece over {', '.join(workpiece)}; expected two axes other than {vertical}")
    up = int(np.argmax(np.abs(machine.axis(vertical).direction)))
    lines, curves = [], []
    for letter, (low, high) in workpiece.items():
        axis = machine.axis(letter)
        if axis.kind != "linear" or not axis.travel[0] <= low < high <= axis.travel[1]:
            lowest, highest = axis.travel
            raise InputError(
                f"workpiece {letter} {low:g} to {high:g} is not within {lowest:g} to {highest:g} m of travel"
            )
        line = np.linspace(low, high, ROWS)
        positions = np.zeros((len(machine.axes), ROWS))
        positions[machine.letters.index(letter)] = line
        errors = arrange_components(machine).at(positions, None, None)
        lines.append(line)
        curves.append(estimate_straightness(line, errors[up, machine.letters.index(letter)]).deviations)
    reach = np.arange(-1e-3, 1e-3, PERIOD / 16)
    axis_as_it_is = VerticalAxis(reversal_error, reach, positioning_error / 2 * np.sin(2 * math.pi * reach / PERIOD))
    comparison = compare_compensation(lines[0], curves[0], lines[1], curves[1], axis_as_it_is)
    first, second = workpiece
    return FlatnessPrediction((first, second), lines[0], lines[1], comparison)


def flatness_text(prediction: FlatnessPrediction) -> str:
    """The three surfaces in µm."""
    comparison = prediction.comparison
    rows = [
        ("before compensation", comparison.before),
        ("after, curves as measured", comparison.unrotated),
        ("after, curves rotated to be monotone", comparison.rotated),
    ]
    lines = ["flatness over the workpiece              µm   reversals of the vertical axis"]
    lines += [f"{name:36} {surface.flatness * 1e6:7.3f} {surface.reversals:10d}" for name, surface in rows]
    return "\n".join(lines)
