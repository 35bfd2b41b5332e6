"""Eccentricity and graduation of the ring from a recording of the shaft between centres (Lou et al. 2019, Figure 3).

Between centres the shaft has no error motion of its own, so all that the heads disagree in is eccentricity and
graduation of the ring. Those orders are taken that stand out from the noise, up to what the sampling tells apart; what
the recording cannot tell is left as it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, helmert

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder
from rotary_error_monitor.metrology.encoder_heads import LEAST_SEEN, seen_part
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.metrology.recording_fit import RecordingFit, judge_recording
from rotary_error_monitor.metrology.rotation_fit import (
    OrderFit,
    evaluate_orders,
    find_orders,
    fit_orders,
    significant,
    with_rounding,
)
from rotary_error_monitor.metrology.shaft_recording import (
    Observed,
    ShaftRecording,
    check_heads,
    observe,
    told_orders,
)

LEAST_NOISE = 1e-4
"""Part of the described variance that a residual's is not taken to be below: rounding in the arithmetic."""


@dataclass(frozen=True)
class RingAssembly:
    """Eccentricity (m) and graduation (rad) of the ring, with standard uncertainties.

    Attributes:
        graduation: orders that stand out or stood in the description, and that the heads see; or all that they see.
        graduation_covariance: (2 r, 2 r) of the cosines and sines of these orders, one after another, rad².
        kept: orders of the description that the recording cannot tell: removed from the readings and left as they are.
        head_offsets: reading of each head at zero less that of their mean, rad.
        highest: highest order that was looked for.
        hidden_orders: orders up to that one that these heads cannot see; they are not among `graduation`.
        fit: what the recording says against this ring.
    """

    eccentricity: tuple[float, float]
    eccentricity_std: tuple[float, float]
    graduation: tuple[AngularHarmonic, ...]
    graduation_std: tuple[tuple[float, float], ...]
    graduation_covariance: Array
    kept: tuple[AngularHarmonic, ...]
    head_offsets: tuple[float, ...]
    highest: int
    hidden_orders: tuple[int, ...]
    fit: RecordingFit


def estimate_ring_assembly(
    stage: StageDescription, recording: ShaftRecording, highest: int | None = None, *, every: bool = False
) -> RingAssembly:
    """Eccentricity and graduation from what the heads disagree in.

    The rotation at each time is unknown and drops out, and with it every order that all heads see alike. Orders are
    taken that stand out from the noise (`FALSE_ALARM`), and those that the description has and the heads see; or
    `every` order that they see, of which bounds hold the truth however small an order is.

    Args:
        stage: as described so far; its graduation of orders that cannot be told stays and is taken into account.
        recording: of the shaft between centres.
        highest: order up to which is looked; by default what the sampling tells apart.
        every: take all orders, whether they stand out or not.

    Raises:
        InputError: less than two heads, less than a whole turn, heads that stand at one place, or rotations that leave
            too much of the turn out.
    """
    readings = check_heads(stage, recording)
    azimuths = np.array([stage.azimuths[name] for name in recording.heads])
    contrasts, theta = helmert(len(azimuths)), readings.mean(axis=1)
    told = told_orders(theta, recording, highest)
    hidden = {order for order in range(1, told + 1) if seen_part(azimuths, order) < LEAST_SEEN}
    kept = tuple(row for row in stage.ring.graduation if not 2 <= row.order <= told or row.order in hidden)
    described = [row.order for row in stage.ring.graduation if row not in kept]
    if every:
        described = [order for order in range(2, told + 1) if order not in hidden]
    for limit in (1, told):  # eccentricity first: the mean of some layouts of heads is no rotation before
        psi = azimuths - theta[:, None]
        values = (readings - angular_sum(kept, psi)) @ contrasts.T
        seen = observe(theta, values, recording.reading_variances, recording.speed, recording.times)
        solved = _fit_ring(seen, azimuths, contrasts, [k for k in described if k <= limit], limit, stage.ring)
        fitted = solved.rows
        theta = (readings - angular_sum((*kept, *fitted), azimuths - readings)).mean(axis=1)
    radius, discrepancy = stage.ring.disc_radius, solved.judged.discrepancy
    std = [tuple(np.hypot(pair, discrepancy).tolist()) for pair in solved.std]
    # eccentricity e reads (-e_x sin psi + e_y cos psi) / r: it is order 1 of the graduation
    return RingAssembly(
        eccentricity=(-radius * fitted[0].sin, radius * fitted[0].cos),
        eccentricity_std=(radius * std[0][1], radius * std[0][0]),
        graduation=fitted[1:],
        graduation_std=tuple((pair[0], pair[1]) for pair in std[1:]),
        graduation_covariance=solved.covariance[2:, 2:] + discrepancy**2 * np.eye(2 * len(fitted[1:])),
        kept=kept,
        head_offsets=tuple((contrasts.T @ solved.fit.coefficients[0]).tolist()),
        highest=told,
        hidden_orders=tuple(sorted(hidden)),
        fit=solved.judged,
    )


def _pattern(azimuths: Array, contrasts: Array, order: int) -> Complex:
    """(c,) how a ring's wave of that order appears in the contrasts between heads; nothing where it is hidden."""
    if seen_part(azimuths, order) < LEAST_SEEN:
        return np.zeros(len(contrasts), dtype=np.complex128)
    return np.asarray(contrasts @ np.exp(-1j * order * azimuths))


