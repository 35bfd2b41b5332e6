"""The parameters of a stage as a recording of it gives them, each with a standard uncertainty."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.commissioning.command import CommandFit
from rotary_error_monitor.commissioning.heads import HeadAngles, HeadResponse, straight_part
from rotary_error_monitor.commissioning.layouts import Layout, turned_over
from rotary_error_monitor.commissioning.ring_model import RingFit, RingPrior
from rotary_error_monitor.commissioning.stated_curves import mirror_rows, ring_level
from rotary_error_monitor.commissioning.tilt import Axes, TiltResponse, amplitudes, known_axes, turned
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.units import TURN

TOLD = 0.5
"""Part of its prior standard deviation below which the recording tells a parameter: three quarters of its variance."""

SIGNIFICANT = 4.0
"""Standard deviations from which an order of the graduation is there: one in a thousand recordings shows one of some
thirty that is not."""

EARLY = 3.0
"""Standard uncertainties by which an autocollimator, whose delay is less sure, is earlier than the earliest head."""

SURE = 0.02
"""Standard uncertainty of gain and roll (rad) up to which they are written: instruments of one make differ by less
than more would tell."""


@dataclass(frozen=True)
class UncertainValue:
    """A value and its standard uncertainty."""

    value: float
    std: float


@dataclass(frozen=True)
class FoundHead:
    """What a head has of its own; its azimuth (rad) stays near the described one where little tells it."""

    azimuth: UncertainValue
    zero: UncertainValue
    sign: int
    latency: UncertainValue
    scale: UncertainValue


@dataclass(frozen=True)
class FoundCommand:
    """What the command has of its own; a latency below 0 is the lag of the drive, or of all heads' stamps."""

    zero: UncertainValue
    sign: int
    latency: UncertainValue
    scale: UncertainValue


@dataclass(frozen=True)
class FoundTilt:
    """What the autocollimator and its mirror have of their own.

    Attributes:
        zero: (x, y) rad.
        latency: s.
        axes: gain and roll, where an independent tilt tells them; by what is described otherwise.
        gain: reading per tilt.
        roll: rad.
        tilt: (x, y) of the mirror, rad, as gain and roll have it.
        tilt_std: rad.
        mirrored: whether its axes are of the wrong hand.
    """

    zero: tuple[UncertainValue, UncertainValue]
    latency: UncertainValue
    axes: Axes | None
    gain: float
    roll: float
    tilt: tuple[float, float]
    tilt_std: float
    mirrored: bool

    @property
    def axes_told(self) -> bool:
        """Whether gain and roll are sure enough to be written."""
        return self.axes is not None and self.axes.std <= SURE


@dataclass(frozen=True)
class Found:
    """All parameters.

    Attributes:
        heads: by letter.
        eccentricity: (x, y) m, with the standard uncertainty of each.
        graduation: orders that the heads tell from all else and that stand out, or in which they contradict each other,
            with the standard uncertainties; none where the file has a measured curve.
        datum: what the rotation is counted from: `command`, or a head that states its zero.
        hidden_orders: of the graduation, which the recording does not tell from rotation and error motion.
    """

    heads: Mapping[str, FoundHead]
    command: FoundCommand | None
    tilt: FoundTilt | None
    eccentricity: tuple[UncertainValue, UncertainValue]
    graduation: tuple[tuple[AngularHarmonic, float], ...]
    datum: str
    hidden_orders: tuple[int, ...]


@dataclass(frozen=True)
class StatedReadings:
    """What the stage file itself states, beside what it leaves to the default: signs and zeros by stream."""

    signs: Collection[str] = field(default_factory=frozenset)
    zeros: Collection[str] = field(default_factory=frozenset)


@dataclass(frozen=True)
class Shown:
    """What the instruments showed, before anything is made of it; rotation counted as the first head counts."""

    angles: HeadAngles
    heads: HeadResponse
    command: CommandFit | None
    tilt: TiltResponse | None


