"""Tilt and flatness of the mirror from a recording of the shaft between centres (Lou et al. 2019, Figure 3).

Between centres the shaft has no error motion of its own, so all that the autocollimator sees is tilt and flatness of
the mirror. Those orders are taken that stand out from the noise, up to what the sampling tells apart; what the
recording cannot tell is left as it was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.harmonics import planar_sum
from rotary_error_monitor.metrology.recording_fit import RecordingFit, judge_recording
from rotary_error_monitor.metrology.ring_assembly import LEAST_NOISE, RingAssembly
from rotary_error_monitor.metrology.rotation_fit import (
    OrderFit,
    differentiate_orders,
    evaluate_orders,
    find_orders,
    fit_orders,
    significant,
    with_rounding,
)
from rotary_error_monitor.metrology.shaft_recording import Observed, ShaftRecording, check_heads, observe, told_orders

DELAY_STD = 5e-3
"""Standard uncertainty of an autocollimator's delay that nobody has measured, s: exposure and transfer of instruments
that give some hundred values a second."""

ROUNDS = 3
"""Rounds in which what is small of second order settles: the delay, and the rotation once the ring's error is known."""


@dataclass(frozen=True)
class MirrorAssembly:
    """Tilt and flatness of the mirror, rad, with standard uncertainties.

    Attributes:
        flatness: orders that stand out or stood in the description.
        flatness_std: largest of the four coefficients of an order.
        flatness_covariance: (4 r, 4 r) of the coefficients of these orders, one after another: x cos, x sin, y cos,
            y sin, rad².
        kept: orders of the description that the recording cannot tell.
        line_of_sight: constant reading of the autocollimator, rad: how it is set up, not an error of the mirror.
        delay: age of the autocollimator's values at their stamps, s.
        highest: highest order that was looked for.
        fit: what the recording says against this mirror.
    """

    tilt: tuple[float, float]
    tilt_std: tuple[float, float]
    flatness: tuple[PlanarHarmonic, ...]
    flatness_std: tuple[float, ...]
    flatness_covariance: Array
    kept: tuple[PlanarHarmonic, ...]
    line_of_sight: tuple[float, float]
    delay: float
    delay_std: float
    highest: int
    fit: RecordingFit


def estimate_mirror_assembly(
    stage: StageDescription,
    recording: ShaftRecording,
    delay: tuple[float, float] = (0.0, DELAY_STD),
    highest: int | None = None,
    *,
    every: bool = False,
) -> MirrorAssembly:
    """Tilt of the mirror and its flatness.

    A delay of the autocollimator turns the mirror's apparent direction by speed times delay. Both directions or two
    speeds tell it; otherwise what is known of it before counts into the uncertainty.

    Args:
        stage: as described so far; flatness of orders that cannot be told stays and is taken into account.
        recording: of the shaft between centres.
        delay: age of the autocollimator's values at their stamps and its standard uncertainty, as known before, s.
        highest: order up to which is looked; by default what the sampling tells apart.
        every: take all orders from 2 on, whether they stand out or not.

    Raises:
        InputError: no autocollimator, one that does not change, or rotations that leave too much of the turn out.
    """
    if recording.tilt is None or recording.tilt_variances is None:
        raise InputError("the recording holds no autocollimator samples; the mirror's tilt cannot be determined")
    theta = check_heads(stage, recording).mean(axis=1)
    valid = np.ones(len(theta), np.bool_) if recording.tilt_valid is None else recording.tilt_valid
    _check_alive(stage, recording.tilt[valid])
    told = told_orders(theta[valid], recording, highest)
    kept = tuple(row for row in stage.mirror.flatness if not 1 <= row.order <= told)
    seen = observe(
        theta[valid],
        (recording.tilt - planar_sum(kept, theta))[valid],
        recording.tilt_variances[valid],
        recording.speed[valid],
        recording.times[valid],
    )
    described = {row.order for row in stage.mirror.flatness if row not in kept}
    if every:
        # order 1 against the rotation, which a leaning shaft makes as well, still has to stand out
        described |= set(range(2, told + 1))
    return replace(_fit_mirror(stage, seen, described, told, delay), kept=kept)


def _check_alive(stage: StageDescription, tilt: Array) -> None:
    """Hold that the autocollimator shows something: with noise of half a step or more no reading stays the same."""
    instrument = stage.tilt_instrument
    if len(tilt) == 0:
        raise InputError("the autocollimator is at the end of its range all the time; align it, or the mirror")
    still = np.ptp(tilt, axis=0) == 0
    if still.any() and instrument.noise >= 0.5 * instrument.resolution > 0:
        name = "tilt_x" if still[0] else "tilt_y"
        raise InputError(
            f"the autocollimator's {name} is {tilt[0, int(np.argmax(still))]:g} rad all the time: it is stuck"
        )


