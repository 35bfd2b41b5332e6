"""What an autocollimator shows over a rotation: its delay, its hand, and what an independent tilt tells of its axes.

With z = x + iy the instrument reads

    z0 + p (m exp(i theta) + T(theta)),   p = gain exp(i roll)

where m is the tilt of the mirror on the rotor and T the tilt of the rotor; one of the wrong hand reads p times the
conjugate. Of p m the recording tells the product alone. p itself is told by a T that is known from elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.commissioning.heads import ROUNDS, HeadAngles, HeadResponse, earlier, loose
from rotary_error_monitor.commissioning.response_fit import FEW, basis, fit_response, smooth_by_correlation
from rotary_error_monitor.commissioning.stated_curves import mirror_doubt, mirror_rows
from rotary_error_monitor.commissioning.streams import RawStream
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.rotation_fit import highest_order
from rotary_error_monitor.metrology.shaft_recording import record_shaft
from rotary_error_monitor.units import TURN

HIGHEST = 8
"""Orders of tilt that are fitted: those of bearings, and of mirrors as flat as they are made."""

MIRROR = 1e-3
"""Prior standard deviation of the mirror's tilt in each direction, rad: what screws and glue leave."""

MIRRORED = 0.005
"""Prior probability that an autocollimator has axes of the wrong hand: a driver that counts one backwards."""

FLATNESS = 1e-6
"""Standard deviation of what a mirror shows beside its described flatness, rad, where the file states none: a tenth of
a wave over the beam of an autocollimator."""

PARTS = 4
"""Parts of a turn over which a residual is averaged to see what is slow in it."""

SMALL = 1e-9
"""By which forces, N, are brought among angles, rad."""

LEAST_FORCE = 1.0
"""Force, N, from which something pushes: load cells drift by less."""


@dataclass(frozen=True)
class TiltResponse:
    """What the autocollimator shows, rotation counted as the first head counts.

    Attributes:
        zero: (x, y) what does not change, rad.
        zero_std: its standard uncertainty in each direction, rad.
        along: (k,) of orders 1 to k the amplitude of what goes with the rotation, x + iy, rad.
        against: (k,) of what goes against it.
        variance: (k,) of either part of these amplitudes, rad².
        delay: s behind the mean of the heads.
        delay_std: s.
        forced: tilt per force along x and along y, x + iy, rad/N, with the variance of a part; None without force.
    """

    zero: tuple[float, float]
    zero_std: float
    along: Complex
    against: Complex
    variance: Array
    delay: float
    delay_std: float
    forced: tuple[complex, complex, float] | None = None


def fit_tilt(
    stage: StageDescription, angles: HeadAngles, heads: HeadResponse, stream: RawStream, force: RawStream | None
) -> TiltResponse:
    """What an autocollimator's raw stream shows.

    Raises:
        InputError: autocollimator and heads hardly overlap, or it is at the end of its range all the time.
    """
    delay = 0.0
    late = earlier(angles, dict(zip(heads.names, heads.delays, strict=True)))
    pushes = _force_streams(force)
    for _ in range(ROUNDS + 1):
        shaft = record_shaft(loose(stage), late | pushes, (stream.times_ns - round(delay * 1e9), stream.values))
        assert shaft.tilt is not None and shaft.tilt_valid is not None
        seen = shaft.tilt_valid
        if seen.sum() < 2 * len(seen) // 3:
            raise InputError(
                f"the autocollimator is at the end of its range in {1 - seen.mean():.0%} of the recording; align it"
            )
        theta = shaft.readings[:, : len(late)].mean(axis=1)
        speed = np.gradient(theta, shaft.times)[seen]
        theta = theta[seen]
        highest = min(HIGHEST, highest_order(theta, float(np.quantile(np.abs(speed), 0.9)) * shaft.reach))
        if highest < 1:
            raise InputError("where the autocollimator sees something the rotations leave too much of the turn out")
        design = np.delete(basis(theta, speed, highest), (1, 2), axis=1)
        if pushes:
            push = shaft.readings[seen, len(late) :] / SMALL
            design = np.column_stack([design, push - push.mean(axis=0)])
        response = fit_response(design, shaft.tilt[seen], np.eye(2))
        moved, spread = _later(design, highest, response.coefficients, response.residual, speed)
        delay += moved
    spreads = np.mean([np.diag(each) for each in response.covariances], axis=0)
    cos, sin = _complex(response.coefficients[:, 1 : 1 + 2 * highest])
    forced = None
    if pushes:
        x, y = response.coefficients[:, -2:].T
        forced = complex(*x), complex(*y), float(spreads[-2:].max())
    return TiltResponse(
        (float(response.coefficients[0, 0]), float(response.coefficients[1, 0])),
        float(np.hypot(np.sqrt(spreads[0]), _slow(theta, response.residual))),
        (cos - 1j * sin) / 2,
        (cos + 1j * sin) / 2,
        (spreads[1 : 1 + 2 * highest : 2] + spreads[2 : 2 + 2 * highest : 2]) / 4,
        delay,
        float(np.hypot(spread, stage.timing("encoder"))),
        forced,
    )