def parameters(
    stage: StageDescription, stated: StatedReadings, shown: Shown, layout: Layout, fit: RingFit, prior: RingPrior
) -> Found:
    """The parameters where heads stand as a layout has it; `prior` is what its `fit` took to be known before."""
    names, sense = shown.heads.names, layout.sense
    response = shown.heads.response if sense == 1 else turned_over(shown.heads.response)
    straight = straight_part(response, sense * shown.heads.theta)
    datum, origin, origin_std = _origin(stage, stated, shown, sense, straight.constant)
    late = shown.heads.delays + straight.delay
    level = ring_level(stage)
    first = _first(late, shown.tilt)
    azimuths = np.array([stage.azimuths[name.removeprefix("head_")] for name in names])[list(layout.places)]
    stds = np.sqrt(np.diag(fit.azimuth_covariance))
    heads = {}
    for i, name in enumerate(names):
        sign = sense * shown.angles.relative[name]
        zero = sign * (straight.constant[i] - origin - level)
        latency = float(late[i] - first)
        timing = float(np.hypot(np.sqrt(straight.delay_covariance[i, i]), stage.timing("encoder")))
        heads[name.removeprefix("head_")] = FoundHead(
            UncertainValue(float(azimuths[i] + fit.azimuth_offsets[i]), float(stds[i])),
            UncertainValue(within_turn(zero), float(np.hypot(np.sqrt(straight.constant_covariance[i, i]), origin_std))),
            sign,
            UncertainValue(latency, timing),
            UncertainValue(float(straight.scale[i]), float(np.sqrt(straight.scale_covariance[i, i]))),
        )
    places = [head.azimuth.value for head in heads.values()]
    turn = np.array([[np.cos(origin), np.sin(origin)], [-np.sin(origin), np.cos(origin)]])
    vector = turn @ fit.eccentricity
    spread = np.sqrt(np.diag(turn @ fit.covariance[:2, :2] @ turn.T))
    graduation = () if prior.curve is not None else tuple(_graduation(fit, origin, places, _of_a_reading(stage)))
    told = {row.order for row, _ in graduation}
    return Found(
        heads,
        None if shown.command is None else _command(shown, shown.command, sense, origin, first),
        None if shown.tilt is None else _tilt(stage, turned(shown.tilt, sense, origin), layout.mirrored, first),
        (UncertainValue(float(vector[0]), float(spread[0])), UncertainValue(float(vector[1]), float(spread[1]))),
        graduation,
        datum,
        tuple(order for order in _hidden(fit, prior) if order not in told),
    )


def _first(late: Array, tilt: TiltResponse | None) -> float:
    """Delay of what counts as in time: what all are late by shows nowhere, and no latency is negative."""
    first = float(late.min())
    if tilt is not None and tilt.delay < first - EARLY * tilt.delay_std:
        return tilt.delay
    return first


def known_hand(stage: StageDescription, stated: StatedReadings, shown: Shown) -> dict[tuple[int, bool], float]:
    """Logarithm of the likelihood of each sense and hand by a tilt that is known otherwise, nothing where none is.

    What even the best of them leaves counts as noise: it is not by the hand.
    """
    if shown.tilt is None:
        return {}
    found = {}
    for sense in (1, -1):
        tilt = turned(shown.tilt, sense, origin_of(stage, stated, shown, sense))
        for mirrored in (False, True):
            axes = known_axes(stage, tilt, mirrored)
            if axes is not None:
                found[sense, mirrored] = axes.chi_square
    if not found:
        return {}
    scale = max(1.0, min(square / max(count, 1) for square, count in found.values()))
    return {way: -0.5 * square / scale for way, (square, _) in found.items()}


def origin_of(stage: StageDescription, stated: StatedReadings, shown: Shown, sense: int) -> float:
    """By how much the mean of the heads is behind the rotation where the first head counts in that sense, rad."""
    response = shown.heads.response if sense == 1 else turned_over(shown.heads.response)
    constants = straight_part(response, sense * shown.heads.theta).constant
    return _origin(stage, stated, shown, sense, constants)[1]


def within_turn(angle: float) -> float:
    """The angle less whole turns, from -pi to pi, rad."""
    return float(angle - TURN * np.rint(angle / TURN))


