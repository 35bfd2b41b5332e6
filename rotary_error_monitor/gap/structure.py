"""Is anything left but noise? Tests of white rows against every kind of structure that a machine can leave.

A test never asks for a known effect: it asks whether rows depend on the place of the rotor, on its orders under each
condition, on time, or hold a line in frequency. All chances are combined by Bonferroni, so the rate of false findings
is kept however the tests overlap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.orders import Angles
from rotary_error_monitor.gap.p_values import chi_square_median, log_chi_square_tail, log_normal_tail
from rotary_error_monitor.gap.problem import StructureTest

MODELLED_ORDERS = 16
"""Orders looked for under each condition."""

LINE_ORDERS = 200
PLACES = 180
SECONDS = 0.5

BAND = 64
"""Neighbouring frequencies from which the level of noise is told."""

HIGHEST_LEVEL = 4.0
"""Times white noise up to which a broad band is taken for coloured noise; above it is structure."""


_Part = tuple[slice | NDArray[np.intp], Angles]
"""Which rows, and their angles."""


@dataclass(frozen=True)
class Track:
    """Rows of one channel with what they may depend on.

    Attributes:
        channel: name.
        rows: (n,) white rows of variance one.
        time: (n,) s.
        angle: (n,) rotation, rad.
        labels: (n,) condition of each row.
        names: of the conditions.
        keeps: whether what does not depend on the rows is kept, for the next rows at the same instants.
    """

    channel: str
    rows: Array
    time: Array
    angle: Array
    labels: NDArray[np.intp]
    names: Sequence[str]
    keeps: bool = False
    _kept: dict[int | None, _Part] = field(default_factory=dict, repr=False, compare=False)

    def part(self, label: int | None = None) -> _Part:
        """Rows under one condition, or all."""
        found = self._kept.get(label)
        if found is None:
            chosen = slice(None) if label is None else np.flatnonzero(self.labels == label)
            found = chosen, Angles(self.angle[chosen])
            if self.keeps:
                self._kept[label] = found
        return found

    @cached_property
    def spectrum(self) -> Array:
        """(`LINE_ORDERS`,) squares that each order explains."""
        return self.part()[1].spectrum(self.rows, LINE_ORDERS)


def find_structure(track: Track) -> list[StructureTest]:
    """All tests of one channel."""
    tests: list[Callable[[Track], StructureTest]] = [_orders, _line, _frequency, _place, _time]
    return [test(track) for test in tests]


def find_shared(tracks: Sequence[Track], independent: int) -> list[StructureTest]:
    """Orders that several channels hold, too weak to be seen in any one of them.

    Args:
        tracks: the channels.
        independent: how many of the channels' rows are independent: of heads against their mean one less than all.

    Returns:
        That of one order, the strongest, and that of the modelled ones together.
    """
    each = np.stack([track.spectrum for track in tracks])
    power = each.sum(axis=0) * independent / len(tracks)
    dof = 2 * independent
    noise = float(np.median(power[MODELLED_ORDERS : 3 * MODELLED_ORDERS]) / chi_square_median(dof))

    def finding(kind: str, order: int, reduction: float, dof: int, trials: int) -> StructureTest:
        loudest = tracks[int(np.argmax(each[:, order]))].channel
        chance = _log_any(log_chi_square_tail(reduction, dof), trials)
        return StructureTest(
            loudest, kind, chance, max(0.0, reduction - dof), f"angle: order {order + 1} in {len(tracks)} channels"
        )

    reduction, rank = 0.0, 0
    for track in tracks:
        angles = track.part()[1]
        moments = angles.moments(track.rows, MODELLED_ORDERS)
        part, dimension = angles.explained(moments, MODELLED_ORDERS, 1)
        reduction, rank = reduction + part * independent / len(tracks), max(rank, dimension)
    best, strongest = int(np.argmax(power)), int(np.argmax(power[:MODELLED_ORDERS]))
    return [
        finding("shared line", best, float(power[best]), dof, len(power)),
        finding("shared orders", strongest, reduction / max(1.0, noise), rank * independent, 1),
    ]


def _log_any(log_p_value: float, trials: int) -> float:
    """Logarithm of the chance that the largest of many independent tests reaches this."""
    return min(0.0, log_p_value + float(np.log(trials)))


def _orders(track: Track) -> StructureTest:
    """Orders 0 to 16 under each condition, beside the noise of the orders above."""
    reduction, dof, best, words = 0.0, 0, 0.0, "nothing"
    for label, name in enumerate(track.names):
        chosen, angles = track.part(label)
        rows = track.rows[chosen]
        if len(rows) < 4 * MODELLED_ORDERS:
            continue
        moments = angles.moments(rows, MODELLED_ORDERS)
        part, dimension = angles.explained(moments, MODELLED_ORDERS)
        alone = moments**2 / np.maximum(angles.squares(MODELLED_ORDERS), 1e-12)
        each = alone[: MODELLED_ORDERS + 1] + np.append(0.0, alone[MODELLED_ORDERS + 1 :])
        floor = max(1.0, _noise_above(angles, rows))
        reduction, dof = reduction + part / floor, dof + dimension
        if np.max(each) / floor > best:
            best, words = np.max(each) / floor, f"order {int(np.argmax(each))} at {name}"
    return StructureTest(
        track.channel,
        "orders",
        log_chi_square_tail(reduction, max(dof, 1)),
        max(0.0, reduction - dof),
        f"angle: {words}",
    )


def _noise_above(angles: Angles, rows: Array) -> float:
    """Noise level at orders just above the modelled ones; rounding of a slowly turning ring is not quite white."""
    sums = angles.sums(rows, 3 * MODELLED_ORDERS)[MODELLED_ORDERS + 1 :]
    power = np.square(np.concatenate([sums.real, sums.imag])) * 2 / len(rows)
    return float(np.median(power) / chi_square_median(1))


def _line(track: Track) -> StructureTest:
    """One order, up to 200, over the whole recording."""
    power = track.spectrum
    order = int(np.argmax(power)) + 1
    best = float(power[order - 1])
    log_p_value = _log_any(-best / 2, LINE_ORDERS)
    return StructureTest(track.channel, "line", log_p_value, max(0.0, best - 2), f"angle: order {order}")


def _frequency(track: Track) -> StructureTest:
    """One frequency, whatever the speed.

    It must stand out of the frequencies around it: at constant speed rounding repeats itself, and jitter smears that
    into a broad band that is noise.
    """
    period = float(np.median(np.diff(track.time)))
    index = np.rint((track.time - track.time[0]) / period).astype(np.intp)
    # A few zeros at the end: with a large prime as its length the transform takes ten times as long.
    even = np.bincount(index, track.rows, minlength=next_fast_len(int(index[-1]) + 1, real=True))
    power = 2 * np.abs(np.fft.rfft(even)[1:]) ** 2 / len(track.rows)
    power /= np.clip(_level_around(power), 1.0, HIGHEST_LEVEL)
    best = int(np.argmax(power))
    frequency = (best + 1) / (len(even) * period)
    log_p_value = _log_any(-float(power[best]) / 2, len(power))
    return StructureTest(
        track.channel, "frequency", log_p_value, max(0.0, float(power[best]) - 2), f"time: line at {frequency:.2f} Hz"
    )


def _level_around(power: Array) -> Array:
    """Level of a spectrum of squares with two degrees of freedom around each frequency, 1 for white noise."""
    whole = len(power) // BAND * BAND
    if whole == 0:
        return np.ones(len(power))
    levels = np.median(power[:whole].reshape(-1, BAND), axis=1) / (2 * np.log(2.0))
    return np.asarray(np.concatenate([np.repeat(levels, BAND), np.full(len(power) - whole, levels[-1])]), np.float64)


def _place(track: Track) -> StructureTest:
    """One place on the circle, two degrees wide."""
    cell = (np.mod(track.angle, 2 * np.pi) * PLACES / (2 * np.pi)).astype(np.intp) % PLACES
    return _of_cells(track, "place", cell, PLACES, lambda best: f"angle: place {(best + 0.5) * 360 / PLACES:.0f}°")


def _time(track: Track) -> StructureTest:
    """One moment, half a second wide."""
    begin = track.time[0]
    cell = ((track.time - begin) / SECONDS).astype(np.intp)
    count = int(cell[-1]) + 1
    return _of_cells(track, "time", cell, count, lambda best: f"time: at {begin + (best + 0.5) * SECONDS:.1f} s")


def _of_cells(
    track: Track, kind: str, cell: NDArray[np.intp], count: int, words: Callable[[int], str]
) -> StructureTest:
    """The one of `count` cells, into which rows fall by `cell` (n,), whose mean is farthest from zero."""
    z, used = _means(cell, track.rows, count)
    best = int(np.argmax(np.abs(z)))
    log_p_value = _log_any(log_normal_tail(abs(float(z[best]))) + float(np.log(2)), used)
    return StructureTest(track.channel, kind, log_p_value, max(0.0, float(z[best]) ** 2 - 1), words(best))


def _means(cell: NDArray[np.intp], rows: Array, cells: int) -> tuple[Array, int]:
    """Standardised mean of each cell; cells with few rows are left out, their rows are not yet normal."""
    count = np.bincount(cell, minlength=cells)
    z = np.where(count >= 10, np.bincount(cell, rows, minlength=cells) / np.sqrt(np.maximum(count, 1)), 0.0)
    return z, max(int(np.count_nonzero(count >= 10)), 1)
