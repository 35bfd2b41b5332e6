"""Slow noise of an instrument beside the white noise that is stated: learnt, in a form that cannot swallow a fault."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import ndtri

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.departure_selection import likeliest_kinds
from rotary_error_monitor.gap.known_effects import KnownEffect
from rotary_error_monitor.gap.normal import solve_scaled
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.posterior import NO_DEPARTURE, PRIOR_OF_UNKNOWN
from rotary_error_monitor.gap.slow_evidence import (
    FALLS,
    SIZES,
    ExplainingColumns,
    Explanation,
    Spectrum,
    WhiteData,
    log_sum,
)

ORDERS = 120
"""Orders of cosines over the recording of which slow noise is made; beyond them what falls with the order is far less
than white noise."""

LARGEST = float(ndtri(1 - FALSE_ALARMS / 2))
"""Size, as it may be and as it is seen, beyond which it is no noise of an instrument: that prior holds it for less
likely than a false alarm may be. A steady drift is seen larger than walks of which it may be one are on average."""

UNDESCRIBED = 2.0
"""Times the squares of white noise: where more is left, something else than slow noise is there, as large as noise."""

STEPS = 160
"""Moments at which a step is looked for: steps that are closer to one another explain nearly the same."""

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
    data = WhiteData(white, weight, uncertain)
    found = _spectra(data, weight, passed)
    if not found:
        return None
    count = int(np.count_nonzero(weight.any(axis=0)))
    best = Explanation(0.0, np.stack([spectrum.log_evidence for spectrum in found]))
    likely = best.log_evidence
    if likely <= 0:
        return None
    others: list[Callable[[], Iterable[Explanation]]] = []
    # Which of them is likelier beside it is asked only where none is in its place: that takes longer.
    unknown = _and_steps(rivals, weight), prior_of_unknown
    for explanation in _in_its_place(data, found, likely, *unknown, known, count, others):
        if explanation.log_evidence > likely:
            return None
    for explanation in itertools.chain.from_iterable(make() for make in others):
        if explanation.log_evidence > best.log_evidence:
            best = explanation
    return _found_as(best, found, data, weight)


def _found_as(best: Explanation, found: list[Spectrum], data: WhiteData, weight: Array) -> Array | None:
    """(q,) slow noise as large as it is beside the best explanation; None as `learn_slow_noise` says."""
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
    found = _spectra(WhiteData(white, weight, uncertain), weight, passed)
    return float(log_sum(np.stack([spectrum.log_evidence for spectrum in found]))) if found else -np.inf


def _spectra(data: WhiteData, weight: Array, passed: Array) -> list[Spectrum]:
    """Slow noise by each law; none of fewer samples than two for each cosine."""
    waves = cosines(passed)
    if np.count_nonzero(weight.any(axis=0)) < 2 * waves.shape[1]:
        return []
    courses = data.whitened(in_all(waves, weight))
    gram = courses.T @ courses
    return [Spectrum.of(data, courses, gram, len(weight), fall) for fall in FALLS]


def _in_its_place(
    data: WhiteData,
    found: Sequence[Spectrum],
    likely: float,
    rivals: Iterable[Rivals],
    prior_of_unknown: float,
    known: Iterable[KnownEffect],
    count: int,
    others: list[Callable[[], Iterable[Explanation]]],
) -> Iterator[Explanation]:
    """What else there may be in the place of slow noise, which alone is as `likely`.

    What makes the explanations beside slow noise is added to `others`, in the same order. Departures of effects that
    were not found come last: their columns take the longest to make.
    """
    departing: list[tuple[KnownEffect, Array, Explanation]] = []
    for alike in rivals:
        for columns in _of_one_width(alike):
            log_prior = float(np.log(prior_of_unknown / len(alike)))
            explained = ExplainingColumns.of(data, data.whitened(columns), count)
            others.append(partial(explained.explanations, found, log_prior))
            yield Explanation(log_prior, None, explained.alone)
    for effect in known:
        own = data.whitened(effect.columns)
        if effect.log_prior is None:
            apart, kinds = _departures(data, effect, own)
            others.append(partial(_each_kind, data, found, apart, kinds))
            yield Explanation(0.0, None, _likelier(data, apart, kinds))
            continue
        explained = ExplainingColumns.of(data, own[:, None], count)
        others.append(partial(explained.explanations, found, effect.log_prior))
        textbook = Explanation(effect.log_prior, None, explained.alone)
        yield textbook
        if explained.alone > (1 - NO_DEPARTURE) * likely:
            departing.append((effect, own, textbook))
    for effect, own, textbook in departing:
        yield replace(textbook, alone=textbook.alone + _likelier(data, *_departures(data, effect, own)))


def _departures(data: WhiteData, effect: KnownEffect, own: Array) -> tuple[Array, Sequence[str]]:
    """Whitened columns (c n, q) of departures of an effect beside its own (c n, p), and their kinds."""
    gram, moment = own.T @ own, own.T @ data.rows
    columns, kinds = effect.departures(solve_scaled(gram, moment))
    if not kinds:
        return np.zeros((len(own), 0)), ()
    shown = data.whitened(columns)
    return shown - own @ solve_scaled(gram, own.T @ shown), kinds


def _likelier(data: WhiteData, apart: Array, kinds: Sequence[str]) -> float:
    """By how much those kinds of departures that are likeliest together make an effect likelier."""
    return likeliest_kinds(apart.T @ apart, apart.T @ data.rows, kinds)[1] if kinds else 0.0


def _each_kind(data: WhiteData, found: Sequence[Spectrum], apart: Array, kinds: Sequence[str]) -> Iterator[Explanation]:
    """Each kind of departures beside slow noise."""
    named = list(dict.fromkeys(kinds))
    for kind in named:
        alike = apart[:, [other == kind for other in kinds]]
        yield from ExplainingColumns.of(data, alike[:, None]).explanations(found, -float(np.log(len(named))))


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
