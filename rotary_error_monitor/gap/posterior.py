"""Whether causes that leave something are the causes: known effects with their departures, against something unknown.

Where only noise is left there is nothing to weigh. Where more is left, either the causes are at work, depart from their
textbook forms, and something else may be there beside them; or something unknown is there alone and merely resembles
them. The two are weighed against one another, cause by cause, on the channels that the cause itself acts on.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.special import expit

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.departure_selection import integrated_beside
from rotary_error_monitor.gap.departures import LARGEST_POWER, SHARE, DepartingAsWhole, Departures
from rotary_error_monitor.gap.fitted_departures import FittedDepartures
from rotary_error_monitor.gap.fitting import Fit, stacked_beside
from rotary_error_monitor.gap.hypotheses import price_of
from rotary_error_monitor.gap.normal import combine, solve_scaled, width_of
from rotary_error_monitor.gap.problem import FIRST_ORDER, Columns, Problem, Rows, StructureTest
from rotary_error_monitor.gap.proportion import amplitudes_of, price_of_departures
from rotary_error_monitor.gap.reversals import odds_of_slips

FREE = 3
"""Directions beside that of a cause in which something unknown may lie.

An effect of one order in two components has a cosine and a sine in each: four amplitudes, as most known effects have at
most. Of random directions in four dimensions a part r^(3/2) leaves no more than r of its power beside a given one.
"""

PRIOR_OF_UNKNOWN = 0.02
"""Probability, before a recording is seen, that something no effect describes is at work beside the known ones."""

PRIOR_OF_KNOWN = 0.5
"""Probability that a known effect, whichever, is at work where something unknown is."""

NO_DEPARTURE = 0.5
"""Part of a cause's power: where its textbook form leaves more, departures need not be looked at. They would be of 70 %
of the cause, seven standard deviations of their prior, and something unknown is always likelier."""

CANCELLING = 1e-4
"""Part of a cause's power below which what it does together with others is rounding."""


@runtime_checkable
class Resembled(Protocol):
    """A problem whose recording may be too short for some causes to be told from whatever else is smooth."""

    def independent(self, cause: Cause) -> float:
        """Part of the directions of a cause's form that are independent in the recording, from 0 to 1."""

    def doubt(self, causes: Sequence[Cause]) -> str:
        """Why causes together would fit whatever is at work; empty where they would not."""


Powers = Mapping[str, float]
"""Squares of white rows by channel."""


