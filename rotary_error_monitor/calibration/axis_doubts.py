"""Whether the lines that a tracker saw can be those of the machine's axes, and tell more than was known before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.metrology.axis_fits import LineFit

LEAST_OF_TRAVEL = 0.02
"""Part of an axis' travel that its points span at least: metres taken for mm span a thousandth."""

BEYOND_TRAVEL = 0.02
"""Part of an axis' travel by which its points may span more: limits of a controller are set a little inside."""

LESS_SURE = 2.0
"""Times the uncertainty that the file has: as many readings with the same tracker do not get that much worse."""

USELESS = 5e-5
"""Standard uncertainty of an angle, rad, that is of no use for one that is smaller in the file: 0.02 mm over 400 mm,
more than acceptance tests let a squareness be off."""


def left_handed(machine: MachineDescription, lines: Mapping[str, LineFit]) -> tuple[str, ...]:
    """Three linear axes whose directions have another sense than those of the file, in words."""
    linear = [axis for axis in machine.axes if axis.kind == "linear" and axis.letter in lines]
    if len(linear) != 3:
        return ()
    nominal = np.linalg.det(np.array([axis.direction for axis in linear]))
    seen = np.linalg.det(np.array([lines[axis.letter].direction for axis in linear]))
    if nominal * seen > 0:
        return ()
    letters, hands = ", ".join(axis.letter for axis in linear), ("left", "right")
    return (
        f"axes {letters} as measured form a {hands[int(seen > 0)]}-handed machine, in the file a "
        f"{hands[int(nominal > 0)]}-handed one: are two features exchanged, does one run against its axis (its first "
        "reading at the positive end), or does an angle of the tracker count the other way?",
    )


def implausible_lengths(
    machine: MachineDescription, tracks: Mapping[str, Sequence[tuple[Array, Array]]]
) -> tuple[str, ...]:
    """Linear axes whose points (n, 3) m, each with covariances, span far less than their travel, or more, in words."""
    misfits = []
    for letter, found in tracks.items():
        axis = machine.axis(letter)
        if axis.kind != "linear":
            continue
        travel = axis.travel[1] - axis.travel[0]
        length = max(float(np.linalg.norm(points - points[0], axis=1).max()) for points, _ in found)
        if not LEAST_OF_TRAVEL <= length / travel <= 1 + BEYOND_TRAVEL:
            misfits.append(
                f"the points of {letter} span {length * 1e3:.4g} mm, and its travel is {travel * 1e3:g} mm: another "
                "axis, or a distance in another unit?"
            )
    return tuple(misfits)


def less_sure(file: MachineFile, parts: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """Parts that the file has better than they are measured now, in words.

    `parts` has by name under `calibration` the largest angle in the file and its new uncertainty, rad.
    """
    misfits = []
    for name, (angle, own) in parts.items():
        known = file.noted_uncertainty(name)
        if known is not None and own > LESS_SURE * known:
            misfits.append(
                f"{name}: a standard uncertainty of {own * 1e6:.2f} µrad, where the file has one of {known * 1e6:.2f}"
            )
        elif known is None and own > max(angle, USELESS):
            misfits.append(
                f"{name}: a standard uncertainty of {own * 1e6:.2f} µrad, where the angles of the file are "
                f"{angle * 1e6:.2f} µrad at most, tells nothing"
            )
    return tuple(misfits)
