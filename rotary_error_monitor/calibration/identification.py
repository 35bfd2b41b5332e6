"""Identification of a whole machine: all its parameters from poses and measured tool deviations at once.

The tool offset is linear in the parameters but for products of errors (10 µrad times 10 µrad): with the derivatives at
the start, each round of least squares on the exact model leaves a hundred-thousandth of the error before it.

What a set of poses cannot see is told rather than guessed. Columns are scaled to errors of a typical size; a
combination of parameters of that size that moves all readings together by less than their noise counts as unseen and is
left where it was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.calibration.parameters import MachineParameter, apply_parameters, value_of
from rotary_error_monitor.calibration.pose_outliers import OutlyingPose, find_outlying_poses
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.metrology.distributions import chi_square_limit, chi_square_up_to

TYPICAL_SIZE = {"m": 10e-6, "rad": 10e-6, "1/K": 10e-6}
"""Errors of an uncalibrated machine tool; the scale of what counts as seen."""

STEP = 1e-6
"""Step of the difference quotients: far above rounding, far below where products of errors matter."""

ROUNDS = 3

UNSEEN_SHARE = 0.01
"""A parameter counts as determined if unseen combinations hold at most this share of it (its squared weight)."""

LEAST_WEIGHT = 0.1
"""Parameters with less weight are not named in an unseen combination."""

_HELD = 5
"""Each pose of so many is held out of the check: the rest determines the parameters almost as well as all."""

_FURTHER = 5
"""Poses that are proposed: probed within minutes."""

HELD_OUT_RISK = 0.01
"""Probability with which a right model fails the held-out check."""


@dataclass(frozen=True)
class ProbedPoses:
    """Static poses and the tool's deviation at each.

    Attributes:
        positions: (n, axes) commanded, m or rad, in the order of the machine's axes.
        direction: (n, axes) sign of travel, 0 if unknown.
        temperature: (n,) °C.
        deviations: (n, 3) tool tip as it is minus as it should be, in the workpiece's frame, m.
        noise: standard deviation of a deviation's component, m.
        remarks: what was not believed of them.
        lines: (n,) line of each in its file; None of a bag.
    """

    positions: Array
    direction: Array
    temperature: Array
    deviations: Array
    noise: float
    remarks: tuple[str, ...] = ()
    lines: NDArray[np.int64] | None = None

    def chosen(self, rows: NDArray[np.bool_]) -> ProbedPoses:
        """Some of the poses."""
        return replace(
            self,
            positions=self.positions[rows],
            direction=self.direction[rows],
            temperature=self.temperature[rows],
            deviations=self.deviations[rows],
            lines=None if self.lines is None else self.lines[rows],
        )

    def name(self, number: int) -> str:
        """What a pose, from 0, is called in words: its number from 1 and where it stands in its file."""
        return f"pose {number + 1}" + ("" if self.lines is None else f" (line {self.lines[number]})")


@dataclass(frozen=True)
class UnseenCombination:
    """A combination of parameters that the poses cannot tell from zero.

    Attributes:
        weights: (name, change) of the parameters that change together, largest first, in units of their typical size.
    """

    weights: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        return " ".join(f"{weight:+.2f} {name}" for name, weight in self.weights)


@dataclass(frozen=True)
class Identification:
    """A machine identified from poses.

    Attributes:
        machine: the description with the parameters found.
        parameters, values: name and value of each, in m, rad, 1/K.
        covariance: (p, p) of the values, within what the poses see.
        determined: (p,) True where the poses determine the parameter.
        hidden: (k, p) orthonormal combinations, in typical sizes, that these poses cannot see; `unseen` tells the same
            in the fewest parameters.
        rank: how many combinations they see.
        condition: largest over smallest singular value among those.
        residual_ratio: root mean square of the residuals over the noise, freedom counted.
        too_small: p-value of residuals as small, if the noise is as stated.
        outlying: poses that stand off from what the others let expect, worst first.
    """

    machine: MachineDescription
    parameters: tuple[MachineParameter, ...]
    values: Array
    covariance: Array
    determined: NDArray[np.bool_]
    hidden: Array
    unseen: tuple[UnseenCombination, ...]
    rank: int
    condition: float
    residual_ratio: float
    too_small: float
    outlying: tuple[OutlyingPose, ...] = ()

    @property
    def standard_uncertainty(self) -> Array:
        """(p,) standard uncertainty of each value; infinite where it is not determined."""
        known: Array = np.sqrt(np.diag(self.covariance))
        return np.where(self.determined, known, np.inf)


@dataclass(frozen=True)
class HeldOutCheck:
    """How well a model predicts poses that it was not fitted to.

    Attributes:
        count: poses held out.
        error: root mean square of a component of the prediction error, m.
        ratio: the error over what noise and the parameters' uncertainty explain; 1 for a right model.
        limit: ratio that a right model exceeds with a probability of 1 %.
    """

    count: int
    error: float
    ratio: float
    limit: float


def identify_machine(
    start: MachineDescription, parameters: Sequence[MachineParameter], poses: ProbedPoses
) -> Identification:
    """All parameters by least squares, beginning at the description `start`.

    Raises:
        InputError: no pose or no parameter, shapes that do not fit the machine, a number that is not finite, or a noise
            that is not positive.
    """
    _check(parameters, poses)
    machine = start
    scales = parameter_scales(parameters)
    jacobian = estimate_jacobian(start, parameters, poses) * scales / poses.noise
    left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    rank = int(np.count_nonzero(singular >= 1.0))
    for _ in range(ROUNDS):
        step = right[:rank].T @ ((left[:, :rank].T @ (_residual(machine, poses) / poses.noise)) / singular[:rank])
        machine = apply_parameters(machine, parameters, step * scales)
    residual = _residual(machine, poses) / poses.noise
    square, freedom = float(residual @ residual), max(1, residual.size - rank)
    seen = right[:rank].T / singular[:rank]
    hidden = _complement(right[:rank])
    return Identification(
        machine=machine,
        parameters=tuple(parameters),
        values=np.array([value_of(machine, parameter) for parameter in parameters]),
        covariance=(seen @ seen.T) * np.outer(scales, scales),
        determined=(hidden**2).sum(axis=0) <= UNSEEN_SHARE,
        hidden=hidden,
        unseen=_combinations(hidden, parameters),
        rank=rank,
        condition=float(singular[0] / singular[rank - 1]) if rank else math.inf,
        residual_ratio=math.sqrt(square / freedom),
        too_small=chi_square_up_to(square, freedom),
        outlying=find_outlying_poses(left[:, :rank].reshape(-1, 3, rank), residual.reshape(-1, 3)),
    )


def drop_outlying(
    start: MachineDescription, parameters: Sequence[MachineParameter], poses: ProbedPoses, found: Identification
) -> tuple[Identification, NDArray[np.bool_], tuple[OutlyingPose, ...]]:
    """Leave out poses that stand off, the worst first and each beside all that are left: one pulls the fit at others.

    Gives the machine without them, (n,) which poses it is from, and those that were left out. `found` is of all poses.

    Raises:
        InputError: what `identify_machine` raises.
    """
    kept, dropped = np.ones(len(poses.positions), dtype=np.bool_), list[OutlyingPose]()
    while found.outlying and kept.sum() > _HELD:
        worst = found.outlying[0]
        dropped.append(replace(worst, number=int(np.flatnonzero(kept)[worst.number])))
        kept[dropped[-1].number] = False
        found = identify_machine(start, parameters, poses.chosen(kept))
    return found, kept, tuple(dropped)


def estimate_jacobian(machine: MachineDescription, parameters: Sequence[MachineParameter], poses: ProbedPoses) -> Array:
    """(3n, p) derivative of the tool offset (x y z) by each parameter."""
    base = _predict(machine, poses)
    columns = [(_predict(p.added(machine, STEP), poses) - base) / STEP for p in parameters]
    return np.stack(columns, axis=1)


def check_held_out(
    start: MachineDescription, parameters: Sequence[MachineParameter], poses: ProbedPoses
) -> HeldOutCheck:
    """Fit to all poses but each fifth one, and predict those.

    Raises:
        InputError: fewer than five poses, or what `identify_machine` raises.
    """
    if len(poses.positions) < _HELD:
        raise InputError(f"{len(poses.positions)} poses; the held-out check needs at least {_HELD}")
    held = np.arange(len(poses.positions)) % _HELD == _HELD - 1
    fitted = identify_machine(start, parameters, poses.chosen(~held))
    rest = poses.chosen(held)
    residual = _residual(fitted.machine, rest)
    jacobian = estimate_jacobian(fitted.machine, parameters, rest)
    variance = poses.noise**2 * np.eye(residual.size) + jacobian @ fitted.covariance @ jacobian.T
    square = float(residual @ np.linalg.solve(variance, residual))
    return HeldOutCheck(
        count=len(rest.positions),
        error=math.sqrt(float(residual @ residual) / residual.size),
        ratio=math.sqrt(square / residual.size),
        limit=math.sqrt(chi_square_limit(HELD_OUT_RISK, residual.size) / residual.size),
    )


def choose_further_poses(identification: Identification, candidates: Array, poses: ProbedPoses) -> NDArray[np.int64]:
    """Indices of the five candidate poses (m, axes) that would tell most about what is unseen or uncertain.

    Each pose is the one that gains most information (log determinant, the typical size being each parameter's prior)
    after those chosen before it. Candidates count as reached in positive direction at the mean temperature.
    """
    parameters, machine = identification.parameters, identification.machine
    scales = parameter_scales(parameters) / poses.noise
    planned = ProbedPoses(
        candidates,
        np.ones_like(candidates),
        np.full(len(candidates), float(poses.temperature.mean())),
        np.zeros((len(candidates), 3)),
        poses.noise,
    )
    done = estimate_jacobian(machine, parameters, poses) * scales
    rows = (estimate_jacobian(machine, parameters, planned) * scales).reshape(len(candidates), 3, -1)
    covariance = np.linalg.inv(np.eye(len(parameters)) + done.T @ done)
    chosen: list[int] = []
    for _ in range(min(_FURTHER, len(candidates))):
        gain = np.linalg.slogdet(np.eye(3) + rows @ covariance @ np.swapaxes(rows, 1, 2))[1]
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        across = covariance @ rows[best].T
        covariance = covariance - across @ np.linalg.solve(np.eye(3) + rows[best] @ across, across.T)
    return np.array(chosen, dtype=np.int64)


def rank_with_longer_tool(identification: Identification, poses: ProbedPoses) -> int:
    """Combinations seen if the same poses are probed a second time with a tool longer by 0.1 m.

    A tip alone cannot tell a tilt of the head from a shift of it; two tool lengths can.
    """
    parameters, machine = identification.parameters, identification.machine
    body = machine.body(machine.tool)
    size = math.hypot(*body.pose.shift)
    along = [c / size for c in body.pose.shift] if size else [0.0, 0.0, -1.0]
    x, y, z = (old + 0.1 * c for old, c in zip(body.pose.shift, along, strict=True))
    longer = replace(body, pose=replace(body.pose, shift=(x, y, z)))
    other = replace(machine, bodies=tuple(longer if old is body else old for old in machine.bodies))
    scales = parameter_scales(parameters) / poses.noise
    both = np.concatenate([estimate_jacobian(m, parameters, poses) * scales for m in (machine, other)])
    return int(np.count_nonzero(np.linalg.svd(both, compute_uv=False) >= 1.0))


def parameter_scales(parameters: Sequence[MachineParameter]) -> Array:
    """(p,) typical size of each parameter, in its unit."""
    return np.array([TYPICAL_SIZE[parameter.unit] for parameter in parameters])


def _check(parameters: Sequence[MachineParameter], poses: ProbedPoses) -> None:
    if not parameters:
        raise InputError("no parameter to identify")
    if not poses.noise > 0:
        raise InputError(f"noise {poses.noise:g} m of the tool probe; it must be above 0, such as 1.5e-6")
    if len(poses.positions) == 0 or poses.deviations.shape != (len(poses.positions), 3):
        raise InputError(f"{len(poses.positions)} poses and deviations of shape {poses.deviations.shape} do not fit")
    if not np.all(np.isfinite(poses.deviations)):
        at = int(np.argmin(np.isfinite(poses.deviations).all(axis=1)))
        raise InputError(f"the tool deviation of pose {at + 1} is not finite; drop that pose")


def _predict(machine: MachineDescription, poses: ProbedPoses) -> Array:
    offset = predict_tool_offset(
        arrange_machine(machine), poses.positions, direction=poses.direction, temperature=poses.temperature
    )
    return offset[:, :3].ravel()


def _residual(machine: MachineDescription, poses: ProbedPoses) -> Array:
    return poses.deviations.ravel() - _predict(machine, poses)


def _complement(rows: Array) -> Array:
    """Orthonormal rows that span what orthonormal `rows` leave."""
    _, _, everything = np.linalg.svd(rows, full_matrices=True)
    return np.asarray(everything[len(rows) :], dtype=np.float64)


def _combinations(hidden: Array, parameters: Sequence[MachineParameter]) -> tuple[UnseenCombination, ...]:
    """The space of the hidden rows by a basis of few parameters each: every row owns one parameter with weight 1."""
    if not len(hidden):
        return ()
    _, _, order = qr(hidden, mode="economic", pivoting=True)
    rows = np.linalg.solve(hidden[:, order[: len(hidden)]], hidden)
    found = []
    for row in rows:
        largest = [k for k in np.argsort(-np.abs(row), kind="stable") if abs(row[k]) >= LEAST_WEIGHT]
        found.append(UnseenCombination(tuple((parameters[k].name, float(row[k])) for k in largest)))
    return tuple(found)