def _slow(theta: Array, residual: Array) -> float:
    """What motion of no whole order leaves of a mean, where it lasts for a turn and is another in the next."""
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(theta)))]) / TURN
    _, part = np.unique(np.floor(PARTS * way), return_inverse=True)
    means = np.stack([np.bincount(part, column) / np.bincount(part) for column in residual.T])
    return float(np.sqrt((means**2).mean() / max(1.0, way[-1])))


def _complex(coefficients: Array) -> tuple[Complex, Complex]:
    """Cosine and sine of each order, x + iy, from coefficients (2, 2 k)."""
    both = coefficients[0] + 1j * coefficients[1]
    return both[::2], both[1::2]


def _later(design: Array, highest: int, coefficients: Array, residual: Array, speed: Array) -> tuple[float, float]:
    """By how much more the values are late, s, and its standard uncertainty: by what the rotation makes meanwhile."""
    orders = np.arange(1, highest + 1)
    slope = np.zeros_like(coefficients)
    slope[:, 1 : 1 + 2 * highest : 2] = orders * coefficients[:, 2 : 2 + 2 * highest : 2]
    slope[:, 2 : 2 + 2 * highest : 2] = -orders * coefficients[:, 1 : 1 + 2 * highest : 2]
    column = -speed[:, None] * (design @ slope.T)
    own = column - design @ np.linalg.lstsq(design, column, rcond=None)[0]
    square = float((own**2).sum())
    if square == 0.0:
        return 0.0, math.inf
    variance = sum(float(own[:, k] @ smooth_by_correlation(residual[:, k], own[:, k : k + 1])[:, 0]) for k in range(2))
    white = float((residual**2).mean()) * square
    return float((own * residual).sum()) / square, math.sqrt(max(FEW**2 * variance, white)) / square


def _force_streams(force: RawStream | None) -> dict[str, tuple[NDArray[np.int64], Array]]:
    """Force along x and y, made as small as angles are, for it is brought to the same times as they."""
    if force is None or np.ptp(force.values, axis=0).max() < LEAST_FORCE:
        return {}
    return {f"force_{axis}": (force.times_ns, SMALL * force.values[:, [k]]) for k, axis in enumerate("xy")}


def log_hand(tilt: TiltResponse, limit: float) -> dict[tuple[int, bool], float]:
    """Logarithm of the likelihood with its prior, by sense of the rotation and whether the axes are of the wrong hand.

    A mirror goes with the rotation, by more than a rotor tilts. `limit` is how far that may be at most, rad.
    """
    rotor, mirror = (limit / 2) ** 2 + tilt.variance[0], MIRROR**2 + tilt.variance[0]

    def log_likelihood(with_rotation: complex, against: complex) -> float:
        return float(-0.5 * (abs(with_rotation) ** 2 / mirror + abs(against) ** 2 / rotor))

    found = {}
    for sense in (1, -1):
        for mirrored in (False, True):
            pair = complex(tilt.along[0]), complex(tilt.against[0])
            if (sense == -1) != mirrored:
                pair = pair[1], pair[0]
            found[sense, mirrored] = log_likelihood(*pair) + math.log(MIRRORED if mirrored else 1 - MIRRORED)
    return found


def turned(tilt: TiltResponse, sense: int, turn: float) -> TiltResponse:
    """The same by a rotation of the other sense where `sense` is -1, and larger by `turn`, rad."""
    along, against = (tilt.along, tilt.against) if sense == 1 else (tilt.against, tilt.along)
    phase = np.exp(-1j * turn * np.arange(1, len(along) + 1))
    return TiltResponse(
        tilt.zero,
        tilt.zero_std,
        along * phase,
        against / phase,
        tilt.variance,
        tilt.delay,
        tilt.delay_std,
        tilt.forced,
    )


