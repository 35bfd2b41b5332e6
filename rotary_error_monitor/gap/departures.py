"""How a real effect departs from its textbook form: its own signature, modulated.

The discrepancy of a model is embedded in the cause (Sargsyan, Huan and Najm 2019) rather than added beside it (Kennedy
and O'Hagan 2001): whatever a cause does may be larger where it is warm, later on, in one direction, at some place, and
so on, by a share of its own size. That share has a real prior; without one the cause's parameters mean nothing
(Brynjarsdottir and O'Hagan 2014). The columns follow from the signature of any effect, a user's own as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.problem import Columns, LateRows, Rows, SparseRows
from rotary_error_monitor.units import HOUR

SHARE = 0.1
"""Standard deviation of each departure, as a part of the cause's own size (root mean square).

That of the prior: datasheets of scales, bearings and drives state temperature coefficients, differences between
directions and neighbouring harmonics of some to some ten per cent of what they come with.
"""

SETTLING = 1 / 16
"""Time constant of what settles, in parts of the recording: what is four times as long is a slow course or follows the
temperature, and what is as much shorter hardly shows."""

COURSES = 40
"""Orders up to which the course of an effect that wanders over the recording is a sum of cosines."""

LARGEST_POWER = (4 * SHARE) ** 2
"""Part of a cause's power that a departure can have: that of four standard deviations of its prior.

Beyond, another cause in its place is likelier by more than 20 to one, however small the noise.
"""

_UNSEEN = 1e-6
"""A modulation that varies less than this over a recording (its standard deviation) is none."""

_DURATIONS = ((HOUR, "h"), (60.0, "min"), (1.0, "s"))
"""Units of durations, s: each is told in the largest of which it has ten."""

Words = Callable[[float], str]


@dataclass(frozen=True)
class Modulation:
    """What a signature is multiplied with.

    Attributes:
        kind: modulations of one kind are taken together.
        values: (n,) or (n, k), of root mean square 1 over most recordings; k are the components of a signal.
        words: says what a relative change of the cause by so much for each unit of `values` is.
        each: whether each amplitude of the cause is modulated on its own (other directions and phases), or all alike.
        proportional: relative change by one unit of `values` that makes the cause proportional to the quantity they are
            of; 0 where that has no zero of its own, as time has none.
    """

    kind: str
    values: Array
    words: Words
    each: bool = False
    proportional: float = 0.0


@dataclass(frozen=True)
class Departures:
    """Ways in which one cause may depart, each a column with a prior of standard deviation one.

    Attributes:
        cause: position of the cause among those at work.
        kinds: (q,) of each column.
        words: (q,) of each column, for its relative change of the cause.
        changes: (q,) relative change of the cause as a whole by one standard deviation of each.
        columns: white rows (m, q).
        effects: (q,) known effect that does what one standard deviation of each does, where there is one; empty: none.
        proportional: (q, p) for each quantity to which the cause may be proportional, values of the columns that make
            it so where each of its p amplitudes is one (`Modulation.proportional`).
        whole: kinds of which a real thing has all as easily as some: one standard deviation of such a column is what it
            does, and not `SHARE` of the cause.
        made_for: amplitudes of the cause, in the order of its columns, that these columns are for; where kinds are
            `whole`.
    """

    cause: int
    kinds: tuple[str, ...]
    words: tuple[Words, ...]
    changes: Array
    columns: Columns
    effects: tuple[Cause | None, ...] = ()
    proportional: tuple[Array, ...] = ()
    whole: frozenset[str] = frozenset()
    made_for: Array = field(default_factory=lambda: np.zeros(0))

    def chosen(self, places: Sequence[int]) -> Departures:
        """Some of the columns; what is proportional to a quantity without those that make it so is no more."""
        index = np.asarray(places, np.intp)
        whole = [values for values in self.proportional if np.count_nonzero(values[index]) == np.count_nonzero(values)]
        return Departures(
            self.cause,
            tuple(self.kinds[i] for i in places),
            tuple(self.words[i] for i in places),
            self.changes[index],
            columns_at(self.columns, index),
            tuple(self.effects[i] for i in places) if self.effects else (),
            tuple(values[index] for values in whole),
            self.whole,
            self.made_for,
        )


def amplitude_sizes(cause: Cause) -> Array:
    """(p,) size of each amplitude's unit: root mean square of the amplitudes that have that unit."""
    linear = cause.effect.indices(Role.LINEAR)
    places = cause.effect.slices()
    unit = {i: p.unit for p in cause.effect.parameters for i in range(*places[p.name].indices(cause.effect.size))}
    values = {i: float(cause.values[i]) for i in linear}
    alike = {u: [v for i, v in values.items() if unit[i] == u] for u in set(unit.values())}
    return np.array([float(np.sqrt(np.mean(np.square(alike[unit[i]])))) for i in linear])


