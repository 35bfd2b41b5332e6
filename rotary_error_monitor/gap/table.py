"""A problem whose channels have one row each for every pose or place: what most kinds of thing share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Generic, TypeVar

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, among, order_location, values_of
from rotary_error_monitor.gap.dependence import explained_by, name_dependences
from rotary_error_monitor.gap.p_values import log_chi_square_tail
from rotary_error_monitor.gap.problem import Candidate, Conditions, Rows, Share, StructureTest
from rotary_error_monitor.gap.views import View

TELLING = 0.05
"""Part of a channel's gap from which it is said what it depends on."""

State = TypeVar("State")
Shapes = Mapping[str, Sequence[tuple[str, Array]]]


class TableProblem(ABC, Generic[State]):
    """A recording of n rows beside its twin; a kind says what is predicted, and what the rows may depend on.

    Args:
        thing: what the effects act on.
        conditions: blocks of rows, told by their numbers.
        measured: (c, n) on each channel.
        std: (c,) noise of one row of each channel.
        effects: the known effects.
        known: effects that the twin has.

    Attributes:
        names: channels of rows, each with its name in the diagnosis.
        unit: of the channels, for pictures, and how many of it the unit of what is measured is.
        step: of numerical derivatives, in usual sizes of a parameter.
        shape_step: the same relative to a parameter that shapes the effect.
        kept: (n,) rows that are no outliers.
    """

    names: Mapping[str, str]
    unit: ClassVar[tuple[str, float]]
    step: ClassVar[float] = 1e-2
    shape_step: ClassVar[float] = 1e-4
    m_open: ClassVar[bool] = False

    def __init__(
        self,
        thing: object,
        conditions: Conditions,
        measured: Array,
        std: Array,
        effects: Sequence[AnyEffect],
        known: Sequence[Cause] = (),
    ) -> None:
        self.channels = tuple(self.names)
        self.thing = thing
        self.conditions = conditions
        self.measured = measured
        self.std = std
        self.effects = tuple(effects)
        self.known = tuple(known)
        self.kept = np.ones(measured.shape[1], bool)
        self._settled: dict[tuple[tuple[str, str, bytes], ...], State] = {}

    @abstractmethod
    def settle(self, causes: Sequence[Cause]) -> State:
        """What of the twin is fitted to the recording whatever the causes, beside causes of these sizes."""

    @abstractmethod
    def predict(self, state: State, causes: Sequence[Cause]) -> Array:
        """(c, n) what the twin expects with these causes, what is fitted being as it was settled."""

    @abstractmethod
    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows (n, q): change of the prediction by one standard uncertainty of each parameter of the twin."""

    @abstractmethod
    def quantities(self) -> Mapping[str, Array]:
        """(n,) each of what a person wants to see the channels over, by its name with its unit."""

    def shapes(self) -> Shapes:
        """Functions (n,) of what a row may depend on, with their names, grouped by that: powers of each quantity."""
        spans = {name: (x - x.mean()) / (float(np.ptp(x)) or 1.0) for name, x in self.quantities().items()}
        return {name: [(f"power {k}", x**k) for k in (1, 2, 3)] for name, x in spans.items()}

    def times(self, channel: str) -> Array:
        """(n,) number of each row."""
        return np.arange(len(self.kept), dtype=np.float64)

    def expected(self, channel: str) -> Array:
        """(n,) 1 for rows that count, 0 for outliers."""
        return self.kept.astype(np.float64)

    def settled(self, causes: Sequence[Cause]) -> State:
        """What is fitted beside the causes, kept for the next time; causes without size do nothing."""
        fitted = acting(causes)
        key = values_of(fitted)
        if key not in self._settled:
            self._settled[key] = self.settle(fitted)
        return self._settled[key]

    def error(self, causes: Sequence[Cause]) -> Array:
        """(c, n) measured minus predicted."""
        return self.measured - self.predict(self.settled(causes), causes)

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (n, 1) of measured minus predicted."""
        return self.white(self.error(causes)[:, :, None])

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Rows:
        """White rows of the derivative of the prediction with respect to values of `cause`, beside `others`."""
        return self.white(self.derivative(cause, indices, others))

    def derivative(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause]) -> Array:
        """(c, n, len(indices)) derivative of the prediction with respect to values of `cause`, beside `others`."""
        effect, causes, columns = cause.effect, among(cause, others), []
        state = self.settled(causes)
        base = self.predict(state, causes)
        for index in indices:
            shape = index in effect.indices(Role.SHAPE)
            size = self.shape_step * float(cause.values[index]) if shape else self.step * float(effect.scales()[index])
            step, values = effect.inward(cause.values, index, size), cause.values.copy()
            values[index] += step
            columns.append((self.predict(state, among(cause.with_values(values), others)) - base) / step)
        return np.stack(columns, axis=2)

    def white(self, values: Array) -> Rows:
        """White rows (n, p) of values (c, n, p)."""
        white = values / self.std[:, None, None] * self.kept[None, :, None]
        return {channel: white[i] for i, channel in enumerate(self.channels)}

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """None: small errors add up, whatever else is wrong."""
        return [0.0] * len(candidates)

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Every effect at every place and of every order."""
        return tuple(candidate for effect in self.effects for candidate in self.candidates_of(effect))

    def candidates_of(self, effect: AnyEffect) -> Iterator[Candidate]:
        """One effect at every place, or of every order."""
        orders, places = range(effect.lowest, effect.orders + 1), effect.locations(self.thing)
        for place in () if effect.orders else places:
            yield Candidate(effect, place, effect.start(place), -float(np.log(len(places))))
        for place in places if effect.orders else ():
            for order in orders:
                at = order_location(order, place)
                yield Candidate(effect, at, effect.start(at), effect.log_prior_of(order) - float(np.log(len(places))))

    def at_zero(self, key: tuple[str, str]) -> Cause:
        """An effect without size at a place, of the lowest order if it has orders there."""
        found = next(candidate for candidate in self.candidates({}, ()) if candidate.key == tuple(key))
        return found.cause(np.zeros(len(found.linear)))

    def structure(self, rest: Rows) -> list[StructureTest]:
        """One test for each channel and group of shapes: the one that explains most of what is left."""
        return self.findings(rest, self.shapes())

    def findings(self, rest: Rows, shapes: Shapes) -> list[StructureTest]:
        """The same of some groups of shapes."""
        findings = []
        for channel in (channel for channel in self.channels if channel in rest):
            white = rest[channel][:, 0]
            for group, rows in shapes.items():
                names, table = [name for name, _ in rows], _stacked(rows) * self.kept[:, None]
                table = table - self.kept[:, None] * table.sum(axis=0) / self.kept.sum()
                power = np.sum(np.square(table), axis=0)
                gains = np.where(power > 1e-9, np.square(table.T @ white) / np.maximum(power, 1e-9), 0.0)
                best = int(np.argmax(gains))
                chance = min(0.0, log_chi_square_tail(float(gains[best]), 1) + float(np.log(len(names))))
                pattern = f"{group}: {names[best]}"
                findings.append(StructureTest(channel, group, chance, max(0.0, float(gains[best]) - 1), pattern))
        return findings

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Nothing to learn: the noise is as it was stated or found, whatever the causes."""
        return False

    def check_plausible(self) -> None:
        """Refuse a twin of something else; none is refused.

        Raises:
            InputError: the gap is as large as the signals themselves.
        """

    def shown(self, causes: Sequence[Cause]) -> Array:
        """(c, n) what the causes do to the channels beyond what is fitted."""
        state = self.settled(causes)
        return self.predict(state, causes) - self.predict(state, ())

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """Shares of the channels, larger ones first; empty if nothing exceeds the noise."""
        if explained:
            signals = self.shown(causes)
            powers = np.mean(np.square(signals), axis=1)
        else:
            signals = np.stack([rest[channel][:, 0] for channel in self.channels]) * self.std[:, None]
            powers = np.maximum(0.0, np.sum(np.square(signals), axis=1) / self.kept.sum() - np.square(self.std))
        total, size, names = float(powers.sum()), np.sqrt(powers), tuple(self.names.values())
        return [
            Share(names[i], powers[i] / total, size[i], self.std[i], self._told(signals[i], powers[i]), self.unit)
            for i in np.argsort(-powers)
            if total > 0
        ]

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """The measurement that would tell effects apart; none is known."""
        return "no measurement is known that tells them apart"

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Findings that are no effect: how many rows are outliers."""
        lost = int(np.count_nonzero(~self.kept))
        return (f"{lost} of {len(self.kept)} rows are outliers and were left out",) if lost else ()

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """What people in the field ask for; nothing."""
        return {}

    def views(self, channels: Sequence[str], causes: Sequence[Cause]) -> list[View]:
        """Channels before and after the causes over each quantity."""
        unit, factor = self.unit
        before, after = factor * self.error(())[:, self.kept], factor * self.error(causes)[:, self.kept]
        rows = {name: i for i, name in enumerate(self.names.values())}
        return [
            View(channel, quantity, x[self.kept], before[rows[channel]], after[rows[channel]], unit)
            for channel in channels
            for quantity, x in self.quantities().items()
        ]

    def _told(self, values: Array, power: np.float64) -> str:
        """Groups of shapes on which one channel's part of the gap depends, with what each explains alone."""
        if power <= 0:
            return "noise"
        excess = float(power) * len(values)
        parts = ((explained_by(_stacked(rows), values) / excess, group) for group, rows in self.shapes().items())
        return name_dependences(parts, TELLING)


def folded(edges: Array, folds: int, name: str) -> Conditions:
    """Blocks of rows between the numbers `edges` (b + 1,); every so-manieth is held out with it."""
    labels = (np.arange(len(edges) - 1) % folds).astype(np.intp)
    return Conditions(edges - 0.5, labels, tuple(f"{name} {i + 1}/{folds}" for i in range(folds)))


def _stacked(rows: Sequence[tuple[str, Array]]) -> Array:
    return np.stack([shape for _, shape in rows], axis=1)


def acting(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Those causes that do something."""
    return tuple(cause for cause in causes if np.any(cause.values[cause.effect.indices(Role.LINEAR)]))
