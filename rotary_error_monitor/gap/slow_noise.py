"""Slow noise of an instrument beside the white noise that is stated: learnt, in a form that cannot swallow a fault."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.problem import Array
from rotary_error_monitor.twin.slow_noise import Cells, SlowNoise

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

STEPS = 160
"""Moments at which a step is looked for: steps that are closer to one another explain nearly the same."""

SAME = 1e-9
"""Part of the squares of columns below which a sum of them is rounding."""

Rivals = Sequence[Array]
"""White columns (c n, p) of each of several explanations, of which any one may hold, all as likely."""


def cosines(passed: Array) -> Array:
    """(n, q) constant and cosines at parts (n,) of the recording, each with a mean square of one."""
    orders = np.arange(min(ORDERS, len(passed) // 4) + 1)
    return np.asarray(np.sqrt(np.where(orders > 0, 2.0, 1.0)) * np.cos(np.pi * passed[:, None] * orders), np.float64)


def in_all(columns: Array, weight: Array) -> Array:
    """Courses (n, p) of every component on its own, as samples of weight (c, n) show them: (c n, c p)."""
    return np.asarray(np.kron(np.eye(len(weight)), columns) * weight.reshape(-1, 1), np.float64)


def by_kind(columns: Array, kinds: Sequence[str]) -> Rivals:
    """Columns (c n, q), those of one kind together."""
    named = np.asarray(kinds)
    return [columns[:, named == kind] for kind in dict.fromkeys(kinds)]


def learn_slow_noise(
    white: Array, weight: Array, passed: Array, uncertain: Array, rivals: Iterable[Rivals]
) -> Array | None:
    """Slow noise that the components of one instrument show beside white noise, each a course of its own.

    There is some where it is likelier than none, all cosines and sizes integrated out, unless one of the explanations
    in `rivals`, or a step somewhere, is likelier in its place or at work beside it, with odds above those of a false
    alarm (Schwarz's criterion for each): what those can explain, even in part, is a fault, and no noise. What stands
    out less beside slow noise would not be found beside it either.

    Args:
        white: (c, n) what is left, in standard deviations of the stated noise; c components.
        weight: (c, n) what a course of one adds to it; 0 where there is no sample.
        passed: (n,) part of the recording that has passed.
        uncertain: (c n, u) one standard uncertainty of each parameter of the twin, components one after the other.
        rivals: what else there may be; looked at only where slow noise shows.

    Returns:
        (q,) standard deviation of each of the `cosines`; None where no slow noise shows.
    """
    waves = cosines(passed)
    count = int(np.count_nonzero(weight.any(axis=0)))
    if count < 2 * waves.shape[1]:
        return None
    data = _Data(white, weight, uncertain)
    courses = data.whitened(in_all(waves, weight))
    found = [_Spectrum.of(data, courses, len(white), fall) for fall in FALLS]
    log_evidence = np.stack([spectrum.log_evidence for spectrum in found])
    likely = _log_sum(log_evidence)
    if likely <= 0:
        return None
    for alike in _and_steps(rivals, weight):
        for columns in _of_one_width(alike):
            own = data.whitened(columns)
            beside = [spectrum.log_evidence + spectrum.reduction(data, own) for spectrum in found]
            most = max(float(np.max(data.reduction(own))), float(np.max(_log_sum(np.stack(beside, axis=1)))))
            price = 0.5 * columns.shape[2] * np.log(count) + np.log(len(alike))
            if most - price + np.log(FALSE_ALARMS) > likely:
                return None
    law, size = np.unravel_index(int(np.argmax(log_evidence)), log_evidence.shape)
    return np.asarray(SIZES[size] * found[law].shape, np.float64)


class _Data:
    """White rows beside uncertain parameters, which are integrated out.

    Attributes:
        rows: (c n,) what is left.
    """

    def __init__(self, white: Array, weight: Array, uncertain: Array) -> None:
        self._used = weight.reshape(-1, 1) > 0
        self._uncertain = SlowNoise(Cells(np.arange(len(uncertain)), self._used[:, 0].astype(np.float64)), uncertain)
        self.rows = self.whitened(white.reshape(-1, 1))[:, 0]

    def whitened(self, columns: Array) -> Array:
        """White columns (c n, …) with uncertain parameters integrated out, as slow courses are."""
        return self._uncertain.whiten(np.where(self._used, columns.reshape(len(columns), -1), 0.0)).reshape(
            columns.shape
        )

    def reduction(self, columns: Array) -> Array:
        """(m,) half the squares that whitened columns (c n, m, p) of any size take away."""
        return _reduction(np.einsum("nmp,nmq->mpq", columns, columns), np.einsum("nmp,n->mp", columns, self.rows))


@dataclass(frozen=True)
class _Spectrum:
    """Slow noise that falls by one law, at each of the `SIZES`.

    Attributes:
        shape: (q,) size of each cosine, together a root mean square of one.
        directions: (c n, r) principal directions of all components' cosines, times their singular values.
        powers: (r,) squares of those.
        shown: (r,) products of the directions with the rows.
        log_evidence: (sizes,) logarithm of the marginal likelihood of each size, with its prior, relative to no slow
            noise.
    """

    shape: Array
    directions: Array
    powers: Array
    shown: Array
    log_evidence: Array

    @classmethod
    def of(cls, data: _Data, courses: Array, components: int, fall: float) -> _Spectrum:
        """From whitened cosines (c n, c q) of all components."""
        shape = np.maximum(np.arange(courses.shape[1] // components), 1.0) ** -fall
        shape /= np.linalg.norm(shape)
        own = courses * np.tile(shape, components)
        powers, vectors = np.linalg.eigh(own.T @ own)
        powers, directions = np.maximum(powers, 0.0), own @ vectors
        shown = directions.T @ data.rows
        widths = np.square(SIZES)[:, None]
        spread = 1 + widths * powers
        evidence = 0.5 * np.sum(widths * np.square(shown) / spread - np.log(spread), axis=1)
        return cls(shape, directions, powers, shown, evidence + _LOG_PRIOR)

    def reduction(self, data: _Data, columns: Array) -> Array:
        """(m, sizes) half the squares that whitened columns (c n, m, p) of any size take away beside slow noise."""
        widths = np.square(SIZES)[:, None]
        taken = widths / (1 + widths * self.powers)
        cross = np.tensordot(self.directions, columns, (0, 0))
        products = np.einsum("rmp,rmq->mpqr", cross, cross)
        gram = np.einsum("nmp,nmq->mpq", columns, columns)[:, None] - np.moveaxis(products @ taken.T, -1, 1)
        moments = np.moveaxis(cross * self.shown[:, None, None], 0, -1) @ taken.T
        moment = np.einsum("nmp,n->mp", columns, data.rows)[:, None] - np.moveaxis(moments, -1, 1)
        return _reduction(gram, moment)


def _log_sum(log_evidence: Array) -> Array:
    """(…) logarithm of the sum of evidence (…, laws, sizes)."""
    return np.asarray(logsumexp(log_evidence, axis=(-2, -1)), np.float64)


def _reduction(gram: Array, moment: Array) -> Array:
    """(…) half the squares that columns with products (…, p, p) take of data with products (…, p)."""
    trace = np.trace(gram, axis1=-2, axis2=-1)[..., None, None]
    held = gram + (SAME * trace + np.finfo(np.float64).tiny) * np.eye(gram.shape[-1])
    return np.asarray(0.5 * np.sum(moment * np.linalg.solve(held, moment[..., None])[..., 0], axis=-1), np.float64)


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