@dataclass(frozen=True)
class Posterior:
    """Causes with their departures, weighed against something unknown.

    Attributes:
        fit: causes and departures.
        findings: structure that is left, the least likely first.
        log_odds: of each cause, that it is at work and not something unknown in its place, its departures paid for.
        settled: whether only noise is left.
        credit: log odds of each cause that come from nothing unknown being needed beside them.
        near: whether so little is left of any cause that it could be a departure.
        needless: log odds, by name and place of a cause, that it is a departure of the others.
        instead: log odds of something unknown of a form that is known in the place of each cause, priors aside: of what
            is proportional to a quantity, or slipped.
    """

    fit: Fit
    findings: tuple[StructureTest, ...]
    log_odds: tuple[float, ...]
    settled: bool
    near: bool
    credit: float
    needless: Mapping[tuple[str, str], float] = field(default_factory=dict)
    instead: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Log odds of all causes together; what speaks against anything unknown counts once."""
        return sum(self.log_odds) - (len(self.log_odds) - 1) * self.credit

    @property
    def probability(self) -> float:
        """That of the least likely of the causes, or of all together if that is less."""
        return float(expit(min(*self.log_odds, self.total)))

    @property
    def likelier(self) -> bool:
        """Whether each of the causes, and all together, are likelier than something unknown."""
        return self.probability > 0.5


def shown_by(problem: Problem, fit: Fit) -> list[Rows]:
    """White rows (m, 1) of what each cause does in its textbook form."""
    pairs = zip(fit.causes, fit.columns, strict=True)
    return [combine(problem, [columns], [amplitudes_of(cause)]) for cause, columns in pairs]


def powers_of(problem: Problem, fit: Fit) -> list[Powers]:
    """Squares of what each cause does in its textbook form, by channel."""
    return [{channel: float(np.sum(np.square(rows))) for channel, rows in s.items()} for s in shown_by(problem, fit)]


def summed(powers: Sequence[Powers]) -> Powers:
    """Those of all causes together."""
    return {channel: sum(p.get(channel, 0.0) for p in powers) for channel in {c for p in powers for c in p}}


def is_structured(findings: Sequence[StructureTest], log_alarm: float, powers: Powers) -> bool:
    """Whether structure is left that the twin, as accurate as it is, does not leave of what the causes do there."""
    return any(f.exceeds(powers) for f in findings if f.log_p_value < log_alarm)


def weigh_against_unknown(
    problem: Problem, fit: Fit, findings: Sequence[StructureTest], log_alarm: float, effects: int
) -> Posterior:
    """Causes as fitted against something unknown in the place of each.

    Of a cause with fair departures a part `SHARE^2` of its power may be left that no column describes; any part below
    is as likely. Something unknown in `FREE` other directions leaves a part below r of its power beside a cause with
    probability r^(FREE / 2): beside its textbook form, so what departures describe counts as left. Causes that leave
    noise need nothing unknown beside them, which they have credit for.

    Args:
        problem: recording beside twin.
        fit: causes and departures.
        findings: structure that they leave.
        log_alarm: logarithm of the level below which a finding counts.
        effects: number of known effects, any of which might resemble something unknown.
    """
    powers = powers_of(problem, fit)
    whole = summed(powers)
    left = _left_in(problem, fit, [f for f in findings if f.log_p_value < log_alarm], whole)
    shares, cancelled = _shares(fit), times_cancelled(fit)
    settled = not is_structured(
        findings, log_alarm, {**dict.fromkeys(fit.rest, 0.0), **_in_second_order(powers, shares)}
    )
    # Where something unknown is always there, that none is seen beside the causes says nothing for them.
    credit = -float(np.log(PRIOR_OF_UNKNOWN)) if settled and not problem.m_open else 0.0
    prior = float(np.log(PRIOR_OF_KNOWN / effects)) + credit
    log_odds, near = [], False
    # Of causes that cancel one another a departure is a part of what they do together.
    parts = zip(fit.causes, powers, _own_parts(fit), shares * cancelled, strict=True)
    for cause, power, part, share in parts:
        own, total = {channel: part * value for channel, value in power.items()}, sum(power.values()) or 1.0
        fair = max(share, SHARE) ** 2
        kept = {channel: value / (left[channel] + fair * value) for channel, value in own.items()}
        gain = sum(power[channel] / total * float(np.log1p(value)) for channel, value in kept.items())
        near |= _is_near(power, left)
        log_odds.append(0.5 * _free(problem, cause) * gain + prior - 0.5 * float(share / SHARE) ** 2)
    instead = tuple(np.logaddexp(odds_of_slips(problem, fit), _proportional(fit)).tolist())
    return _beside(Posterior(fit, tuple(findings), tuple(log_odds), settled, near, credit, instead=instead), instead)


def _in_second_order(powers: Sequence[Powers], shares: Array) -> Powers:
    """Powers of causes of which a twin of first order leaves as much as of these with their departures.

    Their columns are of first order as well: where two kinds depart together, or an effect that is not linear does,
    half the square of what departs is not in them, of no more than a departure can be.
    """
    grown = np.square(1 + 0.5 * np.minimum(np.square(shares), LARGEST_POWER) / FIRST_ORDER)
    return summed([{c: float(g) * value for c, value in own.items()} for g, own in zip(grown, powers, strict=True)])


def is_likelier_instead(posterior: Posterior) -> bool:
    """Whether something unknown of a form that is known is likelier in the place of a cause."""
    return any(value > _prior_of_known(posterior) for value in posterior.instead)


def _proportional(fit: Fit) -> tuple[float, ...]:
    return fit.proportional or (-np.inf,) * len(fit.causes)


def _prior_of_known(posterior: Posterior) -> float:
    return float(np.log(PRIOR_OF_KNOWN)) + posterior.credit


def beside_proportional(posterior: Posterior, departing: Fit) -> Posterior:
    """Causes weighed as well against what is proportional to a quantity in the place of each, as they depart.

    That is something unknown, and any of the known effects might be the one that it is like. In their textbook forms
    causes need something unknown beside them that does what their departures do: they are no likelier than with those.
    """
    return _beside(posterior, _proportional(departing))


def _beside(posterior: Posterior, instead: Sequence[float]) -> Posterior:
    """Causes weighed as well against what is in the place of each, from log odds of that with equal priors."""
    pairs, prior = zip(posterior.log_odds, instead, strict=True), _prior_of_known(posterior)
    return replace(posterior, log_odds=tuple(-float(np.logaddexp(-odds, value - prior)) for odds, value in pairs))


def _free(problem: Problem, cause: Cause) -> float:
    """Directions beside that of a cause, of those that are independent in the recording."""
    part = problem.independent(cause) if isinstance(problem, Resembled) else 1.0
    return max((FREE + 1) * part - 1, 0.0)


def may_depart(problem: Problem, fit: Fit) -> bool:
    """Whether of any cause in its textbook form so little is left that it could be a departure, or whether one may
    depart as a whole; without looking for structure, which takes as long as a fit.
    """
    powers = powers_of(problem, fit)
    left = _left_in(problem, fit, (), summed(powers))
    whole = isinstance(problem, DepartingAsWhole) and any(problem.departs_as_whole(cause) for cause in fit.causes)
    return whole or any(_is_near(power, left) for power in powers)


def _is_near(power: Powers, left: Powers) -> bool:
    """Whether so little is left of what a cause does that it could be a departure."""
    total = sum(power.values()) or 1.0
    beside = sum(value / total * float(np.log1p(value / left[channel])) for channel, value in power.items())
    return bool(beside > np.log1p(1 / NO_DEPARTURE))


def _left_in(problem: Problem, fit: Fit, findings: Sequence[StructureTest], powers: Powers) -> dict[str, float]:
    """Squares beyond noise that are left in each channel: those of structure, or of all rows where these are more.

    Not less than what noise alone has in as many directions as something unknown. What is found in no single channel
    (uncertain parameters moved too far, poses that scatter) counts in all of them, as the causes' own power does.
    """
    left = {}
    for channel, rows in fit.rest.items():
        expected = float(np.sum(problem.expected(channel)))
        beyond = float(np.sum(np.square(rows))) - expected - 2 * float(np.sqrt(2 * expected))
        left[channel] = max(float(FREE), beyond, *(f.excess for f in findings if f.channel == channel))
    nowhere = max((f.excess for f in findings if f.channel not in left), default=0.0)
    total = sum(powers.values()) or 1.0
    return {channel: value + nowhere * powers.get(channel, 0.0) / total for channel, value in left.items()}


def _shares(fit: Fit) -> Array:
    """Share of each cause that its best textbook form leaves and its departures describe.

    It is the share beyond the best textbook form, so that departures do not take the place of the cause's own
    parameters (Plumlee, JASA 112, 2017), and many columns cost no more than one that does the same. Kinds that cancel
    one another are each as large as they are: that they leave little makes them no likelier.
    """
    squares = np.zeros(len(fit.causes))
    for fitted in departures_of(fit):
        squares[fitted.departures.cause] += fitted.size() ** 2
    return np.sqrt(squares)


def times_cancelled(fit: Fit) -> Array:
    """(k,) how many times larger each cause is than what it does together with those that cancel it, at least one.

    Two that nearly cancel may each be of any size, and a tenth of each as large as all that is there: a departure of
    that is no fair one of what a recording shows.
    """
    gram, first = fit.blocks.total().gram, len(fit.nuisance_values)
    places = first + np.concatenate([[0], np.cumsum([width_of(columns) for columns in fit.columns])]).astype(np.intp)
    last, count = int(places[-1]), len(fit.causes)
    acting = np.zeros((count, last))
    for k, cause in enumerate(fit.causes):
        acting[k, places[k] : places[k + 1]] = amplitudes_of(cause)
    products = acting @ gram[:last, :last] @ acting.T
    sets = np.array([*itertools.product([0.0, 1.0], repeat=count)])
    together = np.einsum("sk,kl,sl->s", sets, products, sets)
    powers = np.diag(products)
    least = np.array([np.min(together[sets[:, k] > 0]) for k in range(count)])
    shown = np.maximum(least, np.maximum(powers * CANCELLING, np.finfo(np.float64).tiny))
    return np.asarray(np.sqrt(np.maximum(powers / shown, 1.0)), np.float64)


def _own_parts(fit: Fit) -> list[float]:
    """Part of each cause's power that neither uncertain parameters nor other causes, as they depart, can take."""
    total, count = fit.blocks.total(), len(fit.nuisance_values)
    widths = [width_of(columns) for columns in fit.columns]
    departing = [len(d.kinds) for d in fit.departures]
    prior = np.repeat([1.0, 1e-12, 1.0], [count, sum(widths), sum(departing)])
    # A cause that is not there does not depart either.
    owner = np.repeat([-1, *range(len(widths)), *(d.cause for d in fit.departures)], [count, *widths, *departing])
    places = count + np.concatenate([[0], np.cumsum(widths)]).astype(np.intp)
    found = []
    for k, cause in enumerate(fit.causes):
        own, others = np.arange(places[k], places[k + 1]), np.flatnonzero(owner != k)
        amplitudes = amplitudes_of(cause)
        shown = total.gram[:, own] @ amplitudes
        whole = float(shown[own] @ amplitudes)
        inner = total.gram[np.ix_(others, others)] + np.diag(prior[others])
        taken = float(shown[others] @ solve_scaled(inner, shown[others]))
        found.append(float(np.clip((whole - taken) / whole, 0.0, 1.0)) if whole > 0 else 0.0)
    return found


