"""The rotor's own motion about the command, which all heads see alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import gamma

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.noise.whitening import predictor, segments_of


@dataclass(frozen=True)
class Jitter:
    """Spectrum of the rotor's motion about the command: `std^2` spread over frequencies below about `bandwidth`.

    The one-sided density is `A exp(-(f / bandwidth)^shape)`, smooth and falling as that of a rotor's inertia.

    Attributes:
        in_motion: how many times as large it is while the rotor turns: a brake holds it at rest.
        at_rest: the same while it is commanded to stand, where friction may have the drive hunt.
        is_held: whether a brake holds the rotor at each stop where the jitter had it.
    """

    std: float = 2e-6
    bandwidth: float = 5.0
    shape: float = 1.2
    in_motion: float = 1.0
    at_rest: float = 1.0
    is_held: bool = False

    def times(self, factor: float) -> Jitter:
        """So many times as large, all the time."""
        return replace(self, std=self.std * factor, in_motion=1.0, at_rest=1.0, is_held=False)

    def density(self, frequency: Array) -> Array:
        """(n,) one-sided power density over the whole recording, rad^2/Hz."""
        area = self.bandwidth * gamma(1 + 1 / self.shape)
        exponent = self.shape * np.log(np.maximum(frequency, 1e-9) / self.bandwidth)
        power = np.exp(np.minimum(exponent, 6.4))
        return np.asarray(self.std**2 / area * np.exp(-power), np.float64)


class JitterFilter:
    """Makes what the heads share white: the jitter, in motion and at rest as large as there, and the readings' noise.

    Args:
        jitter: of the rotor.
        floor: one-sided density of the readings' noise, rad^2/Hz.
        period: between samples, s.
        moving: (m,) whether the rotor is commanded to turn.

    Attributes:
        held: what standing off by the jitter's standard deviation is at a stop in each white row.
        unforeseen: standard deviation of what is new in a reading at rest, which is one in its white row, rad.
        part_of_floor: of the variance of a white row in motion, of the readings' noise.
    """

    def __init__(self, jitter: Jitter, floor: float, period: float, moving: Mask) -> None:
        sizes = dict.fromkeys((jitter.in_motion, jitter.at_rest))
        self._at_rest, self._is_held = ~moving, jitter.is_held
        self._whiteners = [predictor(_with_floor(jitter.times(size), floor), period) for size in sizes]
        taps = self._whiteners[-1].taps
        self.held = jitter.std * jitter.in_motion * float(np.sum(taps))
        self.unforeseen = 1 / float(taps[0])
        self.part_of_floor = floor / (2 * period) * float(np.sum(np.square(self._whiteners[0].taps)))

    def apply(self, rows: Array, segments: list[slice]) -> Array:
        """White rows (m, p), each segment filtered on its own.

        A brake stops the jitter at once, which no filter foresees: what is before and after is filtered on its own too.
        """
        if self._is_held:
            segments = [part for segment in segments for part in _without_changes(segment, self._at_rest)]
        white = self._whiteners[0].apply(rows, segments)
        for whitener in self._whiteners[1:]:
            white[self._at_rest] = whitener.apply(rows, segments)[self._at_rest]
        return white

    def without_holds(self, rows: Array, weight: Array) -> Array:
        """White rows (m, p) once those of a stop that share what it was held at are white as well.

        Args:
            rows: white but for that, each times its weight.
            weight: (m,).
        """
        if self._is_held:
            for stop, along, variance in holds(self._at_rest, weight, self.held):
                rows[stop] -= (1 - 1 / np.sqrt(variance)) * along[:, None] * (along @ rows[stop])
        return rows


def holds(at_rest: Mask, weight: Array, held: float) -> Iterator[tuple[slice, Array, float]]:
    """Rows of each stop, their weights (k,) as a vector of length one, and the variance of rows along it if it is held.

    Args:
        at_rest: (m,) whether the rotor is commanded to stand.
        weight: (m,) of the rows.
        held: standard deviation of what a hold adds to each row of weight one.
    """
    for stop in segments_of(at_rest):
        squares = float(np.sum(np.square(weight[stop])))
        if squares > 0:
            yield stop, weight[stop] / np.sqrt(squares), 1 + squares * held**2


def _without_changes(segment: slice, state: Mask) -> list[slice]:
    """Parts of a segment within each of which a state (m,) is the same."""
    edges = 1 + segment.start + np.flatnonzero(np.diff(state[segment]))
    return [slice(int(a), int(b)) for a, b in pairwise([segment.start, *edges, segment.stop])]


def _with_floor(jitter: Jitter, floor: float) -> Callable[[Array], Array]:
    return lambda frequency: jitter.density(frequency) + floor
