"""What of some signals repeats with a rotation: which orders stand out, how large they are, and how sure that is.

Signals (n, c) over rotations (n,) are fitted by a constant and by cosine and sine of whole orders. Whatever the colour
of the noise, least squares is nearly as good as any weighting here (Grenander and Rosenblatt 1957). Its covariance is
that of white noise, scaled order by order by how much more noise there is near that order, as batches of the residual
of growing length show it (the method of batch means).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import gammainccinv, gammaincinv

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.distributions import f_tail

Shapes = NDArray[np.complex128]

FALSE_ALARM = 1e-3
"""Probability that a recording that holds nothing else shows an order that is not there, or is found not to fit."""

HIGHEST = 256
"""Highest order looked for: an encoder's head averages over some hundredth of a ring's circumference."""

BINS = 4096
"""Parts of a turn in which signals are summed up to look for orders; 16 to a wave of the highest."""

WINDOW = 16
"""Orders to either side whose median power is the background of one: it changes over so many, not from one to one."""

REPEATED_BINS = 256
"""Parts of a turn in which a residual is compared with itself: what repeats in finer ones is averaged anyway."""

FEWEST_BATCHES = 12
"""Longest batches are a twelfth of the recording: with fewer their scatter would tell nothing."""

BATCHES = 4096
"""Shortest batches, so that a long recording takes no more memory than a short one."""

CHUNK = 20_000
"""Rows of a design matrix at a time."""

LEAST_EIGENVALUE = 0.1
"""Smallest eigenvalue of the orders' mutual correlation: below it, rotations leave gaps that grow noise threefold."""


