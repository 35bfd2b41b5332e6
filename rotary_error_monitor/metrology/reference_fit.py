"""What stands between a reference on a target and an estimate: zero, the target's eccentricity, a height misstated.

A reference reads, along a direction u, the target's displacement: the radial error motion at its height, the target's
eccentricity that turns with the rotor, and a zero of its own. Against an estimate, all three are linear:

    reference - estimate = zero + u . (R(theta) eccentricity + lever * higher) + noise

with R the rotation, and `lever` by how much the radial error motion grows with the height (Lou et al. 2019, Equation
7). They follow by least squares, their covariance from what is left, turn by turn, for noise is seldom white: the sums
over turns are independent, and there are few of them (sandwich estimator by clusters, Liang and Zeger 1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.error_motion import rotate
from rotary_error_monitor.metrology.spindle_figures import COVERAGE


@dataclass(frozen=True)
class ReferenceFit:
    """What was found.

    Attributes:
        zeros: (g, p) mean of the difference in each group, the eccentricity taken off, m.
        eccentricity: (2,) of the target in the rotor's frame, m.
        covariance: (2, 2) of it, by scatter alone, m²; `COVERAGE` deviations span 95 %, also of few turns.
        left: (n, p) what is left of the difference, m.
        joint: (2,) eccentricity where the height is unknown as well, m.
        higher: by how much the reference seems to stand higher than stated, m.
        higher_std: standard uncertainty of that by scatter alone, m; infinite where no tilt tells.
        maps: by which a difference (n, p) becomes the eccentricity, and the eccentricity with the height: (2, n, p) and
            (3, n, p), whatever the difference is.
        leaning: root mean square along a direction of the lever, what looks like zero or eccentricity left out, rad:
            times `higher` it is what the height makes of the differences.
    """

    zeros: Array
    eccentricity: Array
    covariance: Array
    left: Array
    joint: Array
    higher: float
    higher_std: float
    leaning: float
    maps: tuple[Array, Array]

    def taken(self, effect: Array) -> tuple[Array, float]:
        """What of a difference (n, p), m, is taken for eccentricity (2,) and for height, m."""
        found, joint = (np.einsum("knp,np->k", each, effect) for each in self.maps)
        return found, float(joint[2])


def fit_reference(
    theta: Array,
    difference: Array,
    lever: Array,
    directions: Array,
    group: NDArray[np.intp],
    cluster: NDArray[np.intp],
) -> ReferenceFit:
    """Zero of each group and eccentricity of all, taken off; the height beside them, which is not taken off.

    Args:
        theta: (n,) rotation, rad.
        difference: (n, p) reference minus estimate along p directions, m.
        lever: (n, 2) growth of the radial error motion with the height, rad.
        directions: (p, 2) unit vectors.
        group: (n,) number of each sample's group from 0 on, such as its direction of turning; none is empty.
        cluster: (n,) number of the stretch, such as a turn, that it is in, from 0 on.
    """
    turned = np.stack([rotate((1.0, 0.0), theta), rotate((0.0, 1.0), theta)], axis=2)  # (n, xy, unknown)
    moved = np.concatenate([turned, lever[:, :, None]], axis=2)
    columns = np.einsum("pi,nik->npk", directions, moved)
    count = np.bincount(group).astype(np.float64)
    design = columns - _means(columns, group, count)[group]
    target = difference - _means(difference, group, count)[group]
    found, covariance, left, _, inverse = _solve(design[:, :, :2], target, cluster)
    zeros = _means(difference - columns[:, :, :2] @ found, group, count)
    whole, spread, _, alone, joint = _solve(design, target, cluster)
    # columns are about the means of their groups: zeros drop out
    maps = np.einsum("kl,npl->knp", inverse, design[:, :, :2]), np.einsum("kl,npl->knp", joint, design)
    std, leaning = float(np.sqrt(spread[2, 2])), float(np.sqrt(alone[2] / target.size))
    return ReferenceFit(zeros, found, covariance, left, whole[:2], float(whole[2]), std, leaning, maps)


def _means(values: Array, group: NDArray[np.intp], count: Array) -> Array:
    """(g, …) mean of values (n, …) in each group."""
    total = np.zeros((len(count), *values.shape[1:]))
    np.add.at(total, group, values)
    return np.asarray(total / count.reshape(-1, *[1] * (values.ndim - 1)))


_TOLD = 1e-9
"""Part of the largest eigenvalue of the normal matrix below which a combination of unknowns is not told."""


def _solve(design: Array, target: Array, cluster: NDArray[np.intp]) -> tuple[Array, Array, Array, Array, Array]:
    """Unknowns (k,), their covariance by clusters (k, k), what is left (n, p), squares of columns (k,), inverse (k, k).

    The squares are of the part of each column that no other column makes, the inverse is that of the normal matrix.
    """
    scale = np.sqrt((design**2).sum(axis=(0, 1)))
    told = scale > 0.0
    safe = np.where(told, scale, 1.0)
    normal = np.einsum("npk,npl->kl", design, design) / np.outer(safe, safe)
    inverse = np.linalg.pinv(normal, rcond=_TOLD, hermitian=True) / np.outer(safe, safe)
    found = inverse @ np.einsum("npk,np->k", design, target)
    left = target - design @ found
    scores = np.zeros((int(cluster.max()) + 1, len(found)))
    np.add.at(scores, cluster, np.einsum("npk,np->nk", design, left))
    clusters = len(np.unique(cluster))
    degrees = max(clusters - 1, 1)
    # few clusters: a factor of Student's t, so that twice the deviation spans 95 %
    wider = clusters / degrees * (float(stdtrit(degrees, 0.975)) / COVERAGE) ** 2
    covariance = wider * inverse @ scores.T @ scores @ inverse
    covariance[~told, ~told] = np.inf
    alone = np.where(told, 1.0 / np.where(told, np.diag(inverse), 1.0), 0.0)
    return found, covariance, left, alone, np.asarray(inverse)
