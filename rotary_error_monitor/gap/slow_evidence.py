"""Evidence of slow noise beside white noise, by law and size, and of what else may explain the same rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.noise.slow_noise import Cells, SlowNoise
from rotary_error_monitor.noise.whitening import few_at_once

FALLS = (0.5, 1.0)
"""Powers of the order with which the cosines get smaller: noise of density 1/f, and a random walk."""

SIZES = np.geomspace(0.05, 4.0, 24)
"""Root mean squares of slow noise that are weighed, in standard deviations of the white noise. It is an instrument's
noise as long as it is of the size of that: it has a half-normal prior of the stated standard deviation."""

_PRIOR = SIZES * np.exp(-0.5 * np.square(SIZES))
_LOG_PRIOR = np.log(_PRIOR / np.sum(_PRIOR) / len(FALLS))
"""Of each size, by the logarithm of which they are spaced, and of either law."""

SAME = 1e-9
"""Part of the squares of columns below which a sum of them is rounding."""

MANY = 20
"""Columns of one explanation above which a product for each size is faster than the products of all their pairs."""


class WhiteData:
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
class Spectrum:
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
    def of(cls, data: WhiteData, courses: Array, gram: Array, components: int, fall: float) -> Spectrum:
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


@dataclass(frozen=True)
class Explanation:
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
        return self.log_prior + (self.alone if self.beside is None else float(log_sum(self.beside)))


@dataclass(frozen=True)
class ExplainingColumns:
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
    def of(cls, data: WhiteData, columns: Array, count: int | None = None) -> ExplainingColumns:
        """Columns whose amplitudes have priors of one, or where there is a `count` of samples as wide as one of those
        would show them, or as they are seen to be (George and Foster 2000) where that is wider.
        """
        gram, moment = data.products(columns)
        prior = np.eye(columns.shape[2])[None]
        if count:
            power = _squares(_held(gram), moment) / columns.shape[2]
            prior = gram / np.maximum(power, count)[:, None, None] + _rounding(gram)
        return cls(columns, gram, moment, prior, float(np.max(_log_evidence(gram, moment, prior))))

    def explanations(self, found: Sequence[Spectrum], log_prior: float) -> Iterator[Explanation]:
        """The best of them beside slow noise."""
        shown = np.tensordot(found[0].courses, self.columns, (0, 0))
        each = [
            spectrum.log_evidence
            + _log_evidence(*spectrum.products(shown, self.gram, self.moment), self.prior[:, None])
            for spectrum in found
        ]
        beside = np.stack(each, axis=1)
        yield Explanation(log_prior, np.asarray(beside[int(np.argmax(log_sum(beside)))], np.float64))


def log_sum(log_evidence: Array) -> Array:
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
    return np.asarray(gram + _part_of(gram, SAME) + np.finfo(np.float64).tiny * np.eye(gram.shape[-1]), np.float64)


def _rounding(gram: Array) -> Array:
    """What rounding may make of the squares of a sum of columns that is none, from their products (…, p, p).

    A prior that is wide because the data are loud must not be narrower than that there: nothing would hold such a sum.
    """
    return _part_of(gram, 4 * gram.shape[-1] * float(np.finfo(np.float64).eps))


def _part_of(gram: Array, part: float) -> Array:
    """(…, p, p) the same square in each direction, a part of all squares."""
    return np.asarray(part * np.trace(gram, axis1=-2, axis2=-1)[..., None, None] * np.eye(gram.shape[-1]), np.float64)
