"""Read heads on one graduated ring: rotation and radial error motion by least squares over whatever heads are alive.

A head at azimuth phi reads `theta + (-c_x sin(phi) + c_y cos(phi)) / r` for a ring centre displaced by c (Lou et al.
2019, Equations 1-2). For two opposed heads the least-squares solution is their Equation 3, `c_y = r tan((A - B) / 2)`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.kernel import MOST_HEADS, PackedLayout, chosen_kernel

Waves = NDArray[np.complex128]
COMPONENTS = ("theta", "x", "y")
LEAK = 2e-3
"""How much of another component may hide in an observable one: two heads count as opposed within 2 mrad."""

LEAST_SEEN = 0.1
"""Least part of an order's amplitude in which heads differ. Azimuths are known to some 0.01 rad, so that less of it may
be their error; and the order would be ten times less certain than others."""


@dataclass(frozen=True)
class GraduationView:
    """How one harmonic of the graduation appears to a layout of heads.

    Attributes:
        order: waves per revolution.
        as_rotation: part of its amplitude that is taken for rotation.
        as_radial: part of its amplitude, times the radius, that is taken for radial error motion along x or y.
        seen: part of it, 0 to 1, that contradicts every rotation and radial motion and so shows as disagreement.
    """

    order: int
    as_rotation: float
    as_radial: float
    seen: float


@dataclass(frozen=True)
class HeadLayout:
    """Where the heads stand that are read together.

    Attributes:
        azimuths: azimuth of each head, rad.
    """

    azimuths: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.azimuths:
            raise InputError("no read head; at least 1 tells a rotation")

    @cached_property
    def sensitivity(self) -> Array:
        """(h, 3) reading of each head per rotation and per displacement x, y in units of the radius."""
        phi = np.array(self.azimuths)
        return np.column_stack([np.ones(len(phi)), -np.sin(phi), np.cos(phi)])

    @cached_property
    def weights(self) -> Array:
        """(3, h) least-squares weights of the readings for rotation, x and y; rows of unobservable ones are zero.

        Heads that do not tell the rotation free of displacement tell it with what is `mixed` into it: their mean.
        """
        inverse = np.linalg.pinv(self.sensitivity, rcond=LEAK)
        inverse[[name not in self.observable for name in COMPONENTS]] = 0.0
        if not self.tells_rotation:
            inverse[0] = 1.0 / len(self.azimuths)
        inverse[np.abs(inverse) < 1e-12] = 0.0  # what rounding leaves of an exact zero
        return np.asarray(inverse)

    @cached_property
    def view(self) -> tuple[Array, Array]:
        """(2, h) weights for what the heads see of a displacement x, y over the radius, and what that is, (2, 2).

        The latter takes a displacement to what is seen of it, whatever the rotation is: itself, its part across the
        line of two opposed heads, that in which two others differ, or nothing where there is one.
        """
        if self.tells_rotation:
            inverse = np.linalg.pinv(self.sensitivity, rcond=LEAK)
            seen = (inverse @ self.sensitivity)[1:, 1:]
            return np.asarray(inverse[1:], float), np.asarray(np.where(np.abs(seen) < 1e-12, 0.0, seen), float)
        apart = np.eye(len(self.azimuths)) - 1.0 / len(self.azimuths)
        inverse = np.linalg.pinv(apart @ self.sensitivity[:, 1:], rcond=LEAK) @ apart
        return np.asarray(inverse, float), np.asarray(inverse @ self.sensitivity[:, 1:], float)

    @property
    def tells_rotation(self) -> bool:
        """Whether the rotation comes free of the ring's displacement: of two opposed heads, or of three."""
        return "theta" in self.observable

    @cached_property
    def mixed(self) -> Array:
        """(2,) rotation that comes of a displacement x, y over the radius; zero where the layout tells them apart."""
        return np.zeros(2) if self.tells_rotation else np.asarray(self.sensitivity[:, 1:].mean(axis=0))

    @cached_property
    def projector(self) -> Array:
        """(h, h) what of the readings no rotation and no displacement explains."""
        rest = np.eye(len(self.azimuths)) - self.sensitivity @ np.linalg.pinv(self.sensitivity, rcond=LEAK)
        rest[np.abs(rest) < 1e-12] = 0.0
        return np.asarray(rest)

    @cached_property
    def parity(self) -> Array:
        """(redundancy, h) orthonormal combinations of the readings that no rotation and no displacement changes.

        The parity vector of fault detection (Potter and Suman 1977): zero but for noise, whatever the rotor does.
        """
        left, size, _ = np.linalg.svd(self.projector)
        rows = left[:, : self.redundancy].T * (size[: self.redundancy] > 0.5)[:, None]
        largest = np.abs(rows).argmax(axis=1)
        signs = np.sign(rows[np.arange(len(rows)), largest])  # the sign of a singular vector is arbitrary
        return np.asarray(rows * signs[:, None])

    @cached_property
    def observable(self) -> tuple[str, ...]:
        """Which of `theta`, `x`, `y` the layout determines, each free of the others."""
        resolution = np.linalg.pinv(self.sensitivity, rcond=LEAK) @ self.sensitivity
        leak = np.abs(resolution - np.eye(3)).max(axis=1)
        return tuple(name for name, part in zip(COMPONENTS, leak, strict=True) if part < LEAK)

    @cached_property
    def redundancy(self) -> int:
        """Number of independent contradictions among the heads that would show."""
        return len(self.azimuths) - int(np.linalg.matrix_rank(self.sensitivity, tol=LEAK))

    def graduation_view(self, orders: Sequence[int]) -> tuple[GraduationView, ...]:
        """How harmonics of the graduation appear: four equal heads take orders 4k for rotation, odd ones for motion."""
        views = []
        for order in orders:
            wave = np.exp(1j * order * np.array(self.azimuths))
            part, left = explained(self.sensitivity, wave, LEAK)
            seen = np.linalg.norm(left) / np.linalg.norm(wave)
            views.append(
                GraduationView(order, float(abs(part[0])), float(np.abs(part[1:]).max()), float(np.round(seen, 12)))
            )
        return tuple(views)

    def hidden_orders(self, highest: int) -> tuple[int, ...]:
        """Orders of the graduation from 1 to `highest` that no disagreement of these heads can show."""
        return tuple(view.order for view in self.graduation_view(range(1, highest + 1)) if view.seen < LEAK)


