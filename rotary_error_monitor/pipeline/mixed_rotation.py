"""Heads that see rotation and displacement of the ring as one number: one head alone, or two that are not opposed.

Such heads tell the rotation as far as the ring is where the description has it; the error motion that the stage can
make is in it. What they see for sure is a row each of the least squares in which listed sensors are joined: their mean
one of positioning and displacement together, their difference one of displacement alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion, rotate
from rotary_error_monitor.metrology.harmonics import planar_sum
from rotary_error_monitor.metrology.rigid_motion import Seen
from rotary_error_monitor.pipeline.evidence import SIGMAS
from rotary_error_monitor.pipeline.publication import AssemblyVariance
from rotary_error_monitor.pipeline.verdict import slope_of
from rotary_error_monitor.signals.resampling import Resampled

ROWS = 2
"""Rows of the least squares: mean and difference."""

_ECC = COMPONENTS.index("ecc")


@dataclass(frozen=True)
class MixedRows:
    """What heads see for sure at m ticks, for the least squares.

    Attributes:
        sensitivity: (m, 2, 6) of mean and difference to the components.
        displacement: (m, 2) what they see, rad and m.
        variance: (m, 2) of that, rad² and m².
        there: (m, 2) whether they see it.
        turned: (m,) standard deviation of the rotation by what of the displacement is in it, rad.
    """

    sensitivity: Array
    displacement: Array
    variance: Array
    there: Mask
    turned: Array

    def at(self, chosen: NDArray[np.intp] | slice) -> MixedRows:
        """The same at some of the ticks."""
        return MixedRows(*(each[chosen] for each in vars(self).values()))

    @property
    def kinds(self) -> NDArray[np.int64]:
        """(m,) alike at ticks whose rows see the same; 0 where there is none."""
        _, alike = np.unique(self.sensitivity.reshape(len(self.turned), -1), axis=0, return_inverse=True)
        return np.where(self.there.any(axis=1), 1 + 4 * alike.reshape(-1) + self.there @ np.array([1, 2]), 0)

    def joined(self, known: ErrorMotion, seen: Seen) -> tuple[ErrorMotion, Seen]:
        """What is known without them at ticks of one kind, and what they and other sensors see there."""
        rows = self.there[0]
        known = replace(
            known,
            components=known.components.copy(),
            observable=known.observable.copy(),
            covariance=known.covariance.copy(),
        )
        if rows[0]:
            known.hide(np.ones(len(self.turned), np.bool_), (_ECC,))
        return known, Seen(
            np.concatenate([seen.sensitivity, self.sensitivity[0, rows]]),
            np.concatenate([seen.displacement, self.displacement[:, rows]], axis=1),
            np.concatenate([seen.variance, self.variance[:, rows]], axis=1),
        )


def is_mixed(stage: StageDescription) -> bool:
    """Whether not even all heads of a stage together tell rotation and displacement of the ring apart."""
    return bool(stage.azimuths) and not HeadLayout(tuple(stage.azimuths.values())).tells_rotation


def mixed_in(stage: StageDescription) -> float:
    """What of the rotation may be displacement, by heads that do not tell it from rotation, rad.

    It is the ring's displacement, and what is uncertain of the place that is taken off: one that is alone shows all.
    """
    displaced = stage.limits.radial + SIGMAS * float(np.sqrt(AssemblyVariance.of(stage).radial))
    return displaced / stage.ring.disc_radius


def limits_of_distance(stage: StageDescription) -> StageLimits:
    """Limits of a stage, between what all its heads together tell of the rotation and its command."""
    limits = stage.limits
    if not is_mixed(stage):
        return limits
    return replace(limits, following_error=limits.following_error + mixed_in(stage))


def head_row(azimuth: float, radius: float) -> Array:
    """(6,) what a head at an azimuth, rad, sees of the components, by a ring with a radius, m.

    Lou et al. 2019, Equations 1-2.
    """
    return np.array([-np.sin(azimuth) / radius, np.cos(azimuth) / radius, 0.0, 0.0, 0.0, 1.0])


def described_lead(stage: StageDescription, azimuths: tuple[float, ...], readings: Array) -> Array:
    """(m, h) what eccentricity and described error motion of the ring add to readings (m, h), rad."""
    layout, ring = HeadLayout(azimuths).sensitivity[:, 1:], stage.ring
    lead = np.zeros_like(readings)
    for _ in range(2):  # the angle at which they are taken is off by them at first
        theta = readings[:, 0] - lead[:, 0]
        centre = rotate(ring.eccentricity, theta) + planar_sum(stage.spindle.radial, theta)
        lead = np.arctan(centre / ring.disc_radius) @ layout.T
    return lead


def with_positioning(motion: ErrorMotion, before: ErrorMotion) -> ErrorMotion:
    """An error motion, at times that see the same, with the positioning as it was before: nothing was added to it."""
    motion.components[:, _ECC], motion.observable[:, _ECC] = before.components[:, _ECC], True
    motion.covariance[:, _ECC, _ECC] = before.covariance[:, _ECC, _ECC]
    return motion


class MixedRotation:
    """Takes out of an error motion what such heads do not tell apart."""

    def __init__(self, stage: StageDescription, bits: Mapping[str, int]) -> None:
        """Heads of `stage`, with the `bits` of its streams."""
        self._spindle, self._radius = stage.spindle, stage.ring.disc_radius
        self._azimuths = {bits[f"head_{letter}"]: azimuth for letter, azimuth in stage.azimuths.items()}
        self._names = {bits[f"head_{letter}"]: f"head_{letter}" for letter in stage.azimuths}
        self._mask = sum(self._azimuths)
        # where the ring can be is taken as a rectangle, as an unknown within bounds is (JCGM 100:2008, 4.3.7)
        self._displaced = stage.limits.radial**2 / 3.0
        limits = stage.limits
        self._at_rest = (limits.following_error + mixed_in(stage)) / SIGMAS
        self._by_speed = limits.latency / SIGMAS
        self._layouts: dict[int, HeadLayout] = {}
        assembly = AssemblyVariance.of(stage)
        self._eccentricity, self._graduation = assembly.eccentricity, assembly.graduation / self._radius**2
        self._slope = slope_of(stage.mirror)

    def at(self, streams: NDArray[np.int64]) -> Mask:
        """(m,) whether the heads of the `streams` (m,) that are used do not tell rotation and displacement apart."""
        heads = streams & self._mask
        found = np.zeros(len(heads), np.bool_)
        if self._layout(self._mask).tells_rotation and (heads == self._mask).all():
            return found
        for mask in np.unique(heads[heads != 0]).tolist():
            found |= (heads == mask) & (not self._layout(mask).tells_rotation)
        return found

    def _layout(self, mask: int) -> HeadLayout:
        if mask not in self._layouts:
            self._layouts[mask] = HeadLayout(tuple(azimuth for bit, azimuth in self._azimuths.items() if mask & bit))
        return self._layouts[mask]

    def take_out(
        self, motion: ErrorMotion, mixed: Mask, sampled: Mapping[str, Resampled], rates: Mapping[str, float]
    ) -> MixedRows:
        """Rows of the heads in an error motion of m ticks, of which only what is sure of each component stays.

        At the ticks that are `mixed` (m,) its displacement is what the heads see of it, and is not observable behind
        this. Its first arrays are changed in place: positioning and tilt are as uncertain as the place of the ring
        makes them.

        Args:
            motion: as heads, autocollimator and command show it.
            mixed: at which ticks its heads do not tell rotation and displacement apart.
            sampled: the streams at its ticks, or at more ticks behind these.
            rates: samples per s of each stream.
        """
        count, heads = len(motion.theta), np.where(mixed, motion.streams & self._mask, 0)
        untold = self._untold(heads, sampled, rates)
        rows = MixedRows(
            np.zeros((count, ROWS, len(COMPONENTS))),
            np.zeros((count, ROWS)),
            np.ones((count, ROWS)),
            np.zeros((count, ROWS), np.bool_),
            np.zeros(count),
        )
        motion.covariance[:, _ECC, _ECC] += np.where(motion.observable[:, _ECC] & mixed, untold, 0.0)
        for mask in np.unique(heads[heads != 0]).tolist():
            self._fill(rows, np.flatnonzero(heads == mask), motion, self._layout(mask))
        motion.hide(mixed, (0, 1))
        turned = rows.turned**2
        motion.covariance[:, _ECC, _ECC] += np.where(motion.observable[:, _ECC], turned, 0.0)
        for place in (3, 4):
            motion.covariance[:, place, place] += np.where(motion.observable[:, place], self._slope**2 * turned, 0.0)
        return rows

    def _untold(self, heads: NDArray[np.int64], sampled: Mapping[str, Resampled], rates: Mapping[str, float]) -> Array:
        """(m,) variance by a fault of `heads` (m,) that the command does not tell: none would contradict them, rad².

        What is beyond following error, and latency times the speed, is told (Baarda 1968).
        """
        speed = np.zeros(len(heads))
        for bit, name in self._names.items():
            own = sampled[name].travel[: len(heads), 0] * rates[name] / 3.0  # over three intervals
            speed = np.where(heads & bit != 0, np.maximum(speed, own), speed)
        return np.asarray((self._at_rest + self._by_speed * speed) ** 2)

    def _fill(self, rows: MixedRows, at: NDArray[np.intp], motion: ErrorMotion, layout: HeadLayout) -> None:
        """Put what heads of a layout see at some ticks, and how uncertain their positioning is without the place."""
        mixed = layout.mixed / self._radius
        rows.sensitivity[at, 0, :2], rows.sensitivity[at, 0, _ECC] = mixed, 1.0
        described = planar_sum(self._spindle.radial, motion.theta[at])
        rows.displacement[at, 0] = motion.components[at, _ECC] + described @ mixed
        square = float(mixed @ mixed)
        motion.covariance[at, _ECC, _ECC] += np.where(
            motion.observable[at, _ECC], self._eccentricity * square + self._graduation, 0.0
        )
        rows.variance[at, 0] = motion.covariance[at, _ECC, _ECC]
        rows.there[at, 0] = motion.observable[at, _ECC]
        rows.turned[at] = np.sqrt(self._displaced * square)
        sizes, directions = np.linalg.eigh(layout.view[1])
        if sizes[-1] < 0.5:  # of one head nothing is free of the rotation
            return
        across = directions[:, -1]
        rows.sensitivity[at, 1, :2] = across
        rows.displacement[at, 1] = motion.components[at, :2] @ across
        rows.variance[at, 1] = motion.covariance[at, 0, 0]
        rows.there[at, 1] = motion.observable[at, 0]
