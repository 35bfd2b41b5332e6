"""Slow noise of an instrument beside the white noise that is stated: learnt, in a form that cannot swallow a fault."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import logsumexp, ndtri

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.departure_selection import likeliest_kinds
from rotary_error_monitor.gap.known_effects import KnownEffect
from rotary_error_monitor.gap.normal import solve_scaled
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.posterior import NO_DEPARTURE, PRIOR_OF_UNKNOWN
from rotary_error_monitor.noise.slow_noise import Cells, SlowNoise
from rotary_error_monitor.noise.whitening import few_at_once

ORDERS = 120
"""Orders of cosines over the recording of which slow noise is made; beyond them what falls with the order is far less
than white noise."""

FALLS = (0.5, 1.0)
"""Powers of the order with which the cosines get smaller: noise of density 1/f, and a random walk."""

SIZES = np.geomspace(0.05, 4.0, 24)
"""Root mean squares of slow noise that are weighed, in standard deviations of the white noise. It is an instrument's
noise as long as it is of the size of that: it has a half-normal prior of the stated standard deviation."""

_PRIOR = SIZES * np.exp(-0.5 * np.square(SIZES))
_LOG_PRIOR = np.log(_PRIOR / np.sum(_PRIOR) / len(FALLS))
"""Of each size, by the logarithm of which they are spaced, and of either law."""

LARGEST = float(ndtri(1 - FALSE_ALARMS / 2))
"""Size, as it may be and as it is seen, beyond which it is no noise of an instrument: that prior holds it for less
likely than a false alarm may be. A steady drift is seen larger than walks of which it may be one are on average."""

UNDESCRIBED = 2.0
"""Times the squares of white noise: where more is left, something else than slow noise is there, as large as noise."""

STEPS = 160
"""Moments at which a step is looked for: steps that are closer to one another explain nearly the same."""

SAME = 1e-9
"""Part of the squares of columns below which a sum of them is rounding."""

MANY = 20
"""Columns of one explanation above which a product for each size is faster than the products of all their pairs."""

Rivals = Sequence[Array]
"""White columns (c n, p) of each of several explanations that are no known effect, all as likely."""


def cosines(passed: Array) -> Array:
    """(n, q) constant and cosines at parts (n,) of the recording, each with a mean square of one."""
    orders = np.arange(min(ORDERS, len(passed) // 4) + 1)
    return np.asarray(np.sqrt(np.where(orders > 0, 2.0, 1.0)) * np.cos(np.pi * passed[:, None] * orders), np.float64)


def in_all(columns: Array, weight: Array) -> Array:
    """Courses (n, p) of every component on its own, as samples of weight (c, n) show them: (c n, c p)."""
    count, (rows, width) = len(weight), columns.shape
    all_of = np.zeros((count, rows, count, width))
    for own in range(count):
        np.multiply(columns, weight[own][:, None], out=all_of[own, :, own])
    return all_of.reshape(count * rows, count * width)


def learn_slow_noise(
    white: Array,
    weight: Array,
    passed: Array,
    uncertain: Array,
    rivals: Iterable[Rivals],
    known: Iterable[KnownEffect] = (),
    prior_of_unknown: float = PRIOR_OF_UNKNOWN,
) -> Array | None:
    """Slow noise that the components of one instrument show beside white noise, each a course of its own.

    All cosines and sizes are integrated out. Where one of the explanations in `rivals`, a step somewhere, or a known
    effect as it may depart, is likelier in its place, there is no slow noise: what a fault explains is none. Where one
    is likelier beside it, it is as large as it is beside the likeliest: it takes no part of what else is there. Slow
    noise is as likely beforehand as known effects are together. Where more than noise is left of the likeliest, none
    of them describes the data, and nothing is learnt from it.

    Args:
        white: (c, n) what is left, in standard deviations of the stated noise; c components.
        weight: (c, n) what a course of one adds to it; 0 where there is no sample.
        passed: (n,) part of the recording that has passed.
        uncertain: (c n, u) one standard uncertainty of each parameter of the twin, components one after the other.
        rivals: what else there may be; looked at only where slow noise shows.
        known: effects, and causes that were found, that may depart; likewise.
        prior_of_unknown: probability beforehand that something of each list in `rivals` is there.

    Returns:
        (q,) standard deviation of each of the `cosines`; None where none shows, or more than an instrument has.
    """
    data = _Data(white, weight, uncertain)
    found = _spectra(data, weight, passed)
    if not found:
        return None
    count = int(np.count_nonzero(weight.any(axis=0)))
    best = _Explanation(0.0, np.stack([spectrum.log_evidence for spectrum in found]))
    likely = best.log_evidence
    if likely <= 0:
        return None
    others: list[Callable[[], Iterable[_Explanation]]] = []
    # Which of them is likelier beside it is asked only where none is in its place: that takes longer.
    unknown = _and_steps(rivals, weight), prior_of_unknown
    for explanation in _in_its_place(data, found, likely, *unknown, known, count, others):
        if explanation.log_evidence > likely:
            return None
    for explanation in itertools.chain.from_iterable(make() for make in others):
        if explanation.log_evidence > best.log_evidence:
            best = explanation
    assert best.beside is not None
    law, size = np.unravel_index(int(np.argmax(best.beside)), best.beside.shape)
    if max(SIZES[size], found[law].seen(SIZES[size], len(weight))) > LARGEST:
        return None
    taken = 2 * float(best.beside[law, size] - found[law].log_evidence[size]) + found[law].squares(SIZES[size])
    if float(data.rows @ data.rows) - taken > UNDESCRIBED * np.count_nonzero(weight):
        return None
    return np.asarray(SIZES[size] * found[law].shape, np.float64)


def evidence_of_slow_noise(white: Array, weight: Array, passed: Array, uncertain: Array) -> float:
    """Log marginal likelihood of slow noise over that of none, whatever else may be there; arguments as above.

    Of several ways in which a course may add to the samples it tells the likeliest.
    """
    found = _spectra(_Data(white, weight, uncertain), weight, passed)
    return float(_log_sum(np.stack([spectrum.log_evidence for spectrum in found]))) if found else -np.inf


def _spectra(data: _Data, weight: Array, passed: Array) -> list[_Spectrum]:
    """Slow noise by each law; none of fewer samples than two for each cosine."""
    waves = cosines(passed)
    if np.count_nonzero(weight.any(axis=0)) < 2 * waves.shape[1]:
        return []
    courses = data.whitened(in_all(waves, weight))
    gram = courses.T @ courses
    return [_Spectrum.of(data, courses, gram, len(weight), fall) for fall in FALLS]


@dataclass(frozen=True)
class _Explanation:
    """What rows may show beside white noise.

    Attributes:
        log_prior: logarithm of its probability beforehand, relative to that of slow noise alone.
        beside: (laws, sizes) log evidence beside slow noise; None without any.
        alone: log evidence without any.
    """

    log_prior: float
    beside: Array | None
    alone: float = -np.inf

    @property
    def log_evidence(self) -> float:
        """Prior included, all sizes integrated out."""
        return self.log_prior + (self.alone if self.beside is None else float(_log_sum(self.beside)))


def _in_its_place(
    data: _Data,
    found: Sequence[_Spectrum],
    likely: float,
    rivals: Iterable[Rivals],
    prior_of_unknown: float,
    known: Iterable[KnownEffect],
    count: int,
    others: list[Callable[[], Iterable[_Explanation]]],
) -> Iterator[_Explanation]:
    """What else there may be in the place of slow noise, which alone is as `likely`.

    What makes the explanations beside slow noise is added to `others`, in the same order. Departures of effects that
    were not found come last: their columns take the longest to make.
    """
    departing: list[tuple[KnownEffect, Array, _Explanation]] = []
    for alike in rivals:
        for columns in _of_one_width(alike):
            log_prior = float(np.log(prior_of_unknown / len(alike)))
            explained = _Columns.of(data, data.whitened(columns), count)
            others.append(partial(explained.explanations, found, log_prior))
            yield _Explanation(log_prior, None, explained.alone)
    for effect in known:
        own = data.whitened(effect.columns)
        if effect.log_prior is None:
            apart, kinds = _departures(data, effect, own)
            others.append(partial(_each_kind, data, found, apart, kinds))
            yield _Explanation(0.0, None, _likelier(data, apart, kinds))
            continue
        explained = _Columns.of(data, own[:, None], count)
        others.append(partial(explained.explanations, found, effect.log_prior))
        textbook = _Explanation(effect.log_prior, None, explained.alone)
        yield textbook
        if explained.alone > (1 - NO_DEPARTURE) * likely:
            departing.append((effect, own, textbook))
    for effect, own, textbook in departing:
        yield replace(textbook, alone=textbook.alone + _likelier(data, *_departures(data, effect, own)))


@dataclass(frozen=True)
class _Columns:
    """Whitened columns of explanations of as many columns each.

    Attributes:
        columns: (c n, m, p) of each of m explanations.
        gram: (m, p, p) products of those with one another.
        moment: (m, p) of those with the data.
        prior: (m or 1, p, p) inverse of the covariance of their amplitudes beforehand.
        alone: log evidence of the best, in the place of slow noise.
    """

    columns: Array
    gram: Array
    moment: Array
    prior: Array
    alone: float

    @classmethod
    def of(cls, data: _Data, columns: Array, count: int | None = None) -> _Columns:
        """Columns whose amplitudes have priors of one, or where there is a `count` of samples as wide as one of those
        would show them, or as they are seen to be (George and Foster 2000) where that is wider.
        """
        gram, moment = data.products(columns)
        prior = np.eye(columns.shape[2])[None]
        if count:
            power = _squares(_held(gram), moment) / columns.shape[2]
            prior = gram / np.maximum(power, count)[:, None, None]
        return cls(columns, gram, moment, prior, float(np.max(_log_evidence(gram, moment, prior))))

    def explanations(self, found: Sequence[_Spectrum], log_prior: float) -> Iterator[_Explanation]:
        """The best of them beside slow noise."""
        shown = np.tensordot(found[0].courses, self.columns, (0, 0))
        each = [
            spectrum.log_evidence
            + _log_evidence(*spectrum.products(shown, self.gram, self.moment), self.prior[:, None])
            for spectrum in found
        ]
        beside = np.stack(each, axis=1)
        yield _Explanation(log_prior, np.asarray(beside[int(np.argmax(_log_sum(beside)))], np.float64))


def _departures(data: _Data, effect: KnownEffect, own: Array) -> tuple[Array, Sequence[str]]:
    """Whitened columns (c n, q) of departures of an effect beside its own (c n, p), and their kinds."""
    gram, moment = own.T @ own, own.T @ data.rows
    columns, kinds = effect.departures(solve_scaled(gram, moment))
    if not kinds:
        return np.zeros((len(own), 0)), ()
    shown = data.whitened(columns)
    return shown - own @ solve_scaled(gram, own.T @ shown), kinds


def _likelier(data: _Data, apart: Array, kinds: Sequence[str]) -> float:
    """By how much those kinds of departures that are likeliest together make an effect likelier."""
    return likeliest_kinds(apart.T @ apart, apart.T @ data.rows, kinds)[1] if kinds else 0.0


def _each_kind(data: _Data, found: Sequence[_Spectrum], apart: Array, kinds: Sequence[str]) -> Iterator[_Explanation]:
    """Each kind of departures beside slow noise."""
    named = list(dict.fromkeys(kinds))
    for kind in named:
        alike = apart[:, [other == kind for other in kinds]]
        yield from _Columns.of(data, alike[:, None]).explanations(found, -float(np.log(len(named))))


class _Data:
    """White rows beside uncertain parameters, which are integrated out.

    Attributes:
        rows: (c n,) what is left.
    """

    def __init__(self, white: Array, weight: Array, uncertain: Array) -> None:
        self._used = weight.reshape(-1, 1) != 0
        self._uncertain = SlowNoise(Cells(np.arange(len(uncertain)), self._used[:, 0].astype(np.float64)), uncertain)
        self.rows = self.whitened(white.reshape(-1, 1))[:, 0]

    def whitened(self, columns: Array) -> Array:
        """White columns (c n, …) with uncertain parameters integrated out, as slow courses are."""
        return self._uncertain.whiten(np.where(self._used, columns.reshape(len(columns), -1), 0.0)).reshape(
            columns.shape
        )

    def products(self, columns: Array) -> tuple[Array, Array]:
        """(m, p, p) of whitened columns (c n, m, p) with one another, and (m, p) with the data."""
        return _products(columns), np.tensordot(self.rows, columns, 1)


@dataclass(frozen=True)
class _Spectrum:
    """Slow noise that falls by one law, at each of the `SIZES`.

    Attributes:
        shape: (q,) size of each cosine, together a root mean square of one.
        courses: (c n, c q) whitened cosines of all components, which all laws have.
        directions: (c q, r) principal directions of all components' cosines, times their singular values, as sums of
            those.
        powers: (r,) squares of those.
        shown: (r,) products of the directions with the rows.
        log_evidence: (sizes,) logarithm of the marginal likelihood of each size, with its prior, relative to no slow
            noise.
    """

    shape: Array
    courses: Array
    directions: Array
    powers: Array
    shown: Array
    log_evidence: Array

    @classmethod
    def of(cls, data: _Data, courses: Array, gram: Array, components: int, fall: float) -> _Spectrum:
        """From whitened cosines (c n, c q) of all components, and their products with one another."""
        shape = np.maximum(np.arange(courses.shape[1] // components), 1.0) ** -fall
        shape /= np.linalg.norm(shape)
        sizes = np.tile(shape, components)
        powers, vectors = np.linalg.eigh(gram * np.outer(sizes, sizes))
        powers, directions = np.maximum(powers, 0.0), sizes[:, None] * vectors
        shown = directions.T @ (courses.T @ data.rows)
        widths = np.square(SIZES)[:, None]
        spread = 1 + widths * powers
        evidence = 0.5 * np.sum(widths * np.square(shown) / spread - np.log(spread), axis=1)
        return cls(shape, courses, directions, powers, shown, evidence + _LOG_PRIOR)

    def squares(self, size: float) -> float:
        """That slow noise of a size takes of the data."""
        return float(np.sum(size**2 * np.square(self.shown) / (1 + size**2 * self.powers)))

    def seen(self, size: float, components: int) -> float:
        """Standard deviation of the courses of slow noise of a size as the data show them, of one of the components."""
        courses = (self.directions @ (size**2 * self.shown / (1 + size**2 * self.powers))).reshape(components, -1)
        return float(np.sqrt(np.sum(np.square(courses[:, 1:])) / components))

    def products(self, shown: Array, own: Array, with_data: Array) -> tuple[Array, Array]:
        """(m, sizes, p, p) and (m, sizes, p) products of columns beside slow noise of each size.

        Args:
            shown: (c q, m, p) products of the cosines with the columns.
            own: (m, p, p) of the columns with one another without slow noise.
            with_data: (m, p) of them with the data.
        """
        widths = np.square(SIZES)[:, None]
        taken = widths / (1 + widths * self.powers)
        cross = np.tensordot(self.directions, shown, (0, 0))
        moments = np.tensordot(taken * self.shown, cross, 1)
        if own.shape[1] > MANY:
            each = np.moveaxis(cross, 1, 0)
            gram = np.stack([np.swapaxes(each, 1, 2) @ (part[:, None] * each) for part in taken], axis=1)
            return own[:, None] - gram, with_data[:, None] - np.moveaxis(moments, 0, 1)
        gram = np.empty((len(own), len(SIZES), *own.shape[1:]))
        first, second = np.triu_indices(own.shape[1])
        # A group of members at a time: the products of all would fill the memory.
        for members in few_at_once(len(own), len(cross) * len(first)):
            part = cross[:, members]
            made = np.moveaxis(np.tensordot(taken, part[:, :, first] * part[:, :, second], 1), 0, 1)
            gram[members, :, first, second] = gram[members, :, second, first] = made
        return own[:, None] - gram, with_data[:, None] - np.moveaxis(moments, 0, 1)


def _log_sum(log_evidence: Array) -> Array:
    """(…) logarithm of the sum of evidence (…, laws, sizes)."""
    return np.asarray(logsumexp(log_evidence, axis=(-2, -1)), np.float64)


def _products(columns: Array) -> Array:
    """(m, p, p) of columns (c n, m, p) with one another."""
    each = np.moveaxis(columns, 1, 0)
    return np.asarray(np.swapaxes(each, 1, 2) @ each, np.float64)


def _log_evidence(gram: Array, moment: Array, prior: Array) -> Array:
    """(…) logarithm of the marginal likelihood of columns, relative to none of them.

    Args:
        gram: (…, p, p) products of columns with one another.
        moment: (…, p) of columns with data.
        prior: (…, p, p) inverse of the covariance of their amplitudes beforehand.
    """
    held = _held(prior)
    cost = np.linalg.slogdet(held + gram)[1] - np.linalg.slogdet(held)[1]
    return np.asarray(0.5 * (_squares(held + gram, moment) - cost), np.float64)


def _squares(gram: Array, moment: Array) -> Array:
    """(…) that columns with products (…, p, p) take of data with products (…, p)."""
    return np.asarray(np.sum(moment * np.linalg.solve(gram, moment[..., None])[..., 0], axis=-1), np.float64)


def _held(gram: Array) -> Array:
    """Products (…, p, p) of columns, some of which may be sums of others."""
    trace = np.trace(gram, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(gram + (SAME * trace + np.finfo(np.float64).tiny) * np.eye(gram.shape[-1]), np.float64)


def _of_one_width(rivals: Rivals) -> list[Array]:
    """Columns (c n, m, p) of the m members of each width p."""
    widths = sorted({columns.shape[1] for columns in rivals})
    return [np.stack([c for c in rivals if c.shape[1] == width], axis=1) for width in widths]


def _and_steps(rivals: Iterable[Rivals], weight: Array) -> Iterator[Rivals]:
    """Steps come last: what is known is likelier to be at work, and the first that is ends the search."""
    yield from rivals
    yield _steps(weight)


def _steps(weight: Array) -> Rivals:
    """A step of every component at once after each sample but the first two and the last, or after `STEPS` of them."""
    begins, place = np.flatnonzero(weight.any(axis=0))[2:-1], np.arange(weight.shape[1])
    begins = begins[:: max(1, len(begins) // STEPS)]
    return [in_all((place >= begin)[:, None].astype(np.float64), weight) for begin in begins]