def explained(sensitivity: Array, waves: Waves, least: float) -> tuple[Waves, Waves]:
    """Least-squares motion (c, q) that q sets of waves (p, q) look like to p sensors, and what of them is left, (p, q).

    Singular values of the sensitivity (p, c) below `least` times the largest count as 0.
    """
    motion = np.linalg.pinv(sensitivity, rcond=least) @ waves
    return motion, waves - sensitivity @ motion


def seen_part(azimuths: Array, order: int) -> float:
    """Part of an order's amplitude in which the heads differ; what all see alike passes for rotation."""
    wave = np.exp(1j * order * azimuths)
    return float(np.sqrt(np.mean(np.abs(wave - wave.mean()) ** 2)))


@dataclass(frozen=True)
class RingPose:
    """Rotation and place of the ring at m times.

    Attributes:
        theta: (m,) rotation, rad.
        centre: (m, 2) displacement of the ring's centre, m; zero where the layout cannot tell.
        covariance: (m, 3, 3) of theta (rad), x and y (m).
        disagreement: (m,) contradiction among the heads in standard deviations (root of chi-square per redundancy);
            zero without redundancy.
        parity: (m, redundancy) of the readings, rad.
        seen: (m, 2) what the heads see of the displacement, m: all of it, or one direction where they tell no more.
    """

    theta: Array
    centre: Array
    covariance: Array
    disagreement: Array
    parity: Array
    seen: Array


def estimate_ring_pose(layout: HeadLayout, radius: float, readings: Array, variances: Array) -> RingPose:
    """Rotation and displacement of the ring from simultaneous readings.

    Whole turns between the heads are removed: only their differences within half a turn have a meaning.

    Args:
        layout: the heads that were read.
        radius: radius of the graduation, m.
        readings: (m, h) rad, free of graduation error.
        variances: (m, h) variance of each reading, rad².
    """
    kernel = chosen_kernel()
    if kernel is not None and len(layout.azimuths) <= MOST_HEADS:
        found = kernel.ring_pose(_packed(layout, radius), readings, variances)
        if found is not None:
            theta, off, covariance, parity, disagreement, seen = found
            centre = np.ascontiguousarray((radius * np.tan(off)).T)
            return RingPose(
                theta, centre, covariance, disagreement, parity, centre if seen is None else radius * seen.T
            )
    return _estimate_ring_pose(layout, radius, readings, variances)


def _estimate_ring_pose(layout: HeadLayout, radius: float, readings: Array, variances: Array) -> RingPose:
    # heads first: a sum over the first axis adds them one by one, the same bits in batches of any size
    relative = np.ascontiguousarray(readings.T) - readings[:, 0]
    relative = relative - 2 * np.pi * np.rint(relative / (2 * np.pi))
    spread = np.ascontiguousarray(variances.T)
    theta, v_x, v_y = _sum_over_heads(layout.weights, relative)
    theta = readings[:, 0] * layout.weights[0].sum() + theta
    centre = np.empty((len(theta), 2))
    centre[:, 0], centre[:, 1] = radius * np.tan(v_x), radius * np.tan(v_y)
    products = _products(layout, radius)
    covariance = _sum_over_heads(products, spread).reshape(3, 3, -1).transpose(2, 0, 1)
    parity = _sum_over_heads(layout.parity, relative).T
    seen = centre
    if len(layout.observable) != len(COMPONENTS):
        seen = radius * np.stack([*_sum_over_heads(layout.view[0], relative)], axis=1)
    return RingPose(theta, centre, covariance, _disagreement(layout, relative, spread), parity, seen)


@lru_cache(maxsize=64)
def _packed(layout: HeadLayout, radius: float) -> PackedLayout:
    arrays = (layout.weights, _products(layout, radius), layout.parity, layout.projector, layout.view[0])
    return PackedLayout(layout.redundancy, sees_less=len(layout.observable) != len(COMPONENTS), arrays=arrays)


@lru_cache(maxsize=64)
def _products(layout: HeadLayout, radius: float) -> Array:
    """(9, h) weights of the variances of the readings for the covariance of rotation (rad) and displacement (m)."""
    scale = np.array([1.0, radius, radius])
    products = layout.weights[:, None] * layout.weights[None] * (scale[:, None] * scale)[:, :, None]
    return np.asarray(products.reshape(9, -1))


def _disagreement(layout: HeadLayout, relative: Array, variances: Array) -> Array:
    if layout.redundancy == 0:
        return np.zeros(relative.shape[1])
    residual = _sum_over_heads(layout.projector, relative)
    return np.asarray(np.sqrt((residual * residual / variances).sum(axis=0) / layout.redundancy))


def _sum_over_heads(weights: Array, columns: Array) -> Array:
    """(r, m) sums of columns (h, m) with weights (r, h)."""
    return np.asarray((weights.T[:, :, None] * columns[:, None]).sum(axis=0))