def marginal_likelihood(fit: Fit) -> float:
    """Logarithm of the marginal likelihood of causes with their departures, priors of their places aside.

    As that of the table (`hypotheses.py`), with what the departures' columns cost by their priors.
    """
    gram = fit.blocks.total().gram
    widths = len(fit.nuisance_values), sum(map(width_of, fit.columns)), len(fit.departure_values)
    place, powers = widths[0], []
    for cause, columns in zip(fit.causes, fit.columns, strict=True):
        own = slice(place, place := place + width_of(columns))
        powers.append(amplitudes_of(cause) @ gram[own, own] @ amplitudes_of(cause))
    counts = np.array([len(cause.effect.indices(Role.LINEAR)) for cause in fit.causes])
    price = price_of_departures(gram, *widths[:2]) + float(np.sum(price_of(np.array(powers), counts)))
    return fit.log_prior - 0.5 * fit.squares - price


def reductions_beside(problem: Problem, fit: Fit, columns: Columns) -> tuple[Powers, int]:
    """Squares that columns take away of what a fit leaves, by channel, and the number of columns that show."""
    gram, moment = integrated_beside(fit, stacked_beside(problem, fit, [columns]).total())
    shown = np.diag(gram) > 0
    amplitudes = np.zeros(len(moment))
    amplitudes[shown] = solve_scaled(gram[np.ix_(shown, shown)], moment[shown])
    taken = combine(problem, [columns], [amplitudes])
    reductions = {channel: max(float(np.sum(rows * fit.rest[channel])), 0.0) for channel, rows in taken.items()}
    return reductions, max(int(shown.sum()), 1)


