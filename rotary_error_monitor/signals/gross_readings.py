"""Gross readings: single samples, or a few in a row, that are off by far more than noise and signal explain.

A contact that opens, a discharge, a motor that switches, a telegram that is read wrong: they last for milliseconds, and
behind them the signal is where it was. Each run of samples is held against the line between the sample before and the
one behind it, and against how the signal bends on both sides without the run: a signal that is as rough there, or that
does not come back, has no gross reading.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from scipy.special import bdtrc

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.signals.reading_noise import BESIDE_LINE

GROSS = 6.0
"""Standard deviations by which noise alone departs from the line between its neighbours once in 10^9 samples."""

SWINGS = 6.0
"""How many times as much as the signal bends on either side in as long a time. A smooth one, a pulse of 100 ms
or a corner does so about once."""

NOISY = 3.0
"""What normal noise bends by at most in 98 of 100 samples, standard deviations."""

LONGEST = 0.025
"""Duration, s, of a burst of gross readings; what lasts longer is something in its own right."""

FEWEST = 4
"""Samples that a run has at most where fewer come in that time: of gross readings that are 1 in 100 samples, two stand
so near that one is among the neighbours of the other."""

MOST = 0.05
"""Part of the samples beyond which they are the signal."""

PLACES = 180
"""Cells of a turn in which gross readings that recur at one place are counted: two degrees each."""

BY_CHANCE = 1e-3
"""Probability below which as many gross readings do not fall into one place of the turn by chance."""


def gross_readings(values: Array, std: float, period: float, together: bool = False) -> Mask:
    """(n, k) which readings are gross; none where they are more than `MOST` of a column.

    Args:
        values: (n, k) evenly sampled, each column a signal.
        std: standard deviation of the noise of a reading.
        period: of the samples, s.
        together: what all columns do alike is no gross reading: columns are those of instruments that see one motion.
    """
    longest = max(FEWEST, round(LONGEST / period))
    margin = 2 * longest + 1  # a run that begins in it, and as much before that
    if len(values) <= margin:
        return np.zeros(values.shape, bool)
    padded = np.pad(values, ((margin, margin), (0, 0)), mode="reflect")
    found = np.zeros(padded.shape, bool)
    for length in _lengths(longest):
        _mark(found, padded, length, std, together)
    found = found[margin:-margin]
    found = np.asarray(found & (found.mean(axis=0) <= MOST), bool)
    for column in found.T:  # a reading amid a burst that looks right is one of it by chance
        gross = np.flatnonzero(column)
        for first, last in itertools.pairwise(gross):
            if 1 < last - first <= longest:
                column[first:last] = True
    return found


def recurring(gross: Mask, angle: Array) -> Mask:
    """(n,) which gross readings come again at one place of the turn more often than by chance: a mark, not an accident.

    Args:
        gross: (n,) which readings are gross; those of one pass of a place count once.
        angle: (n,) rad, place of the turn that each reading is of.
    """
    cells = np.mod(angle * (PLACES / (2 * np.pi)), PLACES).astype(np.intp) % PLACES
    travelled = np.cumsum(np.abs(np.diff(angle, prepend=angle[:1])))[gross]
    passes = np.diff(travelled, prepend=-np.inf) > 2 * (2 * np.pi / PLACES)
    begun = np.flatnonzero(gross)[passes]
    total = len(begun)
    if total < 2:
        return np.zeros(len(gross), bool)

    def around(counts: Array) -> Array:
        """Of each cell and the next one: a place may lie on the edge of both."""
        return counts + np.roll(counts, -1)

    share = around(np.bincount(cells, minlength=PLACES) / len(cells))
    count = around(np.bincount(cells[begun], minlength=PLACES).astype(np.float64))
    marked = PLACES * bdtrc(count - 1, total, np.minimum(share, 1.0)) < BY_CHANCE
    return np.asarray(gross & (marked | np.roll(marked, 1))[cells], bool)


def _lengths(longest: int) -> list[int]:
    """Lengths of runs: a burst is found by each run that covers it and is not much longer."""
    found = [1]
    while found[-1] < longest:
        found.append(min(max(found[-1] + 1, found[-1] * 3 // 2), longest))
    return found


def _mark(found: Mask, values: Array, length: int, std: float, together: bool) -> None:
    """Mark the gross readings (n, k) in runs of one length that have as many samples beside them."""
    side = max(3, length)
    places = np.arange(side, len(values) - side - length + 1)

    def at(place: int) -> Array:
        """(runs, k) samples so many places behind the first of each run."""
        return values[places + place]

    def apart(departures: Array) -> Array:
        """Departures as none of the others has them."""
        return np.abs(departures - np.median(departures, axis=1)[:, None] if together else departures)

    def off_line(k: int) -> Array:
        return apart(at(k) - at(-1) - (at(length) - at(-1)) * ((k + 1) / (length + 1)))

    # A run that is one begins with a gross reading: of few the rest is looked at.
    begun = off_line(0) > GROSS * BESIDE_LINE * std
    places = places[begun.any(axis=1)]
    if len(places) == 0:
        return
    rough = np.maximum.reduce([apart(bend) for bend in _bends(at, length, side)])
    allowed = GROSS * BESIDE_LINE * std + SWINGS * np.maximum(rough - NOISY * std, 0.0)
    for k in range(length):
        found[places + k] |= off_line(k) > allowed


def _bends(at: Callable[[int], Array], length: int, side: int) -> Iterator[Array]:
    """How the signal bends beside runs without them, and by how much it does not come back behind them.

    It does so in as long a time as the run takes, which goes with the square of that, and in shorter ones.
    """
    before, behind = at(-1), at(length)
    first, last = at(-side), at(length + side - 1)
    over = 1
    while over <= (side - 1) // 2:
        yield at(-1 - over) - (at(-1 - 2 * over) + before) / 2
        yield at(length + over) - (behind + at(length + 2 * over)) / 2
        over *= 2
    for part in (0.25, 0.5, 0.75):
        step = round(part * (side - 1))
        yield at(-1 - step) - before - (first - before) * (step / (side - 1))
        yield at(length + step) - behind - (last - behind) * (step / (side - 1))
    yield before - at(-2) - (behind - at(-2)) / (length + 2)
    yield behind - at(length + 1) - (before - at(length + 1)) / (length + 2)
    missed = [behind - before - slope * (length + 1) / (side - 1) for slope in (before - first, last - behind)]
    yield np.where(np.abs(missed[0]) < np.abs(missed[1]), *missed)
