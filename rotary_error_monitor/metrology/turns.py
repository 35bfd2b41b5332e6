"""Error motion over whole turns: cut out, brought to equal angles, and filtered over the angle (ISO 230-7, 4.4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[np.float64]
TURN = 2 * math.pi

MOST_WAVES = 150
"""Cut-off of the filter over the angle, waves a turn, where there are samples enough: the usual series of roundness
instruments is 15, 50, 150, 500 (ISO 12181-2), and with 150 the 18th order still comes out whole to 1 %."""

SAMPLES_A_WAVE = 7
"""Samples in a wave of the cut-off, at least (ISO 12181-2)."""

LEAST_WAVES = 3
"""Cut-off below which a profile shows no order that matters."""

ANGLES_A_WAVE = 4
"""Angles in a wave of the cut-off at which a profile is given."""

_HALF = math.sqrt(math.log(2) / 2) / math.pi
"""Standard deviation of a Gaussian, in waves, that lets half of the amplitude through (ISO 16610-21)."""


@dataclass(frozen=True)
class TurnProfiles:
    """c signals over n whole turns in one direction.

    Attributes:
        profiles: (n, k, c) values at k equal angles from 0 on, filtered; in the signals' units.
        cut_off: waves a turn of which the filter lets half of the amplitude through.
        samples: samples in a turn, the mean.
        rows: (n, 2) first and last sample of each turn.
        edges: (n,) number of the angle at which each turn is cut: before it another turn begins, or ends.
        incomplete: whole turns that are left out, for samples are missing in them.
        whole: turns that the runs would hold if they were joined: also where no whole turn is in one of them.
    """

    profiles: Array
    cut_off: int
    samples: float
    rows: NDArray[np.intp]
    edges: NDArray[np.intp]
    incomplete: int
    whole: float

    @staticmethod
    def none() -> TurnProfiles:
        """No turn of no signal."""
        return TurnProfiles(np.empty((0, 0, 0)), 0, 0.0, np.empty((0, 2), np.intp), np.empty(0, np.intp), 0, 0.0)

    @property
    def angles(self) -> Array:
        """(k,) angles of the profiles, rad."""
        return np.asarray(np.arange(self.profiles.shape[1]) * (TURN / self.profiles.shape[1]))

    @cached_property
    def transmission(self) -> Array:
        """(k // 2 + 1,) part of the amplitude of each order from 0 on that the filter lets through."""
        orders = np.arange(self.profiles.shape[1] // 2 + 1)
        return np.asarray(np.exp(-math.log(2) * (orders / self.cut_off) ** 2))


def cut_turns(
    theta: Array, values: Array, runs: Sequence[tuple[int, int]], most_waves: int = MOST_WAVES
) -> TurnProfiles | None:
    """Whole turns of signals; None where samples are too few for a profile.

    Parts of a turn at the end of a run do not count. A turn in which samples are missing over more than half a wave of
    the cut-off is left out. Values between samples are interpolated in a straight line.

    Args:
        theta: (m,) rotation, rad, unwrapped.
        values: (m, c) signals; a row that is not finite is a missing sample.
        runs: first sample and the one after the last of each stretch in one and the same direction.
        most_waves: cut-off of the filter over the angle, waves a turn; less where samples are few.
    """
    there = np.asarray(np.isfinite(values).all(axis=1))
    chosen = [np.arange(first, last)[there[first:last]] for first, last in runs]
    chosen = [each for each in chosen if len(each) > 1]
    spans = [abs(float(theta[each[-1]] - theta[each[0]])) for each in chosen]
    whole = sum(spans) / TURN
    if not whole > 0:
        return None
    samples = float(np.median([len(each) / span for each, span in zip(chosen, spans, strict=True)])) * TURN
    cut_off = min(most_waves, int(samples / SAMPLES_A_WAVE))
    if cut_off < LEAST_WAVES:
        return None
    count = ANGLES_A_WAVE * cut_off
    fine = max(1, math.ceil(samples / count))
    turns: list[Array] = []
    places: list[NDArray[np.intp]] = []
    edges: list[int] = []
    incomplete = 0
    for rows in chosen:
        for profile, ends, edge in _turns(theta[rows], values[rows], count, fine, cut_off):
            if profile is None:
                incomplete += 1
                continue
            turns.append(profile)
            places.append(rows[ends])
            edges.append(edge)
    profiles = np.stack(turns) if turns else np.empty((0, count, values.shape[1]))
    ends = np.stack(places) if places else np.empty((0, 2), np.intp)
    return TurnProfiles(profiles, cut_off, samples, ends, np.array(edges, np.intp), incomplete, whole)


def _turns(
    theta: Array, values: Array, count: int, fine: int, cut_off: int
) -> Iterator[tuple[Array | None, NDArray[np.intp], int]]:
    """Profile (count, c) of each whole turn of a run, None of one with a gap; first and last sample (2,); its edge."""
    sense = 1 if theta[-1] > theta[0] else -1
    angle = np.maximum.accumulate(sense * theta)  # its jitter may turn back where the rotor hardly moves
    points = count * fine
    step = TURN / points
    first, last = math.ceil(angle[0] / step), math.floor(angle[-1] / step)
    if last - first + 1 < points:
        return
    places = np.arange(first, last + 1)
    after = np.clip(np.searchsorted(angle, places * step), 1, len(angle) - 1)
    gap = angle[after] - angle[after - 1] > TURN / (2 * cut_off)
    even = np.stack([np.interp(places * step, angle, column) for column in values.T], axis=1)
    smooth = gaussian_filter1d(even, _HALF * points / cut_off, axis=0, mode="nearest")
    for begin in range(0, len(places) - points + 1, points):
        here = slice(begin, begin + points)
        edges = np.array([places[begin], places[begin] + points]) * step
        ends = np.asarray(np.searchsorted(angle, edges) - np.array([0, 1]), np.intp)
        if gap[here].any():
            yield None, ends, 0
            continue
        on = here.start + (-places[begin]) % fine + fine * np.arange(count)
        on = np.where(on >= here.stop, on - points, on)
        number = (places[on] // fine) % count
        profile = np.empty((count, values.shape[1]))
        profile[number if sense > 0 else (-number) % count] = smooth[on]
        yield profile, ends, int(number[0] if sense > 0 else (1 - number[0]) % count)