def departures_of(fit: Fit) -> list[FittedDepartures]:
    """Departures of a fit with their values, beside the best textbook form of each cause."""
    first = len(fit.nuisance_values)
    gram = fit.blocks.total().gram[first:, first:] if fit.sizes is None else fit.sizes
    places = np.concatenate([[0], np.cumsum([width_of(columns) for columns in fit.columns])]).astype(np.intp)
    found, start = [], 0
    for departures in fit.departures:
        values = fit.departure_values[start : start + len(departures.kinds)]
        own = slice(places[departures.cause], places[departures.cause + 1])
        apart = slice(places[-1] + start, places[-1] + start + len(values))
        start += len(values)
        taken = solve_scaled(gram[own, own], gram[own, apart])
        products = gram[apart, apart] - gram[apart, own] @ taken
        textbook = amplitudes_of(fit.causes[departures.cause]) + taken @ values
        size = float(textbook @ gram[own, own] @ textbook) or 1.0
        grown, beside = _sizes_beside(gram[own, own], amplitudes_of(fit.causes[departures.cause]), departures, size)
        found.append(FittedDepartures(departures, values, products / size, grown, beside))
    return found


def _sizes_beside(gram: Array, amplitudes: Array, departures: Departures, textbook: float) -> tuple[float, float]:
    """Size of a cause with the amplitudes that it has beside its departures, over that which their columns are for and
    over that of its best textbook form, of which the squares are given.
    """
    before = departures.made_for
    if not departures.whole or not (was := float(before @ gram @ before)) > 0.0:
        return 1.0, 1.0
    squares = float(amplitudes @ gram @ amplitudes)
    return float(np.sqrt(squares / was)), float(np.sqrt(squares / textbook))
