"""Read heads of a stage that turns both ways: unit, sign, zero, delay and place of each, and the ring between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.commissioning.response_fit import STRAIGHT, FittedCoefficients, basis, fit_response
from rotary_error_monitor.commissioning.streams import RawStream
from rotary_error_monitor.commissioning.units import (
    AngleUnit,
    angle_units,
    common_units,
    compare_speeds,
    unwrapped,
)
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.rotation_fit import highest_order
from rotary_error_monitor.metrology.shaft_recording import ShaftRecording, record_shaft
from rotary_error_monitor.units import TURN

HIGHEST = 16
"""Orders of ring and rotor that are fitted: error motion of bearings is of lower ones, and what is not is noise."""

ROUNDS = 3
"""Rounds in which delays settle: what they do while the speed changes is of their square."""

SLOW = 0.2
"""Part of the usual speed below which a stage counts as standing."""

UNIT_PRIOR = 0.05
"""Prior probability that the heads, which agree with one another, all tell another unit than radians."""


INDEPENDENT = 12
"""Values that a turn each way tells of the low orders, whatever the unit: what is left beside them follows so slowly
that more samples tell nothing more."""


@dataclass(frozen=True)
class HeadAngles:
    """Streams of angles, each in radians and counted as the first head counts.

    Attributes:
        streams: times (n,) ns and continuous angles (n, 1), by name.
        unit: of each; None where it is none that is known, and then its angle is scaled to fit the others.
        factor: reading of each per radian.
        relative: 1 or -1, how each counts beside the first head.
    """

    streams: Mapping[str, tuple[NDArray[np.int64], Array]]
    unit: Mapping[str, AngleUnit | None]
    factor: Mapping[str, float]
    relative: Mapping[str, int]


def angles_of(stage: StageDescription, streams: Mapping[str, RawStream]) -> HeadAngles:
    """Angles of heads, first, and command by their raw streams.

    Raises:
        InputError: the stage stands still, moves too little, or one way only; a stream does not follow the others.
    """
    angles = in_radians(stage, streams)
    _check_motion(motion_of(*next(iter(angles.streams.values()))))
    return angles


def in_radians(stage: StageDescription, streams: Mapping[str, RawStream]) -> HeadAngles:
    """The same of a stage that moves, however far.

    Raises:
        InputError: the stage stands still, or a stream does not follow the others.
    """
    units = angle_units(stage.ring.resolution)
    carried: dict[str, tuple[NDArray[np.int64], Array]] = {}
    by_wrap: dict[str, AngleUnit] = {}
    for name, stream in streams.items():
        values, unit = unwrapped(stream.values[:, 0], units)
        carried[name] = stream.times_ns, values
        if unit is not None:
            by_wrap[name] = unit
    speeds = compare_speeds(carried)
    if len(speeds.still) >= len(streams) - 1:  # noise follows itself alone
        raise InputError("the stage stands still; record at least a turn each way, slowly")
    if speeds.still:
        raise InputError(
            f"{', '.join(speeds.still)}: does not follow the rotation that the other streams show; expected a stream "
            "that moves with the stage (is it stuck, unplugged, or of another axis?)"
        )
    names = list(streams)
    heads = [name for name in names if name.startswith("head_")]
    first = heads[0]
    ratio = [speeds.ratio[name] / speeds.ratio[first] for name in names]
    choices = common_units(ratio, units)
    if first in by_wrap:
        choices = [each for each in choices if each[0] == by_wrap[first]] or choices
    else:
        known = [(names.index(name), unit) for name, unit in by_wrap.items()]
        choices = [each for each in choices if all(each[1][i] == unit for i, unit in known)] or choices
    return _likeliest(stage, carried, names, ratio, choices)


def _likeliest(
    stage: StageDescription,
    carried: Mapping[str, tuple[NDArray[np.int64], Array]],
    names: Sequence[str],
    ratio: Sequence[float],
    choices: Sequence[tuple[AngleUnit, list[AngleUnit | None]]],
) -> HeadAngles:
    """Angles in those units in which what the heads differ in repeats with a turn of 2 pi."""
    best, highest = None, -np.inf
    for place, (unit, others) in enumerate(choices):
        found = _in_units(carried, names, ratio, unit, others)
        heads = {name: found.streams[name] for name in names if name.startswith("head_")}
        if place > 0 and np.ptp(heads[next(iter(heads))][1]) < TURN:
            continue
        score = 0.0 if len(choices) == 1 else _repeats(stage, heads)
        score += 0.0 if unit.size == 1.0 else np.log(UNIT_PRIOR)
        if score > highest:
            best, highest = found, score
    assert best is not None
    return best


def _in_units(
    carried: Mapping[str, tuple[NDArray[np.int64], Array]],
    names: Sequence[str],
    ratio: Sequence[float],
    unit: AngleUnit,
    others: Sequence[AngleUnit | None],
) -> HeadAngles:
    streams, factor = {}, {}
    for name, part, other in zip(names, ratio, others, strict=True):
        factor[name] = abs(part) * unit.size if other is None else other.size
        times, values = carried[name]
        streams[name] = times, (np.sign(part) * values / factor[name])[:, None]
    relative = {name: int(np.sign(part)) for name, part in zip(names, ratio, strict=True)}
    return HeadAngles(streams, dict(zip(names, others, strict=True)), factor, relative)


def _repeats(stage: StageDescription, heads: Mapping[str, tuple[NDArray[np.int64], Array]]) -> float:
    """Logarithm of the likelihood, by what order 1 to 3 leave of what heads differ in; its size unknown beforehand."""
    shaft = record_shaft(loose(stage), dict(_letters(heads)), None)
    theta = shaft.readings.mean(axis=1)
    values = shaft.readings @ helmert(shaft.readings.shape[1]).T
    left = _left(basis(theta, shaft.speed, 0), values)
    rest = _left(basis(theta, shaft.speed, 3), values)
    return float(INDEPENDENT * np.log(left / max(rest, 1e-12 * left)))


def _left(design: Array, values: Array) -> float:
    residual = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return float((residual**2).mean())


def loose(stage: StageDescription) -> StageDescription:
    """The stage with noise so large that no bend of the motion leaves a time out before units and delays are known."""
    assert stage.encoder is not None
    return replace(stage, encoder=replace(stage.encoder, noise=1e-3))


def _letters(heads: Mapping[str, tuple[NDArray[np.int64], Array]]) -> Mapping[str, tuple[NDArray[np.int64], Array]]:
    return {name.removeprefix("head_"): stream for name, stream in heads.items()}


@dataclass(frozen=True)
class CoveredRotation:
    """How far a stage moved: what it `covered`, and the sums of its turns `forth` and `back`, rad."""

    covered: float
    forth: float
    back: float


def motion_of(times: NDArray[np.int64], values: Array) -> CoveredRotation:
    """Motion by times (n,) ns and continuous angles (n, 1)."""
    angle = values[:, 0]
    seconds = (times - times[0]) * 1e-9
    grid = np.arange(0.0, seconds[-1], 0.05)
    course = np.interp(grid, seconds, angle)
    steps = np.diff(course)
    usual = float(np.quantile(np.abs(steps), 0.9))
    forth = float(steps[steps > SLOW * usual].sum())
    back = float(-steps[steps < -SLOW * usual].sum())
    return CoveredRotation(float(np.ptp(angle)), forth, back)


def _check_motion(motion: CoveredRotation) -> None:
    if motion.covered < TURN:
        raise InputError(
            f"the stage moves over {np.degrees(motion.covered):.1f}° only; record a whole turn (360°) or more each "
            "way, slowly"
        )
    if min(motion.forth, motion.back) < TURN:
        raise InputError(
            f"the stage turns {np.degrees(motion.forth):.0f}° one way and {np.degrees(motion.back):.0f}° the other; "
            "record at least a turn (360°) each way: one direction alone does not tell a delay from a zero"
        )


@dataclass(frozen=True)
class HeadResponse:
    """What the heads show of one another.

    Attributes:
        names: of the heads, such as `head_a`.
        shaft: readings at common times, each in radians, counted as the first, earlier by its delay.
        delays: (n,) s by which each was taken to be late.
        response: of the heads, less the mean of all, to `basis`.
        theta: (m,) rotation, rad.
    """

    names: tuple[str, ...]
    shaft: ShaftRecording
    delays: Array
    response: FittedCoefficients
    theta: Array


def head_response(stage: StageDescription, angles: HeadAngles) -> HeadResponse:
    """Responses of the heads, at times at which all of them have samples.

    Raises:
        InputError: the heads hardly overlap.
    """
    names = tuple(name for name in angles.streams if name.startswith("head_"))
    contrasts = helmert(len(names))
    delays = np.zeros(len(names))
    for _ in range(ROUNDS):
        shaft = record_shaft(loose(stage), earlier(angles, dict(zip(names, delays, strict=True))), None)
        theta = shaft.readings.mean(axis=1)
        highest = min(HIGHEST, highest_order(theta, float(np.quantile(np.abs(shaft.speed), 0.9)) * shaft.reach))
        if highest < 1:
            raise InputError("the rotations leave too much of the turn out; turn all round, slowly, both ways")
        values = shaft.readings - theta[:, None]
        # clocks may be apart for as long as two turns last, and otherwise in the next
        turns = max(1.0, float(np.abs(np.diff(theta)).sum()) / (2 * TURN))
        wander = stage.timing("encoder") * float(np.sqrt((shaft.speed**2).mean() / turns))
        response = fit_response(basis(theta, shaft.speed, highest), values, contrasts, wander)
        found = -response.coefficients[:, 2]
        delays = delays + found
    return HeadResponse(names, shaft, delays - found, response, theta)


def earlier(angles: HeadAngles, delays: Mapping[str, float]) -> dict[str, tuple[NDArray[np.int64], Array]]:
    """Streams of `delays` by their names (of heads their letters), each stamped as much (s) earlier."""
    return {
        name.removeprefix("head_"): (angles.streams[name][0] - round(delay * 1e9), angles.streams[name][1])
        for name, delay in delays.items()
    }


@dataclass(frozen=True)
class Straight:
    """Constant, scale and delay of signals less the mean of all, with the covariance of each over the signals.

    Attributes:
        constant: (n,) at rotation 0 or whole turns from it, rad; `constant_covariance` (n, n).
        scale: (n,) by which a signal goes faster than the mean, or its clock drifts; `scale_covariance` (n, n).
        delay: (n,) s, later than the mean; `delay_covariance` (n, n).
    """

    constant: Array
    constant_covariance: Array
    scale: Array
    scale_covariance: Array
    delay: Array
    delay_covariance: Array


def straight_part(response: FittedCoefficients, theta: Array) -> Straight:
    """What of responses does not go by orders, at rotations theta (m,), rad."""
    middle = float(theta.mean())
    near = TURN * np.rint(middle / TURN) - middle
    rows = np.array([[1.0, near, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    part = slice(0, STRAIGHT)
    signals = response.channels @ (response.channels.T @ response.coefficients[:, part] @ rows.T)
    spreads = np.einsum("rp,cpq,rq->rc", rows, response.covariances[:, part, part], rows)
    covariances = [response.channels @ np.diag(each) @ response.channels.T for each in spreads]
    return Straight(signals[:, 0], covariances[0], signals[:, 1], covariances[1], signals[:, 2], covariances[2])