@dataclass(frozen=True)
class OrderFit:
    """Orders fitted to signals.

    Attributes:
        orders: k of them, the constant not among them.
        coefficients: (1 + 2 k, c) constant, then cosine and sine of each order.
        inverse: (1 + 2 k, 1 + 2 k) of the normal matrix.
        noise: (c, c) covariance of the residual.
        factors: (1 + k,) variance of a coefficient over that under white noise, constant first; 1 or above.
        residual: (n, c).
        repeated: variance of every coefficient by rounding that is the same in every turn.
    """

    orders: tuple[int, ...]
    coefficients: Array
    inverse: Array
    noise: Array
    factors: Array
    residual: Array
    repeated: float = 0.0

    def covariance(self) -> Array:
        """Of the coefficients of all orders, row by row: (2 k c, 2 k c), the constants not among them."""
        rows = np.sqrt(np.repeat(self.factors[1:], 2))
        covariance = np.kron(self.inverse[1:, 1:] * np.outer(rows, rows), self.noise)
        return np.asarray(covariance + self.repeated * np.eye(len(covariance)))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residual."""
        return self.residual.size - self.coefficients.size

    def place(self, order: int) -> slice:
        """Rows of an order in `covariance` and in the raveled coefficients without constants."""
        channels, at = self.coefficients.shape[1], self.orders.index(order)
        return slice(2 * at * channels, 2 * (at + 1) * channels)


def fit_orders(theta: Array, values: Array, orders: Sequence[int], least_noise: float) -> OrderFit:
    """Least squares of a constant and of whole `orders` to values (n, c) over rotations (n,).

    `least_noise` is a variance that the residual's is not taken to be below.
    """
    count = 1 + 2 * len(orders)
    normal, right = np.zeros((count, count)), np.zeros((count, values.shape[1]))
    for part, design in _designs(theta, orders):
        normal += design.T @ design
        right += design.T @ values[part]
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    coefficients = inverse @ right
    residual = values - evaluate_orders(theta, orders, coefficients)
    noise: Array = np.array(residual.T @ residual / max(1, len(theta) - count), dtype=np.float64)
    np.fill_diagonal(noise, np.maximum(np.diag(noise), least_noise))
    factors = _batch_factors(theta, residual, orders, inverse, noise)
    return OrderFit(tuple(orders), coefficients, inverse, noise, factors, residual)


def evaluate_orders(theta: Array, orders: Sequence[int], coefficients: Array) -> Array:
    """(n, c) values at rotations (n,) of coefficients (1 + 2 k, c) as in `OrderFit`."""
    return np.concatenate([design @ coefficients for _, design in _designs(theta, orders)])


def differentiate_orders(orders: Sequence[int], coefficients: Array) -> Array:
    """(1 + 2 k, c) coefficients of the derivative by the rotation."""
    slope = np.zeros_like(coefficients)
    for i, order in enumerate(orders):
        slope[1 + 2 * i], slope[2 + 2 * i] = order * coefficients[2 + 2 * i], -order * coefficients[1 + 2 * i]
    return slope


def _designs(theta: Array, orders: Sequence[int]) -> Iterator[tuple[slice, Array]]:
    for start in range(0, max(1, len(theta)), CHUNK):
        part = slice(start, start + CHUNK)
        angles = theta[part, None] * np.array(orders, dtype=np.float64)
        design = np.ones((len(angles), 1 + 2 * len(orders)))
        design[:, 1::2], design[:, 2::2] = np.cos(angles), np.sin(angles)
        yield part, design


def _batch_factors(theta: Array, residual: Array, orders: Sequence[int], inverse: Array, noise: Array) -> Array:
    """(1 + k,) variance by batches over that by white noise, constant first, the largest over the batches' lengths."""
    edges = np.unique(np.linspace(0, len(theta), min(BATCHES, len(theta)) + 1).astype(np.int64))
    scores = np.zeros((len(edges) - 1, len(inverse), residual.shape[1]))
    batch = np.searchsorted(edges, np.arange(len(theta)), side="right") - 1
    for part, design in _designs(theta, orders):
        first = int(batch[part][0])
        starts = np.flatnonzero(np.diff(batch[part], prepend=first - 1))
        products = design[:, :, None] * residual[part, None, :]
        np.add.at(scores, batch[part][starts], np.add.reduceat(products, starts, axis=0))
    moved = np.swapaxes(np.tensordot(scores, inverse, axes=(1, 1)), 1, 2)
    white = np.diag(inverse)[:, None] * np.diag(noise)
    share = len(theta) / max(1, len(theta) - len(inverse))  # residuals are smaller by the freedom that the fit takes
    factors, shorter, ratio = np.ones(1 + len(orders)), np.ones(1 + len(orders)), 1
    while len(moved) >= FEWEST_BATCHES:
        rows = ((moved**2).sum(axis=0) / white).mean(axis=1) * share
        found = np.concatenate([rows[:1], rows[1:].reshape(-1, 2).mean(axis=1)])
        # batches miss a part that falls with their length: two lengths tell the limit
        limit = (ratio * found - shorter) / (ratio - 1) if ratio > 1 else found
        factors, shorter = np.maximum(factors, np.maximum(found, limit)), found
        ratio = min(4, len(moved) // FEWEST_BATCHES)
        if ratio < 2:
            break
        moved = np.add.reduceat(moved, np.arange(0, len(moved), ratio), axis=0)
    return factors


View = tuple[Array, Array]
"""Angles (n,) rad and residuals (n,) of one look at something that goes round."""


def with_rounding(
    fit: OrderFit, theta: Array, variances: Array, noise: float, resolution: float, views: Sequence[View] = ()
) -> OrderFit:
    """The fit with what rounding adds to its coefficients where it is the same in every turn.

    Noise breaks up a resolution's steps but for exp(-(2 pi noise / resolution)²) of them. What is left is a function
    of the signal. If the rotation is in step with the sampling, or slow, it repeats, and is averaged over no more than
    the steps that the signal goes through in a turn, or the places where it was sampled. It shows in what the residual
    repeats from one half of the recording to the other, or from one of the `views` to another, and in how far it falls
    short of the described variances (n,): the orders have taken it in.
    """
    if resolution == 0.0:
        return fit
    described = float(variances.mean())
    shared = float(np.exp(-((2 * np.pi * noise / resolution) ** 2))) * resolution**2 / 12
    short = 1 - float((fit.residual**2).mean()) / described
    half = len(theta) // 2
    turns = [repeating_variance([(theta[:half], each[:half]), (theta[half:], each[half:])]) for each in fit.residual.T]
    repeating = max(float(np.mean(turns)), repeating_variance(views)) / described
    turn = evaluate_orders(np.linspace(0, 2 * np.pi, BINS), fit.orders, fit.coefficients)
    steps = float(np.abs(np.diff(turn, axis=0)).sum(axis=0).mean()) / resolution
    independent = max(1.0, min(steps, float(len(np.unique(_bins(theta))))))
    return replace(fit, repeated=2 * shared * min(1.0, max(0.0, short) + max(0.0, repeating)) / independent)


def repeating_variance(views: Sequence[View]) -> float:
    """Variance of what residuals over an angle have in common in different views of it; about zero for noise."""
    means = []
    for angles, residual in views:
        index = _bins(angles) * REPEATED_BINS // BINS
        counts = np.bincount(index, minlength=REPEATED_BINS)
        with np.errstate(invalid="ignore"):
            means.append(np.bincount(index, residual, REPEATED_BINS) / counts)
    products = [a * b for k, a in enumerate(means) for b in means[k + 1 :]]
    common = np.concatenate([each[np.isfinite(each)] for each in products]) if products else np.zeros(0)
    return float(common.mean()) if common.size else 0.0


def highest_order(theta: Array, reach: float) -> int:
    """Highest order that rotations (n,) tell from the others, at most 1 / `reach` and `HIGHEST`.

    `reach` is the angle over which a value draws on samples, rad: interpolation over 1 rad of a wave takes 2 % of it.
    The rotations cover the turn where no eigenvalue of the orders' mutual correlations is below `LEAST_EIGENVALUE`.
    """
    limit = int(min(HIGHEST, (len(np.unique(np.floor(theta / (2 * np.pi) * BINS) % BINS)) - 1) // 2))
    if reach > 0:
        limit = min(limit, int(1 / reach))
    counts = np.bincount(_bins(theta), minlength=BINS)
    density = np.fft.fft(counts) / len(theta)

    def told(order: int) -> bool:
        steps = np.arange(-order, order + 1)
        matrix = density[(steps[:, None] - steps) % BINS]
        try:  # all eigenvalues are above it where the rest is positive definite
            np.linalg.cholesky(matrix - LEAST_EIGENVALUE * np.eye(len(matrix)))
        except np.linalg.LinAlgError:
            return False
        return True

    low, high = 0, limit
    while low < high:  # the eigenvalue falls with the order
        middle = (low + high + 1) // 2
        low, high = (middle, high) if told(middle) else (low, middle - 1)
    return low


def _bins(theta: Array) -> NDArray[np.int64]:
    return np.asarray(np.floor(theta / (2 * np.pi) * BINS), dtype=np.int64) % BINS


def find_orders(theta: Array, values: Array, highest: int, always: Sequence[int], shapes: Shapes | None) -> set[int]:
    """Orders up to `highest` whose power stands out from that of the orders around them, and those of `always`.

    An order counts by its power in all channels, and in the part of them that the model allows it: `shapes`
    (highest, c) are the amplitudes by channel of a unit wave of each order, zero for an order that the model has not.
    The strongest is taken first and what it leaks into others removed. The rate of false alarms is `FALSE_ALARM` for
    all orders together under white noise. Coloured noise gives more; a test with the fit's covariance removes them.
    """
    scale = max(float(values.std()), np.finfo(np.float64).tiny)
    index = _bins(theta)
    counts = np.bincount(index, minlength=BINS).astype(np.float64)
    sums = np.stack([np.bincount(index, column, BINS) for column in (values / scale).T], axis=1)
    centres = (np.arange(BINS) + 0.5) * 2 * np.pi / BINS
    shift = np.exp(-1j * np.arange(highest + 1) * centres[0])[1:, None]
    chosen = set(always)
    for _ in range(highest):
        orders = sorted(chosen)
        design = next(_designs(centres, orders))[1]
        solution = np.linalg.lstsq(design.T @ (counts[:, None] * design), design.T @ sums, rcond=None)[0]
        left = sums - counts[:, None] * (design @ solution)
        waves = np.fft.fft(left, axis=0)[1 : highest + 1] * shift
        strength = _strength((np.abs(waves) ** 2).sum(axis=1), waves.shape[1])
        if shapes is not None:
            size = np.linalg.norm(shapes, axis=1)
            has = size > 0
            allowed = np.abs((shapes[has].conj() * waves[has]).sum(axis=1) / size[has]) ** 2
            strength[has] = np.maximum(strength[has], _strength(allowed, 1))
        strength[np.array([k - 1 for k in orders if 0 < k <= highest], dtype=np.int64)] = 0.0
        if strength.max(initial=0.0) <= 1.0:
            break
        chosen |= {int(k) + 1 for k in np.flatnonzero((strength > 1.0) & (strength >= 0.5 * strength.max()))}
    return chosen


def _strength(power: Array, freedom: int) -> Array:
    """Power of each order, the sum of `freedom` squares of complex amplitudes, over what noise reaches."""
    background = median_filter(power, 2 * WINDOW + 1, mode="nearest") / gammaincinv(freedom, 0.5)
    limit = gammainccinv(freedom, FALSE_ALARM / max(1, len(power)))
    return np.asarray(power / np.maximum(background * limit, np.finfo(np.float64).tiny))


def significant(value: Array, covariance: Array, freedom: int, tried: int) -> bool:
    """Whether a value (d,) is too large for chance, at `FALSE_ALARM` for `tried` such tests.

    Its covariance is known by `freedom` degrees of freedom.
    """
    statistic = float(value @ np.linalg.solve(covariance, value)) / len(value)
    return bool(f_tail(statistic, len(value), max(1, freedom)) < FALSE_ALARM / max(1, tried))


def effective_count(residual: Array) -> float:
    """How many independent values tell the variance of a residual (n, c) as well as these, which follow one another."""
    count, channels = residual.shape
    size = 2 ** math.ceil(math.log2(2 * count))
    centred = residual - residual.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(centred, size, axis=0)) ** 2
    covariance = np.fft.irfft(spectrum.mean(axis=1), size)[: max(1, count // 4)]
    if covariance[0] <= 0:
        return float(count * channels)
    correlation = covariance / covariance[0]
    return float(count * channels / (1 + 2 * (correlation[1:] ** 2).sum()))
