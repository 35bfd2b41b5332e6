"""How well the read heads of a ring agree over time, and which one does not.

Four heads leave one contradiction (parity) that no motion of the rotor makes. At one instant it tells that a head is
wrong, not which: all heads enter it alike. Over time it does, for whatever course the fault takes, the wrong head
carries the same course into rotation and radial motion, each head in a proportion of its own. Taking the fault out of
the right head leaves a motion that runs on as before; taking it out of another one doubles what is wrong.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.signals.reading_noise import spread_of

CHANCE = 1e-4
"""Probability by which chance exceeds a bound on chi-square: once in a hundred seconds of windows."""

ODDS = math.log(1e4)
"""Logarithm of the odds from which one head is taken for the wrong one, against any other."""

LEAST_RATIO = 4.0
"""How much smoother, in mean square, the motion must run without the wrong head than without any other: odds alone
rest on increments that are independent and normal, which those of a real rotor are only roughly."""


STEPS = 6.0
"""Standard deviations of its usual changes by which the contradiction changes where a fault begins."""

FEWEST_CHANGES = 20
"""Changes from which it is known what is usual: to a fifth."""

SMALLEST_PART = 0.02
"""Part of a fault below which motions that differ are the same: a rotor that stands shows whole counts."""

MOST_OF = 0.5
"""Part of the present contradiction that its steps must have made, to be what causes it."""

FAR = 3.0
"""How many times what the stage can do a motion must be that it cannot have made, for limits are known to a factor, no
better. What is left without the wrong head must be as far below that: a wrong rotation puts what is described, such as
the eccentricity, at wrong angles."""


@functools.lru_cache(maxsize=4096)
def chi_square_bound(freedom: float) -> float:
    """What chi-square over its degrees of freedom exceeds with the probability `CHANCE`."""
    from scipy.special import chdtri  # loads for a third of a second, and the compensation reads doubts alone

    return float(chdtri(freedom, CHANCE)) / freedom


@dataclass(frozen=True)
class Isolation:
    """The head that is wrong.

    Attributes:
        head: its place in the layout.
        fault: (n,) course of its fault, rad.
    """

    head: int
    fault: Array


def isolate_head(layout: HeadLayout, motion: Array, parity: Array, lag: int) -> Isolation | None:
    """The head whose fault explains the course of the contradiction; None where the course does not tell.

    Args:
        layout: the heads that were read.
        motion: (n, 3) rotation and the two radial components over the radius, at equal steps of time, rad; what is
            known of them taken off, so that what remains changes little. What was not seen is NaN.
        parity: (n, redundancy) contradiction of the heads, rad.
        lag: steps over which changes are looked at.
    """
    seen = np.isfinite(motion).all(axis=0)
    motion, weights = motion[:, seen], layout.weights[seen]
    candidates = [i for i in range(len(layout.azimuths)) if _can_do_without(layout, i)]
    rough = {i: _roughness(weights[:, i], layout.parity[:, i], motion, parity, lag) for i in candidates}
    steps = len(motion) - lag
    if len(rough) < 2 or steps < 1:
        return None
    best, second = sorted(rough, key=lambda i: rough[i])[:2]
    ratio = rough[second] / max(rough[best], np.finfo(np.float64).tiny)
    if ratio < LEAST_RATIO or 0.5 * steps / lag * math.log(ratio) < ODDS:
        return None
    return Isolation(best, _course(layout.parity[:, best], parity))


def isolate_step(layout: HeadLayout, rotation: Array, motion: Array, parity: Array, lag: int) -> Isolation | None:
    """The head whose steps explain what the motion does where the contradiction steps; None where that does not tell.

    Each component counts by what it usually changes by where the rotor turns about as fast, as the median of its
    changes tells: rotation jitters by more than noise moves the radial motion, and a rotor that rests moves little. So
    a step of a few counts is told from what `isolate_head` finds no rougher.

    Args:
        layout: the heads that were read.
        rotation: (n,) of the rotor, rad.
        motion: (n, 3) as in `isolate_head`.
        parity: (n, redundancy) contradiction of the heads, rad.
        lag: steps over which changes are looked at.
    """
    seen = np.isfinite(motion).all(axis=0)
    moved, changed = (values[lag:] - values[:-lag] for values in (motion[:, seen], parity))
    candidates = [i for i in range(len(layout.azimuths)) if _can_do_without(layout, i)]
    if len(moved) < FEWEST_CHANGES * lag or len(candidates) < 2:
        return None
    alike = _as_fast_as_at_steps(np.abs(rotation[lag:] - rotation[:-lag]), changed)
    if np.count_nonzero(alike) < FEWEST_CHANGES * lag:
        return None
    usual, usually = spread_of(moved[alike]), spread_of(changed[alike])
    stepped = alike & np.any(np.abs(changed) > STEPS * usually, axis=1)
    if not stepped.any() or not _makes_most_of(stepped, parity, lag):
        return None
    left = dict[int, float]()
    for i in candidates:
        fault = _course(layout.parity[:, i], changed[stepped])
        least = SMALLEST_PART * float(np.abs(fault).max())
        rest = moved[stepped] - fault[:, None] * layout.weights[seen, i]
        against = changed[stepped] - fault[:, None] * layout.parity[:, i]
        squares = np.sum(np.square(rest / np.maximum(usual, least)), axis=1)
        squares += np.sum(np.square(against / np.maximum(usually, least)), axis=1)
        left[i] = float(np.sum(squares))
    best, second = sorted(left, key=lambda i: left[i])[:2]
    freedom = int(np.count_nonzero(stepped)) * (moved.shape[1] + changed.shape[1])
    explained = left[best] < FAR**2 * freedom and left[second] > LEAST_RATIO * max(left[best], freedom)
    if not explained or 0.5 * (left[second] - left[best]) < ODDS:
        return None
    return Isolation(best, _course(layout.parity[:, best], parity))


def _as_fast_as_at_steps(speed: Array, changed: Array) -> Mask:
    """(n,) where the rotor is within half and twice as fast as where the contradiction changes by more than usual."""
    stepped = speed[np.any(np.abs(changed) > STEPS * spread_of(changed), axis=1)]
    if not len(stepped):
        return np.zeros(len(speed), np.bool_)
    return np.asarray((speed >= 0.5 * stepped.min()) & (speed <= 2.0 * stepped.max()), np.bool_)


def _makes_most_of(stepped: Mask, parity: Array, lag: int) -> bool:
    """Whether the present contradiction came about where it steps over a lag."""
    meanwhile = np.any([np.roll(np.append(stepped, [False] * (lag - 1)), k) for k in range(lag)], axis=0)
    made = np.linalg.norm(np.sum(np.diff(parity, axis=0)[meanwhile], axis=0))
    return bool(made >= MOST_OF * np.linalg.norm(np.mean(parity[-lag:], axis=0)))


def isolate_drift(layout: HeadLayout, motion: Array, parity: Array) -> Isolation | None:
    """The head whose fault explains where the motion goes, however slowly; None where that does not tell.

    What is left of each component without the fault of a head has a variance that nobody states: the likelihood of
    normal values of unknown variance, for as many of them as are independent. A motion of the rotor that goes with the
    contradiction by chance, all along and in the proportion of one head, is what it is weighed against.

    Args:
        layout: the heads that were read.
        motion: (n, 3) as in `isolate_head`, but what is not as it was before at the same angle.
        parity: (n, redundancy) the same of the contradiction of the heads, rad.
    """
    seen = np.isfinite(motion).all(axis=0)
    motion, weights, size, left = motion[:, seen], layout.weights[seen], dict[int, float](), dict[int, Array]()
    if len(motion) < FEWEST_CHANGES:
        return None
    least = SMALLEST_PART**2 * float(np.mean(np.sum(np.square(parity), axis=1)))
    for i in range(len(layout.azimuths)):
        if _can_do_without(layout, i):
            left[i] = _without(weights[:, i], layout.parity[:, i], motion, parity)
            size[i] = float(np.sum(np.log(np.mean(np.square(left[i]), axis=0) + least)))
    if len(size) < 2 or least == 0.0:
        return None
    best, second = sorted(size, key=lambda i: size[i])[:2]
    more = size[second] - size[best]
    rest = left[best][:, np.mean(np.square(left[best]), axis=0) > least]
    if more < math.log(LEAST_RATIO) or 0.5 * more * independent_values(rest) < ODDS:
        return None
    return Isolation(best, _course(layout.parity[:, best], parity))


def independent_values(courses: Array) -> float:
    """How many independent values about zero courses (n, k) are worth, at least, by their autocorrelation times.

    One where there is no course. Each autocorrelation is summed up to where pairs of it are first negative (Geyer 1992,
    Section 3.3).
    """
    n = len(courses)
    power = np.square(np.abs(np.fft.rfft(courses, 2 * n, axis=0)))
    correlation = np.fft.irfft(power, axis=0)[: n - n % 2]
    pairs = (correlation[::2] + correlation[1::2]) / np.maximum(correlation[0], np.finfo(np.float64).tiny)
    positive = np.logical_and.accumulate(pairs > 0.0, axis=0)
    times = 2.0 * np.sum(pairs * positive, axis=0) - 1.0
    return float(n / max(1.0, *times)) if len(times) else 1.0


def isolate_implausible(layout: HeadLayout, motion: Array, parity: Array, most: Array) -> Isolation | None:
    """The head whose fault, taken out, leaves a motion that the stage can make, where that is so of one head alone.

    It needs no course: a head that comes back with another zero is off by far more than a stage moves.

    Args:
        layout: the heads that were read.
        motion: (n, 3) as in `isolate_head`.
        parity: (n, redundancy) contradiction of the heads, rad.
        most: (3,) what rotation (less the command) and radial components over the radius can be, rad.
    """
    seen = np.isfinite(motion).all(axis=0)
    motion, weights = motion[:, seen] / most[seen], layout.weights[seen] / most[seen, None]
    candidates = [i for i in range(len(layout.azimuths)) if _can_do_without(layout, i)]
    size = {}
    for i in candidates:
        fault = _course(layout.parity[:, i], parity)
        size[i] = float(np.abs(motion - fault[:, None] * weights[:, i]).max(axis=1).mean())
    if len(size) < 2:
        return None
    best, second = sorted(size, key=lambda i: size[i])[:2]
    if size[second] < FAR or size[best] * FAR**2 > size[second]:
        return None
    return Isolation(best, _course(layout.parity[:, best], parity))


def _can_do_without(layout: HeadLayout, head: int) -> bool:
    """Whether the rotation is still seen without a head."""
    rest = layout.azimuths[:head] + layout.azimuths[head + 1 :]
    return len(rest) >= 2 and "theta" in HeadLayout(rest).observable


def _course(column: Array, parity: Array) -> Array:
    """(n,) fault of one head that explains most of the parity."""
    return np.asarray(parity @ column / (column @ column))


def _roughness(weights: Array, column: Array, motion: Array, parity: Array, lag: int) -> float:
    """Mean square change over `lag` of what is left when the fault of one head has been taken out."""
    left = _without(weights, column, motion, parity)
    change = left[lag:] - left[:-lag]
    return float(np.mean(change * change))


def _without(weights: Array, column: Array, motion: Array, parity: Array) -> Array:
    """(n, 3 + redundancy) motion and parity when the fault of one head has been taken out."""
    fault = _course(column, parity)
    return np.concatenate([motion - fault[:, None] * weights, parity - fault[:, None] * column], axis=1)