@dataclass(frozen=True)
class _Ring:
    """The ring's waves (order 1 first), their uncertainties, all orders that were fitted, and the verdict."""

    rows: tuple[AngularHarmonic, ...]
    covariance: Array
    std: list[tuple[float, float]]
    fit: OrderFit
    judged: RecordingFit


def _fit_ring(
    seen: Observed, azimuths: Array, contrasts: Array, described: Sequence[int], told: int, encoder: Encoder
) -> _Ring:
    floor = LEAST_NOISE * float(seen.variances.mean())
    always = sorted({1, *described})

    def pattern(order: int) -> Complex:
        return _pattern(azimuths, contrasts, order)

    def fitted(orders: set[int]) -> OrderFit:
        fit = fit_orders(seen.theta, seen.values, sorted(orders), floor)
        # heads that round alike at the same place of the ring make what looks like graduation
        heads = np.sqrt(len(azimuths) / len(contrasts)) * fit.residual @ contrasts
        views = [(azimuth - seen.theta, head) for azimuth, head in zip(azimuths, heads.T, strict=True)]
        return with_rounding(fit, seen.theta, seen.variances, encoder.noise, encoder.resolution, views)

    fit = fitted(find_orders(seen.theta, seen.values, told, always, np.array([pattern(k) for k in range(1, told + 1)])))
    split = _Split(fit, {order: pattern(order) for order in fit.orders if np.any(pattern(order))})
    kept = [k for k in split.shapes if k in always or significant(*split.wave(k), fit.freedom, told)]
    beside = {k for k in fit.orders if split.beside(k, told) is not None}
    fit = fitted({*kept, *beside})
    split = _Split(fit, {order: pattern(order) for order in kept})
    waves = [split.wave(k) for k in kept]
    sizes = ((k, split.beside(k, told)) for k in fit.orders)
    return _Ring(
        tuple(AngularHarmonic(k, float(wave[0]), float(wave[1])) for k, (wave, _) in zip(kept, waves, strict=True)),
        split.covariance(kept),
        [(float(np.sqrt(spread[0, 0])), float(np.sqrt(spread[1, 1]))) for _, spread in waves],
        fit,
        judge_recording(
            seen.values - evaluate_orders(seen.theta, fit.orders, split.allowed()),
            seen.variances,
            encoder.noise**2 + encoder.resolution**2 / 12,
            seen.values.shape[1] + 2 * len(kept),
            seen.times,
            seen.speed,
            tuple((k, size) for k, size in sizes if size is not None),
        ),
    )


class _Split:
    """Fitted orders split into what a ring's waves can make and what stands beside it, by generalised least squares.

    Attributes:
        shapes: (c,) amplitudes by channel of a unit wave, for the orders that the ring has; others are free.
    """

    def __init__(self, fit: OrderFit, shapes: Mapping[int, Complex]) -> None:
        self._fit, self.shapes = fit, shapes
        channels = fit.coefficients.shape[1]
        # cos and sin of order k of the graduation are cos(k psi) and sin(k psi), psi = azimuth - theta
        ring = {
            k: np.block([[w.real[:, None], -w.imag[:, None]], [-w.imag[:, None], -w.real[:, None]]])
            for k, w in shapes.items()
        }
        design = block_diag(*(ring.get(k, np.eye(2 * channels)) for k in fit.orders))
        self._covariance = fit.covariance()
        weighted = np.linalg.solve(self._covariance, design)
        self._spread = np.linalg.inv(design.T @ weighted)
        self._measured = fit.coefficients[1:].ravel()
        self._solution = self._spread @ (weighted.T @ self._measured)
        self._rest = self._measured - design @ self._solution
        self._rest_covariance = self._covariance - design @ self._spread @ design.T
        self._allowed = design @ self._solution
        widths = [2 if k in shapes else 2 * channels for k in fit.orders]
        ends = np.cumsum(widths)
        self._columns = {k: slice(end - width, end) for k, end, width in zip(fit.orders, ends, widths, strict=True)}

    def wave(self, order: int) -> tuple[Array, Array]:
        """(2,) cosine and sine of the graduation, and their covariance (2, 2)."""
        at = self._columns[order]
        return self._solution[at], self._spread[at, at]

    def covariance(self, orders: Sequence[int]) -> Array:
        """(2 k, 2 k) of cosine and sine of the graduation of so many orders, one after another."""
        at = np.concatenate([np.arange(2) + self._columns[order].start for order in orders])
        return np.asarray(self._spread[np.ix_(at, at)])

    def beside(self, order: int, tried: int) -> float | None:
        """Amplitude in a contrast between heads of what no ring makes at this order, rad; None if noise explains it."""
        at, channels = self._fit.place(order), self._fit.coefficients.shape[1]
        if order not in self.shapes:
            value, spread, freedom = self._measured[at], self._covariance[at, at], 2 * channels
        else:
            value, spread, freedom = self._rest[at], self._rest_covariance[at, at], 2 * channels - 2
        if freedom == 0:
            return None
        sizes, axes = np.linalg.eigh(spread)
        along = (axes.T @ value)[-freedom:]
        if not significant(along, np.diag(sizes[-freedom:]), self._fit.freedom, tried):
            return None
        return float(np.linalg.norm(value) / np.sqrt(channels))

    def allowed(self) -> Array:
        """(1 + 2 k, c) coefficients of the constant and of what the ring makes."""
        found = self._fit.coefficients.copy()
        found[1:] = self._allowed.reshape(found[1:].shape)
        for order in self._fit.orders:
            if order not in self.shapes:
                at = 1 + 2 * self._fit.orders.index(order)
                found[at : at + 2] = 0.0
        return found
