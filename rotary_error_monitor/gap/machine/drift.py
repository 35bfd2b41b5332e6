"""Slow drift of the probe beside the white noise that is stated: learnt, in a form that cannot swallow a fault."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.gap.p_values import NORMAL_QUARTILE
from rotary_error_monitor.gap.problem import Array

ORDERS = 40
"""Orders of cosines over the recording of which a drift is made; beyond them what falls with the order is no more than
white noise."""

FALLS = (0.5, 1.0)
"""Powers of the order with which the cosines get smaller: noise of density 1/f, and a random walk."""

SIZES = np.geomspace(0.1, 4.0, 24)
"""Root mean squares of a drift that are tried, in standard deviations of the white noise. A drift is an instrument's
noise as long as it is of the size of that: it has a half-normal prior of the stated standard deviation."""


def learn_drift(white: Array, kept: NDArray[np.bool_], uncertain: Array, others: Array) -> Array:
    """Drift that the poses, in the order of measuring, show beyond the stated noise.

    Its size has the largest posterior density, all cosines integrated out. There is none where one of the `others`, or
    a step somewhere, is as likely (Schwarz's criterion): what those can explain is a fault, and no noise.

    Args:
        white: rows (3 n,) of what is left, in standard deviations of the stated noise, components one after the other.
        kept: (n,) poses that count.
        uncertain: (3 n, u) one standard uncertainty of each parameter of the twin.
        others: (3 n, p) what a machine may do.

    Returns:
        (n, q) one standard deviation of each course of a component, in those of the noise; q = 0 where none shows.
    """
    waves, count = _cosines(len(kept)), int(kept.sum())
    best, drift = 0.0, np.zeros((len(kept), 0))
    if count < 2 * waves.shape[1]:
        return drift
    data = _Data(white, kept, uncertain)
    courses = data.whitened(_in_all(waves))
    gram, moment = courses.T @ courses, courses.T @ data.rows
    for power in FALLS:
        shape = np.maximum(np.arange(waves.shape[1]), 1.0) ** -power
        shape /= np.linalg.norm(shape)
        density = _log_evidence(gram, moment, np.tile(shape, 3), SIZES) - 0.5 * np.square(data.level * SIZES)
        if density.max() > best:
            best, drift = float(density.max()), waves * (data.level * SIZES[density.argmax()] * shape)
    if best <= np.log(count):  # Schwarz's criterion for its size and the law by which it falls
        return drift[:, :0]
    begins = np.flatnonzero(kept)[2:-1, None]
    steps = [_in_all(step[:, None]) for step in (np.arange(len(kept)) >= begins).astype(np.float64)]
    rivals = [data.log_evidence(step) - np.log(len(steps)) for step in steps]
    rivals += [data.log_evidence(column[:, None]) - np.log(others.shape[1]) for column in others.T]
    return drift if best > max(rivals) else drift[:, :0]


class _Data:
    """White rows beside uncertain parameters, which are integrated out.

    Attributes:
        level: of the white noise, told from neighbours: they differ by it, and by what goes with the pose, but hardly
            by a drift; 1 or more.
    """

    def __init__(self, white: Array, kept: NDArray[np.bool_], uncertain: Array) -> None:
        steps = np.abs(np.diff(white.reshape(3, -1)[:, kept], axis=1))
        self.level = max(1.0, float(np.median(steps)) / (np.sqrt(2) * NORMAL_QUARTILE))
        self._used = np.tile(kept, 3)
        # Rows times the inverse root of I + U U': of the singular values s of U, 1 / sqrt(1 + s^2) in their directions.
        left, sizes, _ = np.linalg.svd(uncertain[self._used] / self.level, full_matrices=False)
        self._left, self._taken = left, 1 - 1 / np.sqrt(1 + np.square(sizes))
        self.rows = self.whitened(white[:, None])[:, 0] / self.level

    def whitened(self, columns: Array) -> Array:
        """Columns (3 n, q), of the poses that count and with uncertain parameters integrated out."""
        own = columns[self._used]
        return np.asarray(own - self._left @ (self._taken[:, None] * (self._left.T @ own)), np.float64)

    def log_evidence(self, columns: Array) -> float:
        """Of columns (3 n, q) of any size, relative to none, by Schwarz's criterion."""
        own = self.whitened(columns)
        moment = own.T @ self.rows
        gain = float(moment @ np.linalg.lstsq(own.T @ own, moment)[0])
        return 0.5 * gain - 0.5 * len(moment) * float(np.log(len(self.rows) / 3))


def _in_all(columns: Array) -> Array:
    """Columns (n, q) once for each component (3 n, 3 q)."""
    return np.asarray(np.kron(np.eye(3), columns), np.float64)


def _cosines(count: int) -> Array:
    """(n, q) constant and cosines over `count` poses, each with a mean square of one."""
    passed = (np.arange(count) + 0.5) / count
    orders = np.arange(min(ORDERS, count // 4) + 1)
    return np.asarray(np.sqrt(np.where(orders > 0, 2.0, 1.0)) * np.cos(np.pi * passed[:, None] * orders), np.float64)


def _log_evidence(gram: Array, moment: Array, shape: Array, sizes: Array) -> Array:
    """Logarithm of the marginal likelihood of courses (q,) for each of the sizes (s,) that they may have."""
    powers, directions = np.linalg.eigh(gram * np.outer(shape, shape))
    shown = np.square(directions.T @ (shape * moment))
    widths = np.square(sizes)[:, None]
    spread = 1 + widths * np.maximum(powers, 0.0)
    return np.asarray(0.5 * np.sum(widths * shown / spread - np.log(spread), axis=1), np.float64)
