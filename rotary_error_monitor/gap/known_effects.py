"""Known effects as one instrument shows them, with the ways in which they may depart from their textbook forms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role
from rotary_error_monitor.gap.departures import Departing, Departures, amplitude_sizes
from rotary_error_monitor.gap.problem import Candidate, Columns, Problem, Rows
from rotary_error_monitor.twin.finite import UnpredictableError


class ProblemOfEffects(Problem, Departing, Protocol):
    """A problem that says which effects it knows."""

    @property
    def effects(self) -> Sequence[AnyEffect]:
        """All that may be at work."""


@dataclass(frozen=True)
class KnownEffect:
    """A known effect that may depart from its textbook form.

    Attributes:
        columns: (c n, p) white columns of its amplitudes.
        departures: from amplitudes (p,) white columns (c n, q), one standard deviation of each departure, and its kind.
        log_prior: logarithm of the probability that it is the one that is there beforehand; None for a cause that was
            found, of which only departures are looked for.
    """

    columns: Array
    departures: Callable[[Array], tuple[Array, Sequence[str]]]
    log_prior: float | None = None


class KnownEffects:
    """Known effects beside a set of causes; what does not depend on the instrument is found once for all of them.

    Args:
        problem: recording beside twin.
        causes: that were found.
        rest: what they leave, in which candidates are looked for.
    """

    def __init__(self, problem: ProblemOfEffects, causes: Sequence[Cause], rest: Rows) -> None:
        self._problem, self._causes, self._rest = problem, causes, rest

    @cached_property
    def _departures(self) -> tuple[Departures, ...]:
        return self._problem.departures(self._causes)

    @cached_property
    def _candidates(self) -> tuple[Candidate, ...]:
        return self._problem.candidates(self._rest, self._causes)

    @cached_property
    def _signatures(self) -> list[Columns]:
        """Those of the causes."""
        linear = [cause.effect.indices(Role.LINEAR) for cause in self._causes]
        return [self._problem.signature(c, own, self._causes) for c, own in zip(self._causes, linear, strict=True)]

    def sizes(self, shown: Callable[[Columns], Array]) -> list[Array]:
        """White columns (c n, p) of each cause that was found, its amplitudes as uncertain as they are large.

        Fitted alone they hold a part of what else may be there: beside that they may be of any other size.

        Args:
            shown: as `seen_by`.
        """
        pairs = zip(self._causes, map(shown, self._signatures), strict=True)
        return [columns * amplitude_sizes(cause) for cause, columns in pairs if np.any(columns)]

    def seen_by(self, shown: Callable[[Columns], Array]) -> Iterator[KnownEffect]:
        """Those that an instrument shows, with the ways in which they may depart, causes that were found first.

        Args:
            shown: (c n, p) of columns as the instrument shows them.
        """
        problem = self._problem

        def kept(place: int, departures: Sequence[Departures]) -> tuple[Array, Sequence[str]]:
            own = next((own for own in departures if own.cause == place), None)
            return (shown(own.columns), own.kinds) if own else (np.zeros((0, 0)), ())

        def departures_of(place: int, amplitudes: Array) -> tuple[Array, Sequence[str]]:
            return kept(place, self._departures)

        def departures_at(candidate: Candidate, amplitudes: Array) -> tuple[Array, Sequence[str]]:
            with suppress(UnpredictableError):
                return kept(0, problem.departures((candidate.cause(amplitudes),)))
            return np.zeros((0, 0)), ()

        for place, signature in enumerate(self._signatures):
            columns = shown(signature)
            if np.any(columns):
                yield KnownEffect(columns, partial(departures_of, place))
        for candidate in self._candidates:
            at_zero = candidate.cause(np.zeros(len(candidate.linear)))
            with suppress(UnpredictableError):  # whoever weighs the candidates leaves it out as well, and says so
                columns = shown(problem.signature(at_zero, candidate.linear))
                if np.any(columns):
                    log_prior = candidate.log_prior - float(np.log(len(problem.effects)))
                    yield KnownEffect(columns, partial(departures_at, candidate), log_prior)
