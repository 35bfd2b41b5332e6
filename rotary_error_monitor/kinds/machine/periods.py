"""Periods of a linear axis: the wave along its positions that explains most, and what its search costs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.machine_effect import LINEAR
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.orders import trials_of_waves

PERIODS = (2e-3, 0.5)
"""Shortest and longest period of a cyclic error that is searched, m."""

CELL = 0.05
"""Part of the shortest period within which positions are one place: a wave changes there by less than a third."""

SHOWN = 0.04
"""Part of its power that a phase of a wave must show at the positions: one that shows less would be five times as large
as what is seen of it."""

FEWEST_PLACES = 6
"""Places of an axis from which on a wave along it can be told.

Its cosine, sine and period describe whatever an axis does at three places, beside an offset of the set-up at four. At
five one number is left to test them, which some of hundreds of periods fit whatever it is.
"""

ComplexArray = NDArray[np.complex128]


def count_places(position: Array) -> int:
    """Number of different places among positions (n,), m."""
    return 1 + int(np.count_nonzero(np.diff(np.sort(position)) > CELL * PERIODS[0])) if len(position) else 0


def told_at_few_places(machine: MachineDescription, positions: Array) -> list[str]:
    """Remarks on linear axes of which no period is looked for, from positions (n, axes)."""
    axes = zip(machine.axes, positions.T, strict=True)
    places = {axis.letter: count_places(position) for axis, position in axes if axis.kind == LINEAR}
    return [
        f"{letter} stood at {count} places: a cyclic error of it is not looked for, and what is named may be one; "
        f"probe at {FEWEST_PLACES} or more"
        for letter, count in places.items()
        if 1 < count < FEWEST_PLACES
    ]


def find_period(position: Array, signal: Array, tests: int) -> tuple[float, float]:
    """Period, m, of the wave that explains most of a signal at positions, and among how many it was found.

    Args:
        position: (n,) m, at two places or more.
        signal: (n,) white values.
        tests: how many effects and places share the rate of false alarms with it.
    """
    lowest, highest = 1 / PERIODS[1], 1 / PERIODS[0]
    independent = max(float(np.ptp(position)) * (highest - lowest), 1.0)
    alarming = float(np.log(0.5 * FALSE_ALARMS / (independent * tests)))
    return 1 / find_frequency(position, signal, lowest, highest), trials_of_waves(independent, alarming)


def find_frequency(position: Array, signal: Array, lowest: float, highest: float) -> float:
    """Frequency, 1/m, of the wave that explains most of a signal beside an offset, at positions wherever they are.

    At evenly spaced positions many a wave is the same everywhere, as an offset of the set-up is. The signal is first
    summed into cells a twentieth of the shortest wave wide, so that one fast transform sees all frequencies a fifth of
    the resolution apart; near the best of them the positions count as they are.
    """
    span, centred = float(np.ptp(position)), signal - signal.mean()
    width = CELL / highest
    cells = ((position - position.min()) / width).astype(np.intp)
    length = int(2 ** np.ceil(np.log2(5 * span / width)))
    places = np.arange(1 + int(highest * length * width))
    at, waves = _sums(cells.tobytes(), length, 2 * len(places)), np.fft.rfft(np.bincount(cells, centred), length)
    frequencies = places / (length * width)
    gains = _explained(waves[places], at[places], at[2 * places], len(position))
    allowed = frequencies >= lowest
    best = float(frequencies[int(np.argmax(np.where(allowed, gains, -1.0)))])
    fine = np.clip(best + np.linspace(-0.2, 0.2, 41) / span, lowest, highest)
    exact = np.exp(-2j * np.pi * np.outer(fine, position))
    gains = _explained(exact @ centred, exact.sum(axis=1), np.square(exact).sum(axis=1), len(position))
    return float(fine[int(np.argmax(gains))])


@lru_cache(maxsize=8)
def _sums(cells: bytes, length: int, count: int) -> ComplexArray:
    """(count,) sums of the slowest waves over all positions, from the numbers of the cells in which these are.

    Kept, because effect after effect and fit after fit is looked for at the same positions.
    """
    found: ComplexArray = np.fft.rfft(np.bincount(np.frombuffer(cells, np.intp)), length)[:count].copy()
    found.flags.writeable = False
    return found


def _explained(rows: ComplexArray, once: ComplexArray, twice: ComplexArray, count: int) -> Array:
    """Squares that waves explain of a signal without mean beside an offset (Zechmeister and Kürster 2009).

    Args:
        rows: sums of the signal times each wave.
        once: sums of each wave.
        twice: sums of the wave of half its period.
        count: number of positions.
    """
    own, mixed = count - np.square(np.abs(once)) / count, twice - np.square(once) / count
    turned = rows * np.exp(-0.5j * np.angle(mixed))
    more, less = 0.5 * (own + np.abs(mixed)), 0.5 * (own - np.abs(mixed))
    least = 0.5 * SHOWN * count
    gains = np.zeros(len(own))
    for part, shown in ((turned.real, more), (turned.imag, less)):
        gains += np.divide(np.square(part), shown, out=np.zeros(len(own)), where=shown > least)
    return gains
