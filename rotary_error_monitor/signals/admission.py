"""The one place where a sample is believed: declared checks that the samples of every stream pass.

Whether a sample is believed follows from the samples of its own stream, in the order of their stamps, so that live and
in replay the same ones are. Only the clock is held against the time of arrival, which a recording has as well.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask, differences
from rotary_error_monitor.libraries import address
from rotary_error_monitor.signals.arrival import FUTURE
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.described_path import DescribedPath
from rotary_error_monitor.signals.kernel import Limits, SignalKernel
from rotary_error_monitor.units import TURN

NOT_FINITE = "not finite"
LATE = "not after the one before"
ASTRAY = "stamped later than those behind it"
BEYOND = "beyond what the instrument can show"
FAST = "faster than the axis can turn"
SPIKE = "a spike"


SPIKE_SIGMAS = 8.0
"""A sample that stands off the mean of its neighbours by more standard deviations is a spike: of normal noise one in
1e15 would be, of noise a third larger than stated one in 1e9."""

SPREAD_OF_FIVE = 0.94
"""Standard deviation of a normal sample about the median of the five around it, over its own: the root of
1 + 0.287 - 2 * 0.2."""

WAITING_SIGMAS = 4.0
"""A sample that is off by no more standard deviations from where the two before it lead is no spike and need not wait
for the next ones to be judged; of normal noise one in 16,000 is off by more, and waits."""

LAST, FEWEST = 12, 3
"""Second differences by the middle one of which it is told how a signal goes: a spike of two samples bends four.
Before the fewest nothing is known, and nothing is a spike."""

SWINGS = 6.0
"""How many times as much a sample may be off as the signal bent over the last ones: with less, beats of several orders
are taken for spikes; with it, of waves of three orders at any rate, less than one sample in 100,000."""

NOISY_SIGMAS = 2.6
"""What normal noise bends the last samples by in the middle, standard deviations: seldom more, 1.65 on the average."""

_CONTEXT = LAST + 3
"""Samples before the one that is judged that can matter to it."""

_BEND = 3
"""Samples that a second difference is made of."""

LARGEST_ANGLE = 1e7
"""An unwrapped angle, rad, beyond which float64 no longer holds a thousandth of a count of the finest encoders."""

_BEFORE_ALL, _AFTER_ALL = -(2**62), 2**62

Samples = tuple[NDArray[np.int64], Array]


@dataclass(frozen=True)
class SampleLimits:
    """What the samples of a stream can be, in the units of the stream.

    Attributes:
        largest: largest absolute value of a sample.
        speed: fastest change per s; where values are angles, whole turns beyond it are taken out.
        turns: whether a value may start again after a whole turn.
        jitter: change that noise and resolution may add to that, at most.
        noise: standard deviation of a sample, resolution included; spikes are told by it. Without it they are not.
        path: what samples of two values are described to show over a turn: what goes on along it is no spike.
    """

    largest: float = math.inf
    speed: float = math.inf
    turns: bool = False
    jitter: float = 0.0
    noise: float | None = None
    path: DescribedPath | None = None


@dataclass
class Admission:
    """Holds the samples of one stream against their limits.

    Attributes:
        refused: samples that were not believed, by reason.
        refusals: timestamp (ns) of each of the latest of them, not before that of the sample taken last.
        wraps: how often the readings started again after whole turns.
    """

    limits: SampleLimits = field(default_factory=SampleLimits)
    refused: Counter[str] = field(default_factory=Counter)
    refusals: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    wraps: int = 0

    def __post_init__(self) -> None:
        of = self.limits
        bend = -1.0 if of.noise is None else self._largest_bend
        self._limits = Limits(largest=of.largest, speed=of.speed, jitter=of.jitter, largest_bend=bend)
        self.forget()

    def forget(self) -> None:
        """Begin anew, as before the first sample; counts stay."""
        self._newest_ns: int | None = None
        self._last: Array | None = None
        self._turns = 0
        self.refusals = self.refusals[:0]
        self._waiting: Samples | None = None
        self._tail = np.empty((0, 0))

    def admit(self, times: NDArray[np.int64], values: Array, until_ns: int | None = None) -> Samples:
        """What can be believed of samples `values` (n, k) at `times` (n,), ns; the last may wait for the next call.

        Args:
            times: timestamps (ns).
            values: one row for each of them.
            until_ns: what is stamped later than this, timestamp (ns), is in the future; None where no clock tells.
        """
        times, values = self._in_order(times, values, _AFTER_ALL if until_ns is None else until_ns)
        if len(times) == 0:
            return times, values
        values, kept = self._continuous(times, values)
        if kept is not None:
            times, values = times[kept], values[kept]
            if len(times) == 0:
                return times, values
        self._newest_ns, self._last = int(times[-1]), values[-1]
        return (times, values) if self.limits.noise is None else self._without_spikes(times, values)

    def copies(
        self, kernel: SignalKernel, block: SampleBlock, until_ns: int | None, into: tuple[int, int], width: int
    ) -> bool:
        """Whether all samples of a block are beyond doubt, and were copied; else nothing has happened.

        What `admit` would give of them is where `into` says, addresses with room for times and values (n, width).
        """
        limits, rows, noise = self._limits, block.rows, self.limits.noise
        if noise is not None:
            if self._waiting is not None or len(rows) < _CONTEXT or 0 < len(self._tail) < _BEND:
                return False
            tail = self._tail[-_BEND:]
            limits.tail = address(tail) if len(tail) else 0
        limits.until = _AFTER_ALL if until_ns is None else until_ns
        limits.is_first = self._newest_ns is None or self._last is None
        if self._newest_ns is not None and self._last is not None:
            limits.since, limits.last = self._newest_ns, self._last[0]
        limits.taken_out = TURN * self._turns
        if not kernel.admit(limits, rows, block.times_ns, into, width):
            return False
        self._newest_ns, self._last = block.newest_ns, rows[-1, 1 : 1 + width]
        if self._turns and not math.isinf(self.limits.speed):
            self._last = _turned_by(self._last, self._turns)
        if noise is not None:
            self._tail = rows[-_CONTEXT:, 1 : 1 + width].copy()
        return True

    def turn_by(self, turns: int) -> None:
        """Take further whole turns out of all that comes."""
        self._turns += turns
        if self._last is not None:
            self._last = _turned_by(self._last, turns)

    def _in_order(self, times: NDArray[np.int64], values: Array, until_ns: int) -> Samples:
        """Samples that are finite, within range, not in the future and in order after all that came before.

        Of those that came together as many as can be in order are: a single wrong stamp costs its own sample, not those
        behind it.
        """
        before = _BEFORE_ALL if self._newest_ns is None else self._newest_ns
        good = np.abs(values) <= self.limits.largest  # false for NaN
        rising = len(times) > 0 and times[0] > before and bool((times[1:] > times[:-1]).all())
        if rising and times[-1] <= until_ns and bool(good.all()):
            return times, values
        finite: Mask = np.asarray(np.isfinite(values).all(axis=1))
        sound: Mask = finite & np.asarray(good.all(axis=1))
        ahead: Mask = times > until_ns
        usable = sound & ~ahead
        kept = usable & (times > before)
        kept[kept] = _rising(times[kept])
        newest = np.maximum.accumulate(np.concatenate([[before], np.where(kept, times, before)[:-1]]))
        astray = usable & ~kept & (times > newest)
        when = np.maximum(np.where(ahead | astray, newest, times), newest)
        self._count(NOT_FINITE, ~finite, when)
        self._count(BEYOND, finite & ~sound, when)
        self._count(FUTURE, sound & ahead, when)
        self._count(ASTRAY, astray, when)
        self._count(LATE, usable & ~kept & ~astray, when)
        return times[kept], values[kept]

    def _continuous(self, times: NDArray[np.int64], values: Array) -> tuple[Array, Mask | None]:
        """Values without the whole turns after which they start again, and which are no faster than they can be."""
        limits = self.limits
        if math.isinf(limits.speed):
            return values, None
        turned = _turned_by(values, self._turns) if self._turns else values
        last, since = self._last, self._newest_ns
        steps = differences(turned[:, 0], turned[0, 0] if last is None else last[0])
        passed = differences(times, times[0] if since is None else since) * 1e-9
        if bool((np.abs(steps) <= limits.speed * passed + limits.jitter).all()):
            return turned, None
        kept = np.ones(len(times), np.bool_)
        turned = values.copy()
        for i in range(len(times)):
            turned[i, 0] = values[i, 0] - TURN * self._turns
            if last is not None and since is not None:
                kept[i] = self._follows(turned[i], last, (int(times[i]) - since) * 1e-9)
            if kept[i]:
                last, since = turned[i], int(times[i])
        self._count(FAST, ~kept, times)
        return turned, kept

    def _follows(self, value: Array, last: Array, passed: float) -> bool:
        """Whether a value can follow the last one; whole turns are taken out of it where it can only so."""
        allowed = self.limits.speed * passed + self.limits.jitter
        step = float(value[0] - last[0])
        if abs(step) <= allowed:
            return True
        turns = round(step / TURN) if self.limits.turns else 0
        if abs(step - TURN * turns) > allowed:
            return False
        self._turns += turns
        self.wraps += turns != 0
        value[0] -= TURN * turns
        return True

    def _without_spikes(self, times: NDArray[np.int64], values: Array) -> Samples:
        """Samples without those that jump off from where the two before lead, and stand off from the median of five.

        How far they may is what noise allows or, where the signal bends more than that from sample to sample, a
        multiple of what it did over the last ones. A step is none: the median follows it. Nor is what a rotor shows
        that turns on, as where its speed rises between few samples a turn. Only what jumps off, and the one behind it,
        waits for its neighbours: what one sample costs in time, no estimate should pay for another.
        """
        if self._waiting is not None:
            times, values = np.concatenate([self._waiting[0], times]), np.concatenate([self._waiting[1], values])
        before = len(self._tail)
        rows = np.concatenate([self._tail, values]) if before else values
        bends = np.abs(rows[2:] - 2 * rows[1:-1] + rows[:-2])  # of row i + 2
        off = np.flatnonzero((bends > self._largest_bend).any(axis=1)) + 2
        free, taken = len(values), None
        if len(off) and off[-1] >= before - 1:
            spikes, free = self._spikes(rows, bends, off[off >= before - 1], before)
            taken = ~spikes[before : before + free]
            self._count(SPIKE, ~taken, times[:free])
        self._waiting = (times[free:], values[free:]) if free < len(values) else None
        self._tail = rows[max(before + free - _CONTEXT, 0) : before + free].copy()
        times, values = times[:free], values[:free]
        return (times, values) if taken is None or taken.all() else (times[taken], values[taken])

    def _spikes(self, rows: Array, bends: Array, off: NDArray[np.int64], before: int) -> tuple[Mask, int]:
        """(n,) which rows are spikes, and how many of those behind the first `before` are judged.

        Args:
            rows: (n, k) samples.
            bends: (n - 2, k) absolute second difference that ends at each row but the first two.
            off: rows that jump off by more than noise does.
            before: rows that were judged before.
        """
        spikes, jumps, near = (np.zeros(len(rows) + 1, np.bool_) for _ in range(3))
        near[off] = near[off + 1] = True  # where one spike leads, a second one need not jump off
        places = np.flatnonzero(near[:-1])
        allowed = SWINGS * self._swing(bends, places)
        jumps[places] = (bends[places - 2] > np.maximum(self._largest_bend, allowed)).any(axis=1)
        suspect = (jumps[places] | jumps[places - 1]) & (places >= before)
        complete = suspect & (places < len(rows) - 2)
        free = int(places[suspect & ~complete][0]) if (suspect & ~complete).any() else len(rows)
        judged = places[complete]
        if len(judged):
            five = rows[judged[:, None] + np.arange(-2, 3)]
            stands = np.abs(rows[judged] - np.partition(five, 2, axis=1)[:, 2])
            limit = np.maximum(SPIKE_SIGMAS * SPREAD_OF_FIVE * self._noise, allowed[complete])
            spikes[judged] = (stands > limit).any(axis=1)
            if self.limits.path is not None and spikes.any():
                accused, off = judged[spikes[judged]], stands[spikes[judged]]
                three = rows[accused[:, None] + np.arange(-1, 2)]
                spikes[accused] = ~self.limits.path.goes_on(three, np.hypot(off[:, 0], off[:, 1]))
        return spikes[:-1], free - before

    def _swing(self, bends: Array, rows: NDArray[np.int64]) -> Array:
        """(m, 1) what the signal bends before each of the `rows` from sample to sample, beyond what noise makes."""
        swing = np.full((len(rows), bends.shape[1]), math.inf)  # at the beginning nothing is known of it
        ends = rows - 2
        whole = ends >= LAST
        if whole.any():
            last = bends[(ends[whole] - LAST)[:, None] + np.arange(LAST)]
            swing[whole] = np.partition(last, LAST // 2, axis=1)[:, LAST // 2]
        for place in np.flatnonzero(~whole & (ends >= FEWEST)):
            end = int(ends[place])
            swing[place] = np.sort(bends[:end], axis=0)[end - max(1, end // 2)]
        most = swing.max(axis=1, keepdims=True)  # a column may rest while another one moves
        return np.asarray(np.sqrt(np.maximum(most**2 - (NOISY_SIGMAS * self._noise) ** 2, 0.0)))

    @property
    def _noise(self) -> float:
        assert self.limits.noise is not None
        return self.limits.noise

    @property
    def _largest_bend(self) -> float:
        """What noise alone makes of a second difference at most."""
        return WAITING_SIGMAS * math.sqrt(6.0) * self._noise

    def _count(self, reason: str, which: Mask, when: NDArray[np.int64]) -> None:
        if which.any():
            self.refused[reason] += int(which.sum())
            self.refusals = np.concatenate([self.refusals, when[which]])


def _turned_by(values: Array, turns: int) -> Array:
    """Values (..., k) whose angle, the first of k, has had whole turns taken out."""
    turned = values.copy()
    turned[..., 0] -= TURN * turns
    return turned


def _rising(times: NDArray[np.int64]) -> Mask:
    """(n,) which of `times` (n,) to keep, so that they rise and are as many as can be.

    Of equal ones the first is kept; where as many could be kept otherwise, those that end earlier: what is stamped
    ahead would cost those that come next as well.
    """
    kept = np.ones(len(times), np.bool_)
    if len(times) < 2 or bool((times[1:] > times[:-1]).all()):
        return kept
    ends: list[int] = []  # earliest stamp with which so many can end, and the place of it
    places: list[int] = []
    before: list[int] = []
    for place, time in enumerate(times.tolist()):
        length = bisect_left(ends, time)
        before.append(places[length - 1] if length else -1)
        if length == len(ends) or ends[length] != time:
            ends[length : length + 1] = [time]
            places[length : length + 1] = [place]
    kept[:] = False
    place = places[-1]
    while place >= 0:
        kept[place] = True
        place = before[place]
    return kept
