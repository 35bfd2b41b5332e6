"""Which head stands where, and which way the stage turns: hypotheses, and how likely each of them is."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.commissioning.response_fit import STRAIGHT, FittedCoefficients
from rotary_error_monitor.commissioning.ring_model import OrderCoefficients, RingFit, RingPrior, fit_ring, orders_of

SWAPPED = 0.005
"""Prior probability that two heads are exchanged: a plug in the wrong socket."""

REVERSED = 0.1
"""Prior probability that something counts against what its description says, where that says nothing: on a data sheet
the sign depends on the side from which one looks."""

STATED = 1e-4
"""The same where the stage file states the sign: somebody looked."""

ODDS = math.log(100)
"""Logarithm of the odds from which a hypothesis counts as told, against any other: 99 % at least."""

MOST_ORDERED = 6
"""Heads of which all orders are weighed; of more only those with two heads exchanged."""

LOOKED_AT = 40
"""Hypotheses that are weighed with all orders, the likeliest by order 1."""


@dataclass(frozen=True)
class Layout:
    """A hypothesis.

    Attributes:
        places: of each head the number of the head at whose azimuth it stands.
        sense: 1 where the first head counts as the stage turns, -1 where it counts the other way.
        mirrored: whether the autocollimator has axes of the wrong hand; False without one.
    """

    places: tuple[int, ...]
    sense: int
    mirrored: bool = False

    @property
    def exchanges(self) -> int:
        """Exchanges of two heads that make these places of the described ones."""
        seen: set[int] = set()
        cycles = 0
        for start in range(len(self.places)):
            cycles += start not in seen
            while start not in seen:
                seen.add(start)
                start = self.places[start]
        return len(self.places) - cycles

    @property
    def moved(self) -> tuple[int, ...]:
        """Heads that do not stand where they are described."""
        return tuple(i for i, place in enumerate(self.places) if i != place)


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its ring and the logarithm of its posterior odds against the likeliest, 0 at most."""

    layout: Layout
    fit: RingFit
    log_odds: float


@dataclass(frozen=True)
class Signs:
    """Signs that are compared with what is described.

    Attributes:
        relative: of each head (and last the command, if there is one) against the first head, 1 or -1.
        described: the same as the file has them, of each itself.
        stated: whether the file states it.
    """

    relative: tuple[int, ...]
    described: tuple[int, ...]
    stated: tuple[bool, ...]

    def log_prior(self, sense: int) -> float:
        """Logarithm of the prior probability of all signs, for a sense of the first head."""
        total = 0.0
        for relative, described, stated in zip(self.relative, self.described, self.stated, strict=True):
            wrong = STATED if stated else REVERSED
            total += math.log(1 - wrong if sense * relative == described else wrong)
        return total


def turned_over(response: FittedCoefficients) -> FittedCoefficients:
    """The response where everything turns the other way: values and rotation change their sign."""
    count = response.coefficients.shape[1]
    flip = np.ones(count)
    flip[0] = -1.0
    flip[STRAIGHT::2] = -1.0
    return replace(
        response,
        coefficients=response.coefficients * flip,
        covariances=response.covariances * np.outer(flip, flip),
        residual=-response.residual,
    )


def weigh_layouts(
    response: FittedCoefficients,
    azimuths: Array,
    priors: Mapping[int, RingPrior],
    signs: Signs,
    handed: Mapping[tuple[int, bool], float] | None = None,
) -> list[Weighed]:
    """The likeliest hypotheses, the likeliest first.

    Args:
        response: of the heads, each counted as the first head counts.
        azimuths: (n,) of the heads as they are described, rad.
        priors: of ring and rotor, by the sense of the first head.
        signs: of heads and command.
        handed: logarithm of the likelihood of the autocollimator by sense and whether it is mirrored, with its prior.
    """
    ways = {1: response, -1: turned_over(response)}
    rough = {sense: orders_of(each, 1) for sense, each in ways.items()}
    whole = {sense: orders_of(each) for sense, each in ways.items()}
    found: list[tuple[float, int, tuple[int, ...], RingFit]] = []
    for sense in (1, -1):
        known = signs.log_prior(sense)
        for places in _places(len(azimuths)):
            fit = fit_ring(rough[sense], azimuths[list(places)], priors[sense])
            found.append((fit.evidence + known + _prior(places), sense, places, fit))
    found.sort(key=lambda each: -each[0])
    kept = found[:LOOKED_AT] + [each for each in found[LOOKED_AT:] if Layout(each[2], each[1]).exchanges < 2]
    return _posterior(kept, whole, azimuths, priors, signs, handed or {(1, False): 0.0, (-1, False): 0.0})


def _posterior(
    kept: Sequence[tuple[float, int, tuple[int, ...], RingFit]],
    whole: Mapping[int, OrderCoefficients],
    azimuths: Array,
    priors: Mapping[int, RingPrior],
    signs: Signs,
    handed: Mapping[tuple[int, bool], float],
) -> list[Weighed]:
    weighed = []
    for _, sense, places, _ in kept:
        fit = fit_ring(whole[sense], azimuths[list(places)], priors[sense])
        for (way, mirrored), likelihood in handed.items():
            if way == sense:
                total = fit.evidence + signs.log_prior(sense) + _prior(places) + likelihood
                weighed.append(Weighed(Layout(places, sense, mirrored), fit, total))
    best = max(each.log_odds for each in weighed)
    weighed = [replace(each, log_odds=each.log_odds - best) for each in weighed]
    return sorted(weighed, key=lambda each: -each.log_odds)


def alternatives(weighed: Sequence[Weighed]) -> tuple[Weighed, ...]:
    """Hypotheses beside the likeliest that the recording does not tell from it."""
    return tuple(each for each in weighed[1:] if each.log_odds > -ODDS)


def _prior(places: tuple[int, ...]) -> float:
    return Layout(places, 1).exchanges * math.log(SWAPPED)


def _places(count: int) -> Iterator[tuple[int, ...]]:
    """The described order first."""
    if count <= MOST_ORDERED:
        yield from itertools.permutations(range(count))
        return
    described = list(range(count))
    yield tuple(described)
    for i, j in itertools.combinations(range(count), 2):
        places = described.copy()
        places[i], places[j] = places[j], places[i]
        yield tuple(places)
