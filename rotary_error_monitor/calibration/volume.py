"""What the errors of a machine do in its working volume: map of the tool offset, and what each error costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.parameters import without_errors
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.machine.location_names import location_errors
from rotary_error_monitor.machine.uncertainty import drawn_machines

Limits = Mapping[str, tuple[float, float]]

_FEWEST_DRAWS = 20
"""Of fewer, the value that 95 % do not exceed would be the largest of all."""

_MOST_DRAWS = 2000
"""Of so many the value that 95 % do not exceed is the 94.5 to 95.5 % one (one standard deviation)."""

_LEAST_DRAWS = 100
"""The same: 93 to 97 %."""

_WORK = 50_000_000
"""Poses times machines that are computed where more than the least are: some seconds."""

_PART = 2048
"""Poses that are taken through all draws at once: with their offsets they stay in the processor's cache."""


@dataclass(frozen=True)
class VolumetricMap:
    """Tool offset over a grid of two axes, the others held.

    Attributes:
        axes: letters of the two axes.
        rotary: whether each turns.
        first, second: (n,), (m,) their positions, m or rad.
        position_error: (n, m) length of the offset's shift, m.
        orientation_error: (n, m) angle of its rotation, rad.
    """

    axes: tuple[str, str]
    rotary: tuple[bool, bool]
    first: Array
    second: Array
    position_error: Array
    orientation_error: Array


@dataclass(frozen=True)
class UncertainOffsets:
    """Tool offset at n poses, and how uncertain the machine's description leaves it.

    Attributes:
        offset: (n, 6) of the machine as described, m and rad.
        deviation: (n, 6) standard uncertainty of each component, m and rad.
        position_bound: (n,) length of the offset's shift that 95 % of the machines drawn do not exceed, m.
        largest_bound: the same of the largest at any of the poses, m: no less than the largest of `position_bound`, for
            machines that are at their worst elsewhere count as well.
    """

    offset: Array
    deviation: Array
    position_bound: Array
    largest_bound: float


@dataclass(frozen=True)
class ErrorCost:
    """What one error does to the tool if it were alone, over the working volume.

    Attributes:
        name: such as EXX, ECC, squareness X-Y (EC0X), reversal of an axis.
        position_rms, position_largest: length of the tool's shift, m.
        orientation_rms: angle, rad.
    """

    name: str
    position_rms: float
    position_largest: float
    orientation_rms: float


def sample_volume(machine: MachineDescription, count: int, limits: Limits | None = None) -> Array:
    """(count, axes) poses that fill the working volume evenly (a Halton sequence), the same at every call.

    `limits` narrows the travel of axes by letter, m or rad.

    Raises:
        InputError: limits of an axis that the machine has not, or beyond its travel.
    """
    from scipy.stats import qmc  # loads for a second or two

    low, high = _bounds(machine, limits)
    points = qmc.Halton(len(machine.axes), scramble=False).random(count)
    return np.asarray(low + points * (high - low), dtype=np.float64)


def volumetric_difference(one: MachineDescription, other: MachineDescription, limits: Limits | None = None) -> float:
    """By how much two descriptions of a machine place the tool apart, root mean square over the working volume, m."""
    poses = sample_volume(one, 200, limits)
    apart = predict_tool_offset(arrange_machine(one), poses) - predict_tool_offset(arrange_machine(other), poses)
    return float(np.sqrt(np.mean(np.square(apart[:, :3]).sum(axis=1))))


def estimate_volumetric_map(machine: MachineDescription, axes: tuple[str, str], *, count: int = 41) -> VolumetricMap:
    """Tool offset over two axes' whole travel, the other axes held in the middle of theirs.

    Raises:
        InputError: the machine lacks one of the axes.
    """
    numbers = [machine.letters.index(machine.axis(letter).letter) for letter in axes]
    lines = [np.linspace(*machine.axis(letter).travel, count) for letter in axes]
    pose = np.array([0.5 * sum(axis.travel) for axis in machine.axes])
    poses = np.tile(pose, (count * count, 1))
    poses[:, numbers[0]], poses[:, numbers[1]] = (grid.ravel() for grid in np.meshgrid(*lines, indexing="ij"))
    offset = predict_tool_offset(arrange_machine(machine), poses)
    shape = (count, count)
    first, second = (machine.axis(letter).kind == "rotary" for letter in axes)
    return VolumetricMap(
        axes,
        (first, second),
        lines[0],
        lines[1],
        np.linalg.norm(offset[:, :3], axis=1).reshape(shape),
        np.linalg.norm(offset[:, 3:], axis=1).reshape(shape),
    )


