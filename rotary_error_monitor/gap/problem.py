"""What the diagnosis needs to know of a twin and a recording, whatever machine they are of.

Everything is compared in *rows*: white numbers of variance one under the twin's own noise, so that sums of squares are
chi-square and one unit means the same on every channel.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, Values
from rotary_error_monitor.gap.views import View

Rows = dict[str, Array]
"""White rows (m, p) by channel; a channel on which nothing acts may be absent."""


@dataclass(frozen=True)
class SparseRows:
    """White rows of columns of which few act on each channel, as the uncertain parameters of a twin.

    Attributes:
        width: number of columns.
        rows: (m, k) rows of the columns that act, by channel.
        acting: (k,) which columns those are, by channel.
        products: (b, width, width) of all columns with one another, by the edges of the b blocks: see `own_products`.
    """

    width: int
    rows: Rows
    acting: Mapping[str, NDArray[np.intp]]
    products: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False, compare=False)


@dataclass(frozen=True)
class LateRows:
    """White rows of a long recording, made for one stretch at a time when they are needed: all would fill the memory.

    Attributes:
        width: number of columns.
        of: rows of the stretch with that number.
    """

    width: int
    of: Callable[[int], Rows | SparseRows]


Columns = Rows | SparseRows | LateRows
"""White rows that are kept, all or those of columns that act, or that are made stretch by stretch."""


@dataclass(frozen=True)
class StructureTest:
    """Outcome of one test for structure.

    Attributes:
        channel: channel of rows.
        kind: what was looked for.
        log_p_value: natural logarithm of the chance of this under noise.
        excess: power above noise in rows' units, as far as the test measures it.
        pattern: what was found, in words.
        reach: by channel, squares of the excess for each square that a twin leaves there; None where what is left of
            the channel is in the excess itself.
    """

    channel: str
    kind: str
    log_p_value: float
    excess: float
    pattern: str
    reach: Mapping[str, float] | None = None

    def exceeds(self, powers: Mapping[str, float]) -> bool:
        """Whether a twin that is as accurate as it is (`FIRST_ORDER`) leaves less of causes with these powers."""
        if self.reach is None:
            return self.excess > FIRST_ORDER**2 * powers.get(self.channel, sum(powers.values()))
        # What it leaves of one cause goes the same way on all channels.
        left = sum(FIRST_ORDER * math.sqrt(powers.get(channel, 0.0) * part) for channel, part in self.reach.items())
        return bool(self.excess > left**2)


@dataclass(frozen=True)
class Share:
    """Part of the gap that lies in one channel.

    Attributes:
        channel: topic and field.
        share: of the excess over noise; all shares add up to 1.
        gap_rms: root mean square of the excess, in the channel's unit.
        noise_rms: of one sample's noise.
        pattern: what the excess depends on, in words.
        shown_in: unit in which people read the channel, and how many of it the channel's own unit is.
    """

    channel: str
    share: float
    gap_rms: float
    noise_rms: float
    pattern: str
    shown_in: tuple[str, float] = ("", 1.0)


@dataclass(frozen=True)
class Candidate:
    """An effect at a place as a possible cause, not yet fitted.

    Attributes:
        effect: the effect.
        location: where.
        start: values from which it is fitted: zero amplitude, shape as found by a search.
        log_prior: logarithm of the chance of this place, order or moment if the effect is at work at all: one over the
            independent ones that were searched, where all are as likely.
    """

    effect: AnyEffect
    location: str
    start: Values
    log_prior: float = 0.0

    @property
    def key(self) -> tuple[str, str]:
        """Name and location."""
        return self.effect.name, self.location

    @property
    def linear(self) -> list[int]:
        """Indices of the values in which the prediction is linear."""
        return self.effect.indices(Role.LINEAR)

    def cause(self, amplitudes: Array) -> Cause:
        """The effect with these values of its linear parameters; those beyond their bounds are put at them."""
        values = self.start.copy()
        values[self.linear] = amplitudes
        return Cause(self.effect, self.location, self.effect.held(values))


@dataclass(frozen=True)
class Conditions:
    """A recording cut into blocks, each under one condition.

    Attributes:
        edges: (b + 1,) times at which blocks begin and end, s (or numbers of poses).
        labels: (b,) condition of each block; blocks of one label are held out together.
        names: of each label, in words.
    """

    edges: Array
    labels: NDArray[np.intp]
    names: tuple[str, ...]

    @property
    def stretches(self) -> int:
        """Number of stretches that columns are made for one at a time; the whole recording is one."""
        return 1

    def extent(self, channel: str, count: int, stretch: int) -> slice:
        """Rows of a channel, of `count` altogether, that lie in one stretch."""
        return slice(0, count)

    def pieces(self, channel: str, time: Array, stretch: int) -> list[tuple[int, slice]]:
        """Rows of a channel in one stretch by the block that they belong to, from the times of all its rows."""
        bounds = np.searchsorted(time, self.edges)
        return [(block, slice(int(a), int(b))) for block, (a, b) in enumerate(itertools.pairwise(bounds))]

    def as_one(self) -> Conditions:
        """The same as one block, where only sums over the whole recording are asked for."""
        return replace(self, edges=self.edges[[0, -1]], labels=np.zeros(1, np.intp), names=self.names[:1])

    def joined(self) -> Conditions:
        """The same with neighbouring blocks of one label as one, where nothing but labels is held out."""
        first = np.flatnonzero(np.diff(self.labels, prepend=-1))
        return replace(self, edges=np.append(self.edges[first], self.edges[-1]), labels=self.labels[first])


@dataclass(frozen=True)
class StretchedConditions(Conditions):
    """Conditions of a long recording: a block is several spans of time under one condition.

    Attributes:
        blocks: (s,) block of each span; `edges` (s + 1,) are those of the spans.
        stretch: (s,) stretch of each span.
        rows: rows of each channel at which stretches begin and end, (stretches + 1,).
    """

    blocks: NDArray[np.intp]
    stretch: NDArray[np.intp]
    rows: Mapping[str, NDArray[np.intp]]

    @property
    def stretches(self) -> int:
        """Number of stretches."""
        return int(self.stretch[-1]) + 1

    def extent(self, channel: str, count: int, stretch: int) -> slice:
        """Rows of a channel that lie in one stretch."""
        return slice(int(self.rows[channel][stretch]), int(self.rows[channel][stretch + 1]))

    def pieces(self, channel: str, time: Array, stretch: int) -> list[tuple[int, slice]]:
        """Rows of each span of one stretch with the block that it belongs to."""
        extent = self.extent(channel, len(time), stretch)
        first, last = extent.start, extent.stop
        spans = np.flatnonzero(self.stretch == stretch)
        inner = first + np.searchsorted(time[first:last], self.edges[spans[1:]])
        bounds = itertools.pairwise([first, *inner.tolist(), last])
        return [(int(self.blocks[span]), slice(a, b)) for span, (a, b) in zip(spans, bounds, strict=True)]

    def as_one(self) -> Conditions:
        """The same with all spans as one block."""
        one = np.zeros(1, np.intp)
        return replace(self, blocks=np.zeros_like(self.blocks), labels=one, names=self.names[:1])

    def joined(self) -> Conditions:
        """The same with all blocks of one label as one."""
        return replace(self, blocks=self.labels[self.blocks], labels=np.arange(len(self.names), dtype=np.intp))


FIRST_ORDER = 5e-4
"""Accuracy of a twin of first order with measured inputs: remainders below this part of what the causes do to a
channel, root mean square, are the twin's own. Beside a plant of exact geometry the largest, of effects as large as a
real stage or machine has them, was 3.8e-4: a graduation off centre, whose second order the twin lacks; a third more is
left for what was not tried."""


class Problem(Protocol):
    """A recording beside a twin."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels of rows."""

    @property
    def conditions(self) -> Conditions:
        """Blocks for holding out and for resampling."""

    @property
    def m_open(self) -> bool:
        """Whether something unknown is always at work beside the known effects."""

    def times(self, channel: str) -> Array:
        """(m,) time of each row, s (or number of the pose)."""

    def expected(self, channel: str) -> Array:
        """(m,) expected square of each row under noise alone; 0 for rows that take no part."""

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (m, 1) of measured minus predicted with these causes in the twin."""

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Columns:
        """White rows (m, len(indices)): change of the prediction with each of those values of the cause.

        It acts beside the others: in its own place where it is one of them, else after them.
        """

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """For each candidate the part of its signature that is another beside these causes than alone."""

    def nuisance(self, causes: Sequence[Cause]) -> Columns:
        """White rows (m, q): change of the prediction by one standard uncertainty of each parameter of the twin."""

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Possible causes, with orders, moments and periods searched in what is left (`rest`, white rows (m, 1))."""

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of what is left against every kind of structure, each with the chance of it under noise."""

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Estimate again what of the noise is estimated from the recording, the causes taken out.

        Called beside each set of causes that is tested: what was learnt beside fewer may have been one of these. Says
        whether the rows have changed by it.
        """


@runtime_checkable
class LearntNoise(Protocol):
    """A problem whose recording is so short that the level of its noise is known to some per cent only.

    What stands out of noise by chance does so more often where that is louder than it is taken to be.
    """

    @property
    def noise_dof(self) -> float:
        """Degrees of freedom with which the variance of the noise is known; infinite where it is as stated."""


class DiagnosableProblem(Problem, Protocol):
    """A problem that can also say what its findings mean to people."""

    def check_plausible(self) -> None:
        """Refuse a twin that is not of this machine.

        Raises:
            InputError: the gap is as large as the signals themselves.
        """

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """Shares of the channels: of the causes if they explain the gap, else of what is left."""

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """The measurement that would tell these effects apart, found by predicting it."""

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Findings that are no effect, such as noise that is larger than stated."""

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """What people in the field ask for, by names with units; for `diagnosis.json`.

        Of stages and machines it is how wrong the causes make the tool-to-workpiece offset.
        """

    def views(self, channels: Sequence[str], causes: Sequence[Cause]) -> list[View]:
        """Residuals of some channels before and after the causes, against what they may depend on."""
