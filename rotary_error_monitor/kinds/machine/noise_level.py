"""How loud a machine's probe is, from what smooth errors of the machine leave of neighbouring poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.gap.noise_level import NoiseLevel, expected_level
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.p_values import chi_square_median, chi_square_quantile, log_chi_square_tail
from rotary_error_monitor.kinds.machine.smooth import OUTLIER

PARTS = 12
"""Parts of a recording whose noise is compared: what happens at one moment is in one of them."""

LEAST = 24
"""Degrees of freedom, two for each part, below which the noise is taken as stated."""

MOST_ROUNDS = 4
"""Times that steps are looked for beside those found."""

MOST_MODULATED = 8
"""Smooth errors on one side only that are taken out: an effect has six amplitudes at most, which may differ in two."""

REMEMBERED = 4
"""Sets of poses of which what they have in common is kept: outliers are looked for beside several sets of causes."""

SAME = 1e-9
"""Part of the largest square of a direction below which it is rounding."""


@dataclass(frozen=True)
class ProbeNoise:
    """Noise of a probe.

    Attributes:
        level: beside what is stated.
        tails: variance of the squares of what is left, over that of normal noise, at least one.
    """

    level: NoiseLevel
    tails: float


AS_STATED = ProbeNoise(NoiseLevel(), 1.0)
"""Where nothing tells otherwise."""


class ProbeNoiseEstimator:
    """Estimates the noise of a machine's probe.

    It is told by differences of neighbouring poses (von Neumann 1941), in which neither a drift of the probe nor a step
    shows, once all smooth errors of the machine are taken out of them, whatever their size. Poses that are repeated,
    and those beyond what smooth errors describe, are what tells it.

    Args:
        columns: (3 n, p) white columns of smooth errors, components one after the other.
        factors: (n, k) what they may go with: an error that is there on one side only is not smooth, and no noise.
    """

    def __init__(self, columns: Array, factors: Array) -> None:
        self._columns = columns
        self._factors = factors
        self._known: dict[bytes, _Differences] = {}

    def estimate(self, white: Array, kept: NDArray[np.bool_]) -> ProbeNoise:
        """Noise from what causes leave.

        Args:
            white: (3, n) what is left, in standard deviations of the stated noise.
            kept: (n,) poses that are no outliers.
        """
        rows, columns = white[:, kept], self._columns.reshape(3, len(kept), -1)[:, kept]
        columns = np.concatenate([columns, self._modulated(rows, columns, self._factors[kept])], axis=2)
        used = np.ones(max(rows.shape[1] - 1, 0), bool)
        for _ in range(MOST_ROUNDS):
            apart = self._differences(columns, kept, used)
            if _dof(apart.expected) < LEAST:
                return AS_STATED
            squares = np.square(apart.left_of(np.diff(rows, axis=1)))
            steps = apart.steps(squares)
            if not steps.any():
                break
            used = used & ~steps
        return self._from_squares(rows, squares[:, used], apart, used)

    def _modulated(self, rows: Array, columns: Array, factors: Array) -> Array:
        """(3, m, j) smooth errors times a factor that stand out of what all smooth errors leave, one by one."""
        chosen, basis = np.zeros((*rows.shape, 0)), _span(columns)
        least = chi_square_quantile(FALSE_ALARMS / max(columns.shape[2] * factors.shape[1], 1), 1)
        while chosen.shape[2] < MOST_MODULATED and rows.size - basis.shape[1] >= LEAST:
            left = _left(rows, basis)
            noise = max(float(np.sum(np.square(left))) / (rows.size - basis.shape[1]), np.finfo(np.float64).tiny)
            shown = np.einsum("cm,cmp,mk->pk", left, columns, factors, optimize=True)
            powers = np.einsum("cmp,mk->pk", np.square(columns), np.square(factors), optimize=True)
            gains = np.square(shown) / np.maximum(powers, SAME)
            best, factor = np.unravel_index(int(np.argmax(gains)), gains.shape)
            if gains[best, factor] < least * noise:
                break
            own = columns[:, :, best] * factors[:, factor]
            chosen = np.concatenate([chosen, own[:, :, None]], axis=2)
            basis = _span(np.concatenate([columns, chosen], axis=2))
        return chosen

    def _from_squares(self, rows: Array, squares: Array, apart: _Differences, used: NDArray[np.bool_]) -> ProbeNoise:
        expected = apart.expected[:, used]
        if not np.all(squares.sum(axis=1) > 0):
            return AS_STATED
        mean = float(squares.sum() / expected.sum())
        scatter = float(np.sum(np.square(squares - mean * expected)) / (2 * mean**2 * np.sum(np.square(expected))))
        tails = max(1.0, scatter)
        squares, expected = _of_the_quietest(squares, expected, tails)
        found = _steady(squares, expected, tails)
        if found < 1.0:
            # quieter it is as all that is left shows it, which holds what is slow in the noise
            whole = float(np.sum(np.square(_left(rows, apart.whole)))) / (rows.size - apart.whole.shape[1])
            found = min(max(found, whole), 1.0)
        variance = 0.5 * tails / _dof(expected)
        return ProbeNoise(expected_level(float(np.sqrt(found)), variance), tails)

    def _differences(self, columns: Array, kept: NDArray[np.bool_], used: NDArray[np.bool_]) -> _Differences:
        """What is the same as long as the same poses are kept; that of the last few is."""
        modulated = columns[:, :, self._columns.shape[1] :]
        key = np.packbits(np.concatenate([kept, used])).tobytes() + modulated.tobytes()
        if key not in self._known:
            self._known = dict([*self._known.items()][1 - REMEMBERED :])
            self._known[key] = _Differences.of(columns, used)
        return self._known[key]


@dataclass(frozen=True)
class _Differences:
    """Differences of neighbouring poses beside smooth errors, at m poses.

    Attributes:
        used: (m - 1,) those that count.
        apart: (3 (m - 1), r) orthonormal columns of smooth errors in them.
        whole: (3 m, r) the same in the poses themselves.
        expected: (3, m - 1) mean square of what smooth errors leave of white noise.
    """

    used: NDArray[np.bool_]
    apart: Array
    whole: Array
    expected: Array

    @classmethod
    def of(cls, columns: Array, used: NDArray[np.bool_]) -> _Differences:
        """From columns (3, m, p) of smooth errors."""
        apart = _span(np.diff(columns, axis=1) * used[:, None])
        # Differences of white rows have a variance of two, and minus one with their neighbours.
        shown = apart.reshape(3, len(used), -1)
        beside = 2 * shown
        beside[:, 1:] -= shown[:, :-1]
        beside[:, :-1] -= shown[:, 1:]
        inner = apart.T @ beside.reshape(apart.shape)
        expected = 2 - 2 * np.sum(shown * beside, axis=2) + np.sum((shown @ inner) * shown, axis=2)
        return cls(used, apart, _span(columns), expected * used)

    def left_of(self, differences: Array) -> Array:
        """(3, m - 1) what smooth errors leave of differences (3, m - 1); 0 where they do not count."""
        return _left(differences * self.used, self.apart)

    def steps(self, squares: Array) -> NDArray[np.bool_]:
        """(m - 1,) differences that are no noise: fitted beside smooth errors they would show in the others."""
        whole = self.expected.sum(axis=0)
        distance = np.sqrt(squares.sum(axis=0) / np.where(self.used, np.maximum(whole, SAME), np.inf))
        spread = float(np.median(distance[self.used])) / np.sqrt(chi_square_median(3) / 3)
        return np.asarray(distance > OUTLIER * spread, bool)


def _span(columns: Array) -> Array:
    """(3 m, r) orthonormal columns with the span of columns (3, m, p)."""
    stacked = columns.reshape(-1, columns.shape[2])
    squares, directions = np.linalg.eigh(stacked.T @ stacked)
    return np.asarray(np.linalg.qr(stacked @ directions[:, squares > SAME * squares.max(initial=0.0)])[0], np.float64)


def _left(rows: Array, span: Array) -> Array:
    """(3, m) what orthonormal columns (3 m, r) leave of rows (3, m)."""
    stacked = rows.ravel()
    return np.asarray((stacked - span @ (span.T @ stacked)).reshape(rows.shape), np.float64)


def _dof(expected: Array) -> float:
    """Degrees of freedom of a variance from successive differences: two for three squares, each of which is of two."""
    return float(expected.sum()) / 3


def _of_the_quietest(squares: Array, expected: Array, tails: float) -> tuple[Array, Array]:
    """Those (c, m) of the component that is the quietest, where they differ by more than chance.

    A probe is as noisy in all directions; what moves one of them alone is an error of the machine.
    """
    if _are_alike(squares.sum(axis=1), expected.sum(axis=1), tails):
        return squares, expected
    quietest = int(np.argmin(squares.sum(axis=1) / expected.sum(axis=1)))
    return squares[quietest, None], expected[quietest, None]


def _steady(squares: Array, expected: Array, tails: float) -> float:
    """Mean square, or where parts of the recording differ by more than chance that of the one in the middle."""
    parts = [[float(part.sum()) for part in np.array_split(own.sum(axis=0), PARTS)] for own in (squares, expected)]
    found, whole = np.asarray(parts)
    if _are_alike(found, whole, tails):
        return float(found.sum() / whole.sum())
    return float(np.median(found / whole))


def _are_alike(found: Array, whole: Array, tails: float) -> bool:
    """Whether mean squares `found / whole` differ by no more than noise of one variance makes them."""
    logs, weight = np.log(found / whole), whole / (6 * tails)
    apart = logs - float(np.sum(weight * logs) / np.sum(weight))
    return log_chi_square_tail(float(np.sum(weight * np.square(apart))), len(found) - 1) > float(np.log(FALSE_ALARMS))