def estimate_uncertain_offsets(
    machine: MachineDescription, poses: Array, *, draws: int = 100, seed: int = 1, direction: Array | None = None
) -> UncertainOffsets:
    """Tool offset at (n, axes) poses with its uncertainty, by Monte Carlo over the uncertain numbers of the machine.

    Of `draws` machines a standard uncertainty is known to 1 / sqrt(2 draws) of it (JCGM 100:2008, Equation E.7).

    Args:
        machine: with the standard uncertainties of its numbers.
        poses: m or rad.
        draws: machines drawn, at least 20: of fewer, none may lie beyond the 95 %.
        seed: of the draws.
        direction: (n, axes) sign of the travel by which each pose was reached; none: unknown.

    Raises:
        InputError: the machine states no uncertainty, too few draws, or poses that do not fit the machine.
    """
    if draws < _FEWEST_DRAWS:
        raise InputError(f"{draws} draws; expected at least {_FEWEST_DRAWS}")
    described = arrange_machine(machine)
    models = [arrange_machine(drawn) for drawn in drawn_machines(machine, draws, seed)]
    offset, rank = predict_tool_offset(described, poses, direction=direction), _bound_rank(draws)
    deviation, bound, largest = np.empty_like(offset), np.empty(len(offset)), np.zeros(draws)
    for first in range(0, len(offset), _PART):
        part = slice(first, first + _PART)
        to = None if direction is None else direction[part]
        ideal = stand(described, np.ascontiguousarray(poses[part].T), None).tool_in_workpiece()  # of all that are drawn
        squares, lengths = np.zeros_like(offset[part]), np.empty((draws, len(offset[part])))
        for model, length in zip(models, lengths, strict=True):
            drawn = predict_tool_offset(model, poses[part], direction=to, ideal=ideal)
            length[:] = drawn[:, 0] ** 2 + drawn[:, 1] ** 2 + drawn[:, 2] ** 2
            drawn -= offset[part]
            drawn *= drawn
            squares += drawn
        deviation[part] = np.sqrt(squares / draws)
        bound[part] = np.sqrt(np.partition(lengths, rank, axis=0)[rank])
        np.maximum(largest, lengths.max(axis=1), out=largest)
    return UncertainOffsets(offset, deviation, bound, float(np.sqrt(np.sort(largest)[rank])))


def draws_for(poses: int) -> int:
    """How many machines are drawn for so many poses: as many as some seconds allow."""
    return min(_MOST_DRAWS, max(_LEAST_DRAWS, _WORK // poses))


def rank_errors(
    machine: MachineDescription, *, count: int = 500, limits: Limits | None = None
) -> tuple[ErrorCost, ...]:
    """Each error alone on the otherwise ideal machine, most costly first; errors of all kinds that the machine has.

    Raises:
        InputError: limits that do not fit the machine.
    """
    poses = sample_volume(machine, count, limits)
    # Reversal needs a direction: half of the poses are reached from each side.
    direction = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)[:, None] * np.ones(len(machine.axes))
    found = []
    for name, alone in _each_error(machine):
        offset = predict_tool_offset(arrange_machine(alone), poses, direction=direction)
        shift, turn = np.linalg.norm(offset[:, :3], axis=1), np.linalg.norm(offset[:, 3:], axis=1)
        found.append(
            ErrorCost(name, float(np.sqrt(np.mean(shift**2))), float(shift.max()), float(np.sqrt(np.mean(turn**2))))
        )
    return tuple(sorted(found, key=lambda cost: -cost.position_rms))


def _bound_rank(draws: int) -> int:
    """Place, from 0, of the smallest of so many sorted values that 95 % of them do not exceed (JCGM 101:2008, 7.7)."""
    return math.ceil(0.95 * draws) - 1


def _each_error(machine: MachineDescription) -> list[tuple[str, MachineDescription]]:
    ideal = without_errors(machine)
    alone = [(name, replace(ideal, errors={name: component})) for name, component in machine.errors.items()]
    for error in location_errors(machine):
        alone.append((error.name, ideal.with_location_error(error.body, error.displacement)))
    for axis in machine.axes:
        if axis.reversal:
            alone.append((f"reversal of {axis.letter}", ideal.with_axis(axis.letter, reversal=axis.reversal)))
    return alone


def _bounds(machine: MachineDescription, limits: Limits | None) -> tuple[Array, Array]:
    bounds = {axis.letter: axis.travel for axis in machine.axes}
    for letter, (low, high) in (limits or {}).items():
        lowest, highest = machine.axis(letter).travel
        if not lowest <= low < high <= highest:
            raise InputError(
                f"working volume {letter} {low:g} to {high:g} is not within its travel {lowest:g} to {highest:g}"
            )
        bounds[letter] = (low, high)
    table = np.array([bounds[letter] for letter in machine.letters])
    return table[:, 0], table[:, 1]