def modulated(
    signature: Array, amplitudes: Array, sizes: Array, modulations: Sequence[Modulation], beside: Sequence[Array] = ()
) -> Array:
    """(n, k, q) columns of a signature (n, k, p): `SHARE` times the cause's size times each modulation.

    Those that stand `beside` come last, each (n, k, …). Every column is contiguous along the first axis, as filters and
    sums run.
    """
    whole, each = (signature @ amplitudes).T, np.ascontiguousarray((signature * sizes).T)
    widths = [len(each) if modulation.each else 1 for modulation in modulations]
    columns, place = np.empty((sum(widths) + sum(part.shape[2] for part in beside), *whole.shape)), 0
    for modulation, width in zip(modulations, widths, strict=True):
        values = SHARE * np.atleast_2d(modulation.values.T)
        np.multiply(each if modulation.each else whole, values, out=columns[place : place + width])
        place += width
    for part in beside:
        columns[place : place + part.shape[2]] = part.T
        place += part.shape[2]
    return columns.T


def modulations_by_size(signal: Array, size: float) -> list[Modulation]:
    """Those that follow from what the cause does, `signal` (n, k), beside its root mean square `size`.

    A signal of none has as many, of zeros: so have all signals of a cause as many columns.
    """
    share, acts = signal / (size or 1.0), float(size > 0.0)
    return [
        Modulation("harmonic", share, second_harmonic, True),
        Modulation("size", acts * (np.abs(share) - 1), with_its_size, True, 1.0),
        Modulation("size", acts * 0.5 * (np.square(share) - 1), with_its_size, True, 2.0),
    ]


def spread_out(
    modulations: Sequence[Modulation], amplitudes: Array, sizes: Array
) -> tuple[tuple[str, ...], tuple[Words, ...], Array]:
    """Kind, words and relative change of the cause of each column that `modulated` gives."""
    relative = amplitudes / np.where(sizes > 0, sizes, 1.0)
    each = SHARE * relative / max(float(np.sum(np.square(relative))), 1e-300)
    rows = [(m, change) for m in modulations for change in (each if m.each else (SHARE,))]
    return (
        tuple(m.kind for m, _ in rows),
        tuple(m.words for m, _ in rows),
        np.array([float(change) for _, change in rows]),
    )


def in_proportion(modulations: Sequence[Modulation], sizes: Array, beside: int = 0) -> tuple[Array, ...]:
    """(q, p) values of the columns that `modulated` gives, by amplitude of one, that make the cause proportional.

    One for each modulation by a quantity with a zero of its own that acts on each amplitude; q counts those that stand
    `beside` as well.
    """
    count = len(sizes)
    starts = np.cumsum([0, *(count if modulation.each else 1 for modulation in modulations)])
    found = []
    for start, modulation in zip(starts[:-1], modulations, strict=True):
        if modulation.each and modulation.proportional:
            values = np.zeros((starts[-1] + beside, count))
            values[start : start + count] = np.diag(modulation.proportional / (SHARE * np.where(sizes > 0, sizes, 1.0)))
            found.append(values)
    return tuple(found)


@dataclass
class Normaliser:
    """Centres a modulation and brings it to a root mean square of one, always by the same numbers.

    Those come from a thin look at the whole recording, so that stretches of a long one agree.
    """

    looks: Mapping[str, Array]
    _found: dict[str, tuple[float, float]] = field(default_factory=dict)

    def unit(self, name: str) -> float:
        """What one standard deviation of the quantity is, in its own unit; 0 if it does not vary."""
        if name not in self._found:
            values = self.looks[name]
            self._found[name] = float(np.mean(values)), float(np.std(values))
        spread = self._found[name][1]
        return spread if spread > _UNSEEN else 0.0

    def proportional(self, name: str) -> float:
        """The relative change by one standard deviation that is proportional to the quantity; 0 where its mean is 0."""
        spread = self.unit(name)
        mean = self._found[name][0]
        return spread / mean if abs(mean) > _UNSEEN else 0.0

    def span(self, name: str) -> float:
        """From the least to the largest value of the quantity, in its own unit."""
        return float(np.ptp(self.looks[name]))

    def __call__(self, name: str, values: Array) -> Array:
        """The values, centred and scaled."""
        spread = self.unit(name)
        return np.asarray((values - self._found[name][0]) / spread, np.float64)


def columns_at(columns: Columns, index: NDArray[np.intp]) -> Columns:
    """Some columns of white rows."""
    if isinstance(columns, LateRows):
        return LateRows(len(index), lambda stretch: _made_at(columns.of(stretch), index))
    return _made_at(columns, index)


def _made_at(rows: Rows | SparseRows, index: NDArray[np.intp]) -> SparseRows:
    if isinstance(rows, SparseRows):
        if any(len(own) != rows.width for own in rows.acting.values()):
            raise TypeError("columns of departures act on whole channels")
        rows = rows.rows
    acting = np.arange(len(index), dtype=np.intp)
    return SparseRows(len(index), {c: values[:, index] for c, values in rows.items()}, dict.fromkeys(rows, acting))


def percent(change: float) -> str:
    """A relative change in words for people, without its sign."""
    size = 100 * abs(change)
    return f"{size:.2g} %" if size < 99.5 else f"{size:.0f} %"