def _origin(
    stage: StageDescription, stated: StatedReadings, shown: Shown, sense: int, constants: Array
) -> tuple[str, float, float]:
    """What the rotation is counted from, and by how much the mean of the heads is behind the rotation, rad."""
    for i, name in enumerate(shown.heads.names):
        if name in stated.zeros:
            sign = sense * shown.angles.relative[name]
            return name, float(constants[i]) - sign * stage.response(name).zero[0] - ring_level(stage), 0.0
    if shown.command is None:
        return shown.heads.names[0], float(constants[0]), 0.0
    zero = (*stage.response(COMMAND).zero, 0.0)[0]
    sign = sense * shown.angles.relative[COMMAND]
    return COMMAND, sense * shown.command.constant - sign * zero, shown.command.constant_std


def _command(shown: Shown, fit: CommandFit, sense: int, origin: float, first: float) -> FoundCommand:
    sign = sense * shown.angles.relative[COMMAND]
    return FoundCommand(
        UncertainValue(within_turn(sign * (sense * fit.constant - origin)), fit.constant_std),
        sign,
        UncertainValue(fit.delay - first, fit.delay_std),
        UncertainValue(fit.scale, fit.scale_std),
    )


def _tilt(stage: StageDescription, tilt: TiltResponse, mirrored: bool, first: float) -> FoundTilt:
    axes = known_axes(stage, tilt, mirrored)
    response = stage.response("autocollimator")
    gain, roll = response.gain, response.roll
    if axes is not None and axes.std <= SURE and not mirrored:
        gain, roll = abs(axes.response), float(np.angle(axes.response))
        if response.gain < 0:  # the same instrument, as the file has it
            gain, roll = -gain, within_turn(roll + np.pi)
    seen = tilt.along[0] if not mirrored else tilt.against[0].conj()
    form = mirror_rows(stage, 1)
    still = sum(complex(row.x[0], row.y[0]) for row in form if row.order == 0)
    still = gain * np.exp(1j * roll) * (still.conjugate() if mirrored else still)
    mirror = complex(seen / (gain * np.exp(1j * roll))) - complex(amplitudes(form, 1)[0][0])
    std = float(np.sqrt(tilt.variance[0])) / abs(gain)
    if axes is not None and axes.std <= SURE:
        std = float(np.hypot(std, axes.std * abs(mirror)))
    return FoundTilt(
        (
            UncertainValue(tilt.zero[0] - still.real, tilt.zero_std),
            UncertainValue(tilt.zero[1] - still.imag, tilt.zero_std),
        ),
        UncertainValue(tilt.delay - first, tilt.delay_std),
        axes,
        gain,
        roll,
        (mirror.real, mirror.imag),
        std,
        mirrored,
    )


def _graduation(
    fit: RingFit, origin: float, azimuths: Sequence[float], reading: float
) -> Iterator[tuple[AngularHarmonic, float]]:
    """Orders that stand out from the noise and that no error motion makes.

    So are those in which the heads contradict one another by more than the standard uncertainty of a reading (rad), as
    they are likeliest: a file without them contradicts the recording, whatever stamps may have been.
    """
    for order in range(2, fit.highest + 1):
        values, covariance = fit.graduation(order)
        wave = HeadLayout(tuple(azimuths)).projector @ np.exp(1j * order * np.array(azimuths))
        contradicts = float(np.hypot(*values) * np.abs(wave).max()) > reading
        if contradicts or float(values @ np.linalg.solve(covariance, values)) > SIGNIFICANT**2:
            c, s = np.cos(order * origin), np.sin(order * origin)
            cos, sin = np.array([[c, s], [-s, c]]) @ values
            yield AngularHarmonic(order, float(cos), float(sin)), float(np.sqrt(covariance.diagonal().max()))


def _of_a_reading(stage: StageDescription) -> float:
    """Standard uncertainty of one reading by the noise and the rounding that are described, rad."""
    return math.hypot(stage.ring.noise, stage.ring.resolution / math.sqrt(12.0))


def _hidden(fit: RingFit, prior: RingPrior) -> tuple[int, ...]:
    """Orders of which the recording leaves most of what was unknown before."""
    orders = range(2, fit.highest + 1)
    stds = [float(np.sqrt(fit.graduation(order)[1].diagonal().max())) for order in orders]
    return tuple(
        k for k, std in zip(orders, stds, strict=True) if std > TOLD * prior.graduation_std(k) and prior.curve is None
    )