@dataclass(frozen=True)
class Axes:
    """What an independent tilt tells of an instrument's axes.

    Attributes:
        response: gain and roll as gain exp(i roll), of what is shown, or of its conjugate where `mirrored`.
        std: standard uncertainty of either part over its size: of the gain as a part of it, of the roll in rad.
        chi_square: of what it leaves, and its degrees of freedom.
        mirrored: whether the hand is wrong.
    """

    response: complex
    std: float
    chi_square: tuple[float, int]
    mirrored: bool


def known_axes(stage: StageDescription, tilt: TiltResponse, mirrored: bool) -> Axes | None:
    """Axes by the tilt that the description states with an uncertainty; None where it states none."""
    pairs = list(_known(stage, tilt, mirrored))
    if not pairs:
        return None
    shown, read, variance, doubt = (np.array(each) for each in zip(*pairs, strict=True))
    response, size = 0j, 1.0
    for _ in range(3):
        weights = 1 / (variance + size**2 * doubt)
        information = float((weights * np.abs(shown) ** 2).sum())
        response = complex((weights * shown.conj() * read).sum()) / information
        size = max(abs(response), 1e-3)
    left = float((weights * np.abs(read - response * shown) ** 2).sum())
    common = _compliance_doubt(stage) if tilt.forced is not None else 0.0
    std = math.hypot(1 / math.sqrt(information) / size, common)
    return Axes(response, std, (left, 2 * len(pairs) - 2), mirrored)


def _known(
    stage: StageDescription, tilt: TiltResponse, mirrored: bool
) -> Iterable[tuple[complex, complex, float, float]]:
    """What is shown, what is read of it, and the variances of a part of what is read and of what is shown."""
    if "spindle.tilt" in stage.uncertainty:
        flat = mirror_doubt(stage, FLATNESS)
        doubt = (stage.uncertainty["spindle.tilt"] ** 2 + flat**2) / 2
        stated = {row.order for row in (*stage.spindle.tilt, *stage.mirror.flatness)}
        # of other orders the curve says what the mirror shows, and nothing says what the rotor does
        measured = (row for row in mirror_rows(stage, HIGHEST) if row.order in stated)
        along, against = amplitudes((*stage.spindle.tilt, *stage.mirror.flatness, *measured), len(tilt.along))
        for k in range(len(tilt.along)):
            pair = (along[k], against[k]) if not mirrored else (against[k].conj(), along[k].conj())
            # of order 1 one part is the mirror's: that which goes with the rotation, as it is read
            if (k > 0 or mirrored) and abs(pair[0]) > 0:
                yield complex(pair[0]), complex(tilt.along[k]), float(tilt.variance[k]), doubt
            if (k > 0 or not mirrored) and abs(pair[1]) > 0:
                yield complex(pair[1]), complex(tilt.against[k]), float(tilt.variance[k]), doubt
    compliance = stage.spindle.tilt_compliance
    if tilt.forced is not None and compliance != 0.0 and "spindle.tilt_compliance" in stage.uncertainty:
        # a force along x tilts about y, one along y about -x
        for shown, read in ((1j * compliance, tilt.forced[0]), (-compliance + 0j, tilt.forced[1])):
            yield (shown.conjugate() if mirrored else shown), read, tilt.forced[2], 0.0


def _compliance_doubt(stage: StageDescription) -> float:
    compliance = abs(stage.spindle.tilt_compliance)
    return stage.uncertainty.get("spindle.tilt_compliance", 0.0) / compliance if compliance else 0.0


def amplitudes(rows: Iterable[PlanarHarmonic], highest: int) -> tuple[Complex, Complex]:
    """What described rows make with and against the rotation, by orders 1 to `highest`."""
    along, against = np.zeros(highest, complex), np.zeros(highest, complex)
    for row in rows:
        if 1 <= row.order <= highest:
            cos, sin = complex(row.x[0], row.y[0]), complex(row.x[1], row.y[1])
            along[row.order - 1] += (cos - 1j * sin) / 2
            against[row.order - 1] += (cos + 1j * sin) / 2
    return along, against