@runtime_checkable
class Departing(Protocol):
    """A problem that knows how its effects may depart from their textbook forms."""

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause, as fitted, may depart."""


@runtime_checkable
class DepartingAsWhole(Protocol):
    """A problem with causes that may depart as a whole (`Departures.whole`): the textbook form may leave any part."""

    def departs_as_whole(self, cause: Cause) -> bool:
        """Whether a cause may."""


@runtime_checkable
class WithSlowNoise(Protocol):
    """A problem whose noise may have a slow part, by which what is slow in white rows is weighed down."""

    def without_slow_noise(self, columns: Columns) -> Columns | None:
        """Columns as they would be beside white noise alone; None where that is what they are."""


@runtime_checkable
class LeavingOut(Protocol):
    """A problem that leaves outliers out, which it tells by how far they are from what is known of the others."""

    def learn_outliers(self, causes: Sequence[Cause], departing: Rows) -> bool:
        """Look for outliers again beside causes and white rows (m, 1) that their departures take, by channel.

        Whether the rows have changed by it.
        """


def grows(change: float) -> str:
    """Whether a relative change is one to more or to less."""
    return "grows" if change > 0 else "shrinks"


def by_rate(change: float, span: float, per: str, size: float = 1.0) -> str:
    """Words for a relative change for each unit of a quantity; over all that it spans where that is less than one.

    Args:
        change: for each SI unit.
        span: of the quantity in the recording, in that unit.
        per: unit in which it is told, such as `K` or `100 N`.
        size: how many SI units that is.
    """
    if span >= size:
        return f"by {percent(change * size)}{'/K' if per == 'K' else f' per {per}'}"
    number, _, unit = per.rpartition(" ")
    return f"by {percent(change * span)} over the {span / size * float(number or 1):.2g} {unit} of the recording"


def over_time(change: float, duration: float) -> str:
    """Words for a change over a whole recording, relative to the mean: by a part of what is largest at either end.

    Args:
        change: from the beginning to the end.
        duration: of the recording, s.
    """
    told = next(
        (f"{duration / size:.3g} {unit}" for size, unit in _DURATIONS if duration >= 10 * size), f"{duration:.2g} s"
    )
    if abs(change) > 2.0:
        return f"changes its sign over the {told}"
    part = percent(change / (1 + abs(change) / 2))
    if change > 0:
        return f"grows with time by {part} of its final size over the {told}"
    return f"shrinks with time by {part} over the {told}"


def with_its_size(change: float) -> str:
    """Words for a modulation by the square of what the cause does."""
    return f"grows {'more' if change > 0 else 'less'} than in proportion to its size"


def unlike_components(samples: int) -> Modulation:
    """What an instrument shows in its two components by unlike amounts; one amplitude textbooks have for both."""
    return Modulation("unlike axes", np.tile([1.0, -1.0], (samples, 1)), larger_in_one)


def larger_in_one(change: float) -> str:
    """Words for more in the first component and less in the second."""
    first, second = "xy" if change > 0 else "yx"
    return f"larger in {first} than in {second} by {percent(2 * change)}"


def second_harmonic(change: float) -> str:
    """Words for a modulation by what the cause does."""
    return "brings its second harmonic"


def wanders(change: float) -> str:
    """Words for a slow course that is none of the others."""
    return "wanders with time"


def settling(passed: Array, duration: float = 0.0) -> Modulation:
    """What is larger or smaller at first and settles as a first-order system does: it runs in, or warms itself.

    Args:
        passed: (n,) part of the recording, 0 to 1, that has passed.
        duration: of the recording, s; 0 where it is told in parts of it.
    """
    # Over the whole recording, so that stretches of a long one agree.
    mean = -SETTLING * math.expm1(-1 / SETTLING)
    spread = math.sqrt(-SETTLING / 2 * math.expm1(-2 / SETTLING) - mean**2)
    time = f"{SETTLING * duration:.2g} s" if duration else "a sixteenth of the recording"
    values = np.asarray((np.exp(-passed / SETTLING) - mean) / spread, np.float64)
    return Modulation("settling", values, partial(_settles, time, (1 - mean) / spread))


def _settles(time: str, first: float, change: float) -> str:
    return f"{'larger' if change > 0 else 'smaller'} at first by {percent(first * change)}, settling within {time}"


def slow_courses(passed: Array) -> list[Modulation]:
    """Slow cosines over the part of the recording (n,) that has passed, 0 to 1, as large as in a random walk."""
    waves = [np.ones(len(passed)), np.cos(np.pi * passed)]
    # Each from the two before (Chebyshev): a tenth of the time of cosines, and exact to 10^-12.
    for _ in range(2, COURSES + 1):
        waves.append(2 * waves[1] * waves[-1] - waves[-2])
    sizes = (np.sqrt(2) * 2 / order for order in range(2, COURSES + 1))
    return [Modulation("course", size * wave, wanders) for size, wave in zip(sizes, waves[2:], strict=True)]