def _fit_mirror(
    stage: StageDescription, seen: Observed, described: set[int], told: int, delay: tuple[float, float]
) -> MirrorAssembly:
    instrument = stage.tilt_instrument
    floor = LEAST_NOISE * float(seen.variances.mean())
    found, orders, variance = delay[0], sorted({1, *described}), delay[1] ** 2
    for round_ in range(ROUNDS + 1):
        theta = seen.theta - seen.speed * found
        if round_ == 1:
            orders = sorted(find_orders(theta, seen.values, told, orders, None))
        fit = fit_orders(theta, seen.values, orders, floor)
        # the delay enters through theta - speed * delay: Gauss-Newton, almost linear
        slope = evaluate_orders(theta, orders, differentiate_orders(orders, fit.coefficients))
        aged = fit_orders(theta, -seen.speed[:, None] * slope, orders, 0.0)
        weight = 1 / (np.diag(fit.noise) * fit.factors[1 + orders.index(1)])
        information = float((aged.residual**2 @ weight).sum())
        pull = float((aged.residual * fit.residual @ weight).sum())
        if delay[1] > 0:
            variance = 1 / (information + 1 / delay[1] ** 2)
            found += variance * (pull + (delay[0] - found) / delay[1] ** 2)
    fit = with_rounding(fit, theta, seen.variances, instrument.noise, instrument.resolution)
    spread = fit.covariance()
    turned = aged.coefficients[1:].ravel()
    spread = spread + variance * np.outer(turned, turned)
    coefficients, first = fit.coefficients[1:].ravel(), fit.place(1)
    tilt, tilt_spread = _WITH @ coefficients[first], _WITH @ spread[first, first] @ _WITH.T
    kept, made = _flatness(fit, spread, described, told)
    read = tilt_reading_variance(instrument)
    judged = judge_recording(fit.residual, seen.variances, read, fit.coefficients.size + 1, seen.times, seen.speed)
    std = np.hypot(np.sqrt(np.diag(tilt_spread)), judged.discrepancy)
    flat = made @ spread @ made.T
    stds = np.sqrt(np.diag(flat).reshape(-1, 4).max(axis=1, initial=0.0))
    return MirrorAssembly(
        tilt=(float(tilt[0]), float(tilt[1])),
        tilt_std=(float(std[0]), float(std[1])),
        flatness=tuple(
            PlanarHarmonic(k, (float(row[0]), float(row[1])), (float(row[2]), float(row[3])))
            for k, row in zip(kept, (made @ coefficients).reshape(-1, 4), strict=True)
        ),
        flatness_std=tuple(float(np.hypot(each, judged.discrepancy)) for each in stds),
        flatness_covariance=flat + judged.discrepancy**2 * np.eye(len(made)),
        kept=(),
        line_of_sight=(float(fit.coefficients[0, 0]), float(fit.coefficients[0, 1])),
        delay=found,
        delay_std=float(np.sqrt(variance)),
        highest=told,
        fit=judged,
    )


_WITH = np.array([[1, 0, 0, 1], [0, 1, -1, 0]]) / 2
"""Of x cos, y cos, x sin, y sin of order 1 what goes with the rotation: the tilt of a mirror that turns."""

_AGAINST = np.array([[1, 0, 0, -1], [0, 1, 1, 0]]) / 2
"""And what goes against it."""

_ROW_AGAINST = np.array([[1, 0], [0, 1], [0, 1], [-1, 0]])
"""x cos, x sin, y cos, y sin of what goes against it."""

_ROW = np.eye(4)[[0, 2, 1, 3]]
"""The same of all four of another order."""


def _flatness(fit: OrderFit, spread: Array, described: set[int], told: int) -> tuple[list[int], Array]:
    """Orders of flatness that are described or stand out, and (4 r, n) what of all coefficients makes their rows."""
    found, kept, parts = fit.coefficients[1:].ravel(), [], [np.zeros((0, len(spread)))]
    for order in fit.orders:
        at, own = fit.place(order), _AGAINST if order == 1 else np.eye(4)
        if order in described or significant(own @ found[at], own @ spread[at, at] @ own.T, fit.freedom, told):
            row = np.zeros((4, len(spread)))
            row[:, at] = _ROW_AGAINST @ _AGAINST if order == 1 else _ROW
            kept.append(order)
            parts.append(row)
    return kept, np.concatenate(parts)


def doubt_mirror(mirror: MirrorAssembly, ring: RingAssembly) -> MirrorAssembly:
    """The mirror with what the heads say of the shaft: error motion of its own, if it has some, is tilt as well.

    That cannot be told from the mirror. A shaft displaced by d at a ring of radius r is taken to tilt by about d / r;
    and where the recording does not fit the ring, all that seems to be flatness may be the shaft's.
    """
    doubt = ring.fit.discrepancy**2
    if not ring.fit.fits:
        doubt += sum(value**2 for row in mirror.flatness for value in (*row.x, *row.y))
    x, y = (float(np.hypot(each, np.sqrt(doubt))) for each in mirror.tilt_std)
    flatness = tuple(float(np.hypot(each, np.sqrt(doubt))) for each in mirror.flatness_std)
    return replace(mirror, tilt_std=(x, y), flatness_std=flatness)


def tilt_reading_variance(instrument: Autocollimator) -> float:
    """Variance of a single reading of one component by noise, resolution and turbulence, rad²."""
    slow = 0.0 if instrument.turbulence is None else instrument.turbulence.std**2
    return instrument.noise**2 + instrument.resolution**2 / 12 + slow
