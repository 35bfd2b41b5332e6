"""How an instrument answers: its own zero, sign, gain, axes and delay, and what the package means by its readings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """Response of one instrument: `reading = zero + gain R(roll) true`, stamped `latency` after what it shows.

    `R(roll)` takes components along the package's axes to those along the axes of an instrument that is mounted turned
    by `-roll` about +z, which is the same as to turn what it shows by `roll`. Corrections undo this from the outside
    in: `true = R(-roll) (reading - zero) / gain`, `time = stamp - latency`.

    Attributes:
        zero: reading of each field where nothing is to be shown, in the field's unit; empty where that is 0.
        gain: reading per shown value, not 0; negative for an instrument that counts the other way, +1 or -1 of a head.
        roll: angle about +z by which the plane of a two-axis instrument is turned, rad; 0 for all others.
        latency: how long after what they show samples are stamped, s.
    """

    zero: tuple[float, ...] = ()
    gain: float = 1.0
    roll: float = 0.0
    latency: float = 0.0

    @property
    def is_ideal(self) -> bool:
        """Whether readings and stamps are what the package means by them."""
        return self.changes_no_value and self.latency == 0.0

    @property
    def changes_no_value(self) -> bool:
        """Whether readings are what the package means by them, whatever the stamps."""
        return not any(self.zero) and self.gain == 1.0 and self.roll == 0.0

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
            return _turned(from_zero / self.gain, -self.roll)

    def readings(self, values: Array) -> Array:
        """(n, k) what the instrument reads where values (n, k) are to be shown: the inverse of `corrected`."""
        if self.changes_no_value:
            return values
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = self.gain * _turned(values, self.roll)
            return np.asarray(scaled + self.zero if self.zero else scaled)

    def largest(self, reading: float) -> float:
        """Largest absolute corrected value where no reading is larger than `reading` times the absolute gain."""
        along = [reading + abs(zero / self.gain) for zero in self.zero or (0.0,)]
        if self.roll == 0.0:
            return max(along)
        cosine, sine = abs(math.cos(self.roll)), abs(math.sin(self.roll))
        x, y = along[0], along[-1]
        return max(cosine * x + sine * y, sine * x + cosine * y)


IDEAL = Response()
"""Of an instrument whose readings are what the package means by them."""


def _turned(values: Array, angle: float) -> Array:
    """(n, k) values; those of two axes turned about +z by an angle, rad."""
    if angle == 0.0:
        return values
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = values[:, 0], values[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
