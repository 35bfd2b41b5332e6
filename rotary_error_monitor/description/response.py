"""How an instrument answers: its own zero, sign, gain, axes, distortion and delay, and what its readings mean."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array


@dataclass(frozen=True)
class Response:
    """Response of one instrument: `reading = zero + gain D(R(roll) true)`, stamped `latency` after what it shows.

    `R(roll)` takes components along the package's axes to those along the axes of an instrument that is mounted turned
    by `-roll` about +z, which is the same as to turn what it shows by `roll`. `D` is the distortion of an instrument of
    two axes, nothing by default: with `(u, v) = ((1 + d/2) x + k y, (1 - d/2) y + k x)`, where d is `gain_difference`
    and k `cross_coupling`, it is `(u + cubic[0] u^3, v + cubic[1] v^3)`. Any linear answer of two axes of one hand is
    `gain`, `roll`, d and k in exactly one way, with `gain` above 0 (polar decomposition). Corrections undo this from
    the outside in: `true = R(-roll) D^-1((reading - zero) / gain)`, `time = stamp - latency`.

    Attributes:
        zero: reading of each field where nothing is to be shown, in the field's unit; empty where that is 0.
        gain: reading per shown value, not 0; negative for an instrument that counts the other way, +1 or -1 of a head.
        roll: angle about +z by which the plane of a two-axis instrument is turned, rad; 0 for all others.
        latency: how long after what they show samples are stamped, s.
        gain_difference: gain of the instrument's x axis less that of its y axis, as a part of `gain`.
        cross_coupling: what either axis reads of the other, as a part of `gain`, the same both ways.
        cubic: growth of each axis' reading with the square of what it shows, 1 per squared unit; empty where it is 0.
    """

    zero: tuple[float, ...] = ()
    gain: float = 1.0
    roll: float = 0.0
    latency: float = 0.0
    gain_difference: float = 0.0
    cross_coupling: float = 0.0
    cubic: tuple[float, ...] = ()

    @property
    def is_ideal(self) -> bool:
        """Whether readings and stamps are what the package means by them."""
        return self.changes_no_value and self.latency == 0.0

    @property
    def changes_no_value(self) -> bool:
        """Whether readings are what the package means by them, whatever the stamps."""
        return not any(self.zero) and self.gain == 1.0 and self.roll == 0.0 and not self.is_distorted

    @property
    def is_distorted(self) -> bool:
        """Whether the axes differ in gain, read of one another, or are not straight."""
        return self.gain_difference != 0.0 or self.cross_coupling != 0.0 or any(self.cubic)

    @property
    def latency_ns(self) -> int:
        """How long after what they show samples are stamped, ns."""
        return round(self.latency * 1e9)

    def corrected(self, readings: Array) -> Array:
        """(n, k) what the package means by readings (n, k) of the first k fields, in the field's unit."""
        if self.changes_no_value:
            return readings
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite stays so, and is refused behind
            from_zero = readings - self.zero[: readings.shape[1]] if self.zero else readings
            return _turned(self._undistorted(from_zero / self.gain), -self.roll)

    def readings(self, values: Array) -> Array:
        """(n, k) what the instrument reads where values (n, k) are to be shown: the inverse of `corrected`."""
        if self.changes_no_value:
            return values
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = self.gain * self._distorted(_turned(values, self.roll))
            return np.asarray(scaled + self.zero if self.zero else scaled)

    def undistorted(self, readings: Array) -> Array:
        """(n, 2) what an instrument of the same zero, gain and roll reads that has no distortion."""
        if not self.is_distorted:
            return readings
        zero = np.array(self.zero or (0.0, 0.0))
        return np.asarray(zero + self.gain * self._undistorted((readings - zero) / self.gain))

    def largest(self, reading: float) -> float:
        """Largest absolute corrected value where no reading is larger than `reading` times the absolute gain."""
        along = [reading + abs(zero / self.gain) for zero in self.zero or (0.0,)]
        if self.is_distorted:
            corners = np.array([[along[0], along[-1]], [along[0], -along[-1]]])
            along = [float(most) for most in np.abs(self._undistorted(corners)).max(axis=0)]
        if self.roll == 0.0:
            return max(along)
        cosine, sine = abs(math.cos(self.roll)), abs(math.sin(self.roll))
        x, y = along[0], along[-1]
        return max(cosine * x + sine * y, sine * x + cosine * y)

    def rises_to(self, axis: int) -> float:
        """Largest reading of an axis, from `zero` and over the gain, up to which it rises with what is shown."""
        cubic = self._cubic(axis)
        return 2 / (3 * math.sqrt(-3 * cubic)) if cubic < 0 else math.inf

    def _distorted(self, values: Array) -> Array:
        if not self.is_distorted:
            return values
        straight = values @ self._shape
        return np.asarray(straight + np.array(self.cubic or (0.0, 0.0)) * straight**3)

    def _undistorted(self, values: Array) -> Array:
        if not self.is_distorted:
            return values
        straight = np.stack([_root(values[:, axis], self._cubic(axis)) for axis in range(2)], axis=1)
        return np.asarray(straight @ np.linalg.inv(self._shape))

    def _cubic(self, axis: int) -> float:
        return self.cubic[axis] if self.cubic else 0.0

    @property
    def _shape(self) -> Array:
        half, both = self.gain_difference / 2, self.cross_coupling
        return np.array([[1 + half, both], [both, 1 - half]])


IDEAL = Response()
"""Of an instrument whose readings are what the package means by them."""


def _turned(values: Array, angle: float) -> Array:
    """(n, k) values; those of two axes turned about +z by an angle, rad."""
    if angle == 0.0:
        return values
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = values[:, 0], values[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def _root(values: Array, cubic: float) -> Array:
    """(n,) the u of which `u + cubic u^3` is (n,) values, by Viète; where these do not rise so far, that of the end."""
    if cubic == 0.0:
        return values
    scale = math.sqrt(3 * abs(cubic))
    third = 1.5 * scale * values
    if cubic > 0:
        return np.asarray(2 / scale * np.sinh(np.arcsinh(third) / 3))
    # readings beyond the end are left out as saturated; what is not finite must stay so
    within = np.where(np.isfinite(third), np.clip(third, -1.0, 1.0), np.nan)
    return np.asarray(2 / scale * np.sin(np.arcsin(within) / 3))
