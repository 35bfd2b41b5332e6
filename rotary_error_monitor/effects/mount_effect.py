"""What an effect of a two-axis mount does: it changes the mount's machine, or turns what points.

At a star only directions count, so whatever yields, slips or is refracted is one small rotation of the tube: it may be
told in the ground's frame, whichever body it acts on, and the rotations of several effects add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.effects.effect import Effect, Values

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointingState:
    """Where a mount stands at n pointings; vectors (3, n) are unit vectors in the ground's frame, z up.

    Attributes:
        polar: along the hour axis, to the pole.
        declination: along the declination axis; the tube moves this way when the hour axis turns west.
        tube: optical axis.
        upward: (3, 1) to the zenith.
        sought: (3, n) to the star as it would stand without refraction.
        refraction: (n,) angle, rad, by which the twin says that the air lifts it.
        side: (n,) -1 with the tube on the side of the pier where declination reads below 90°, 1 on the other.
        time: (n,) s from the middle of the recording.
    """

    polar: Array
    declination: Array
    tube: Array
    upward: Array
    sought: Array
    refraction: Array
    side: Array
    time: Array


class MountEffect(Effect[MachineDescription]):
    """An effect of a two-axis mount; a concrete one has `amend`, `turn`, or both."""

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """The mount's machine with the effect in it."""
        return machine

    def turn(self, values: Values, location: str, state: PointingState) -> Array | None:
        """(3, n) small rotation of the tube in the ground's frame, rad; None for none."""
        return None


def cross(a: Array, b: Array) -> Array:
    """(3, n) cross products of (3, n) or (3, 1) vectors."""
    a, b = np.broadcast_arrays(a, b)
    return np.asarray(np.cross(a, b, axis=0), np.float64)


def dot(a: Array, b: Array) -> Array:
    """(n,) scalar products."""
    return np.asarray(np.sum(a * b, axis=0), np.float64)
