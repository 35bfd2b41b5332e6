"""What the ticks of an estimate say about its inputs, gathered in windows of equal length that stand fixed in time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array

Number = TypeVar("Number", float, list[float])
"""Of one window a number, of several a list of one for each."""

WINDOW_NS = 10_000_000
"""Length of a window, ns: a tenth of the time after which what is published has to be right again."""

SHORT, LONG = 10, 100
"""Windows over which what is seen in one is averaged beside it: 0.1 s and 1 s."""

AGREEMENT = 0.5
"""How long inputs that were doubted must agree before they are believed again, s."""

SIGMAS = 6.0
"""Standard deviations that noise does not reach in years."""

PERSISTENT = 3
"""Windows out of the last `SHORT` in which something is beyond its limit that make it more than a passing glitch."""

MUCH_FASTER = 2.0
"""Times the samples of one head over those of another from which what interpolation of the slow one misses, the fast
one shows: at even rates all miss nearly as much at once."""


class Means(NamedTuple, Generic[Number]):
    """Means over a window of what its ticks say; its fields are the columns of `Evidence`."""

    theta: Number  # rad
    heads: Number  # whether the heads tell the rotation
    radial: Number  # whether both radial components are seen
    head_samples: Number  # independent samples of a head behind one tick, at most 1
    agreement: Number  # chi-square of the heads that are there over its degrees of freedom
    believed_agreement: Number  # the same of those that are believed
    command: Number  # whether there is a command
    turns: Number  # whole turns between rotation and command
    ecc: Number  # rotation minus command, rad, within half a turn
    head_bend: Number  # third difference of the samples around a tick, mean of the heads, rad; 0 for a fit
    command_bend: Number  # the same of the command
    centre_x: Number  # of the ring, m
    centre_y: Number
    surplus_x: Number  # centre less all that the description predicts of it, m, as far as the heads see it
    surplus_y: Number
    described_x: Number  # error motion that the description predicts, m, as far as the heads see it
    described_y: Number
    radial_variance: Number  # m²
    tilt: Number  # whether there is a tilt
    tilt_samples: Number  # independent samples behind one tick, at most 1
    tilt_x: Number  # of the mirror, rad
    tilt_y: Number
    tilt_surplus_x: Number  # tilt less all that the description predicts of it, rad
    tilt_surplus_y: Number
    tilt_variance: Number  # rad²
    commanded: Number  # whether the command alone tells the rotation, of a stage without heads
    velocity: Number  # of the command that does, rad/s


COLUMNS = Means._fields
INDEX = {name: place for place, name in enumerate(COLUMNS)}
TILT = INDEX["tilt_x"], INDEX["tilt_y"]
"""Columns of the tilt of the mirror."""
_PLACES = {name.removesuffix("_x"): at for name, at in INDEX.items() if name.endswith("_x")}

ALWAYS = 1.0 - 1e-9
"""Mean of a column of zeros and ones from which all of them were ones."""


class Scatter(NamedTuple, Generic[Number]):
    """Standard deviations of ticks about a straight line: a ripple in step with the windows does not show in means."""

    ecc: Number
    tilt_surplus_x: Number
    tilt_surplus_y: Number


SCATTERING = Scatter._fields
_SCATTERING = [INDEX[name] for name in SCATTERING]


def are_uneven(rates: Sequence[float]) -> bool:
    """Whether heads with so many samples per s miss different parts of what the rotation does between samples."""
    return len(rates) > 1 and max(rates) > MUCH_FASTER * min(rates)


class Reach(NamedTuple):
    """Where a vector in the plane can be next: no component further from the middle than `reach`."""

    x: float
    y: float
    reach: float


EVERYWHERE = Reach(0.0, 0.0, math.inf)


@dataclass(frozen=True)
class Evidence:
    """What m ticks say.

    Attributes:
        ticks: (m,) number of each tick on the grid of the estimate.
        values: (m, k) one column for each name in `COLUMNS`.
        parity: (m, h) contradiction of the heads that are there, in their order, rad; zero where there is none.
        available: (m,) bit mask of the streams that are there.
        heard: (m,) the same of those as well that are not believed.
        readings: (m, P) what the instruments read, where the command alone tells the rotation.
    """

    ticks: NDArray[np.int64]
    values: Array
    parity: Array
    available: NDArray[np.int64]
    heard: NDArray[np.int64]
    readings: Array

    def part(self, chosen: slice) -> Evidence:
        """The same of some of the ticks."""
        return Evidence(*(each[chosen] for each in self._arrays()))

    def followed_by(self, other: Evidence) -> Evidence:
        """Both, one after the other."""
        return Evidence(*(np.concatenate(pair) for pair in zip(self._arrays(), other._arrays(), strict=True)))

    def _arrays(self) -> tuple[Any, ...]:
        return tuple(vars(self).values())


class EvidenceWindow(NamedTuple):
    """Means of the evidence over one window.

    Attributes:
        number: of the window on its grid.
        duration: s.
        ticks: in it.
        mean: of each column.
        scatter: standard deviation of the ticks about a straight line, of each column in `SCATTERING`.
        parity: (h,) mean of the contradiction, rad.
        available: streams that were there all the time, as a bit mask.
        steady: whether the same streams were there all the time.
        broken: streams that were heard at some of its ticks and not at others, as a bit mask.
        readings: (P,) mean of what the instruments read, as in `Evidence`.
    """

    number: int
    duration: float
    ticks: int
    mean: Means[float]
    scatter: Scatter[float]
    parity: Array
    available: int
    steady: bool
    broken: int = 0
    readings: Array = np.empty(0)

    def pair(self, name: str) -> tuple[float, float]:
        """Both components of a vector in the plane."""
        place = _PLACES[name]
        return self.mean[place], self.mean[place + 1]

    def vector(self, name: str) -> complex:
        """The same as `x + 1j * y`."""
        return complex(*self.pair(name))

    def has(self, what: str) -> bool:
        """Whether `what` (heads, commanded, radial, command, tilt) was there at every tick."""
        return self.mean[INDEX[what]] > ALWAYS

    @property
    def tells_rotation(self) -> bool:
        """Whether the rotation was known at every tick."""
        return self.mean.heads > ALWAYS or self.mean.commanded > ALWAYS


@dataclass(frozen=True)
class Windows:
    """Windows one behind another, as columns: what `EvidenceWindow` says of one, of n of them.

    Attributes:
        first: number of the first on its grid.
        duration, ticks: of each.
        mean, scatter: (n,) for each of their fields.
        parity: (n, h), readings: (n, P), available, steady, broken: (n,) as of `EvidenceWindow`.
    """

    first: int
    duration: float
    ticks: int
    mean: Means[list[float]]
    scatter: Scatter[list[float]]
    parity: Array
    available: Sequence[int]
    steady: Sequence[bool]
    broken: Sequence[int]
    readings: Array

    def __len__(self) -> int:
        return len(self.steady)

    def __getitem__(self, place: int) -> EvidenceWindow:
        """One of them; its arrays are views."""
        place = range(len(self))[place]
        mean = Means._make([column[place] for column in self.mean])
        scatter = Scatter._make([column[place] for column in self.scatter])
        parity, readings = self.parity[place], self.readings[place]
        masks = self.available[place], self.steady[place], self.broken[place]
        return EvidenceWindow(self.first + place, self.duration, self.ticks, mean, scatter, parity, *masks, readings)

    @cached_property
    def last(self) -> EvidenceWindow:
        """The last of them."""
        return self[-1]

    @property
    def numbers(self) -> range:
        """(n,) of each on its grid."""
        return range(self.first, self.first + len(self))

    def part(self, begin: int, end: int) -> Windows:
        """Those from a place to before another."""
        chosen = slice(begin, end)
        mean: Means[list[float]] = Means._make([column[chosen] for column in self.mean])
        scatter: Scatter[list[float]] = Scatter._make([column[chosen] for column in self.scatter])
        masks = self.available[chosen], self.steady[chosen], self.broken[chosen]
        arrays = self.parity[chosen], *masks, self.readings[chosen]
        return Windows(self.first + begin, self.duration, self.ticks, mean, scatter, *arrays)

    def up_to_measurements(self) -> Iterator[Windows]:
        """The same in parts, each up to a window in which judges measure: its number is a multiple of `SHORT`."""
        begin = 0
        while begin < len(self):
            end = min(begin + 1 + -(self.first + begin) % SHORT, len(self))
            yield self.part(begin, end)
            begin = end

    def pairs(self, name: str) -> list[tuple[float, float]]:
        """(n,) both components of a vector in the plane."""
        place = _PLACES[name]
        return list(zip(self.mean[place], self.mean[place + 1], strict=True))

    def vectors(self, name: str) -> list[complex]:
        """(n,) the same as `x + 1j * y`."""
        place = _PLACES[name]
        return list(map(complex, self.mean[place], self.mean[place + 1]))

    @property
    def are_whole(self) -> bool:
        """Whether the same streams were there at every tick, and told all of rotation, centre, command and tilt."""
        mean = self.mean
        there = min(map(min, (mean.heads, mean.radial, mean.command, mean.tilt)))
        same = self.available.count(self.available[0]) == len(self)
        return same and all(self.steady) and there > ALWAYS and not any(mean.turns)


class WindowGrid:
    """Cuts ticks into windows."""

    def __init__(self, period_ns: int) -> None:
        """Windows of ticks that are `period_ns` apart; of a single tick where that is longer than a window."""
        self.ticks = max(1, WINDOW_NS // period_ns)
        self.duration = self.ticks * period_ns * 1e-9

    def number(self, tick: int) -> int:
        """The window in which a tick lies."""
        return tick // self.ticks

    def summarise(self, evidence: Evidence) -> Windows:
        """Windows of evidence that holds whole ones only."""
        count = len(evidence.ticks) // self.ticks
        # over the middle axis numpy adds one after another: the same bits however many windows there are
        values = evidence.values.reshape(count, self.ticks, len(COLUMNS))
        means = (values.sum(axis=1) / self.ticks).T.tolist()
        scatter = self._scatter(values[:, :, _SCATTERING]).T.tolist()
        parity, readings = (
            each.reshape(count, self.ticks, each.shape[1]).sum(axis=1) / self.ticks
            for each in (evidence.parity, evidence.readings)
        )
        masks = evidence.available.reshape(count, self.ticks)
        return Windows(
            self.number(int(evidence.ticks[0])),
            self.duration,
            self.ticks,
            Means._make(means),
            Scatter._make(scatter),
            parity,
            np.bitwise_and.reduce(masks, axis=1).tolist(),
            (masks == masks[:, :1]).all(axis=1).tolist(),
            self._broken(evidence.heard.reshape(count, self.ticks)),
            readings,
        )

    @staticmethod
    def _broken(masks: NDArray[np.int64]) -> list[int]:
        """Of masks (w, t) of windows: bits that are not the same at all ticks."""
        if (masks == masks[0, 0]).all():
            return [0] * len(masks)
        changed: list[int] = np.bitwise_or.reduce(masks ^ masks[:, :1], axis=1).tolist()
        return changed

    def _scatter(self, values: Array) -> Array:
        """(w, k) standard deviation of values (w, t, k) of the t ticks of each window about a straight line."""
        if self.ticks < 3:
            return np.zeros((len(values), values.shape[2]))
        off = values - values.sum(axis=1, keepdims=True) / self.ticks
        course = np.arange(self.ticks)[:, None] - 0.5 * (self.ticks - 1)
        off -= course * ((off * course).sum(axis=1, keepdims=True) / float(np.sum(course**2)))
        return np.asarray(np.sqrt(np.square(off).sum(axis=1) / (self.ticks - 2)), np.float64)
