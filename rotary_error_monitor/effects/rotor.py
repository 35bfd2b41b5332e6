"""What an effect of the rotary stage may see and touch: the rotor at the sample times of one stream."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.effect import Effect, Values

Array = NDArray[np.float64]

HEAD = "head"
AUTOCOLLIMATOR = "autocollimator"
LVDT = "lvdt"


@dataclass(frozen=True)
class RotorState:
    """The rotor at `n` instants.

    Attributes:
        time: (n,) s since the recording's first stamp.
        command: (n,) commanded rotation, rad.
        omega: (n,) commanded speed, rad/s.
        theta: (n,) rotation that the twin assumes, rad.
        force: (n, 2) force on the shaft, N.
        warming: (n,) temperature above the reference, K.
        command_at: commanded rotation at any times (m,).
        lines: graduation lines per revolution.
        observed: (n,) what the sensor itself read, rad; only heads have it. It carries the phase of errors within a
            line, far finer than the command knows the rotation.
    """

    time: Array
    command: Array
    omega: Array
    theta: Array
    force: Array
    warming: Array
    command_at: Callable[[Array], Array]
    lines: int
    observed: Array | None = None
    _harmonics: dict[float, tuple[Array, Array]] = field(default_factory=dict, repr=False, compare=False)

    def harmonic(self, order: float) -> tuple[Array, Array]:
        """Cosine and sine of `order * theta`, kept because many effects share them."""
        if order not in self._harmonics:
            angle = order * self.theta
            self._harmonics[order] = np.cos(angle), np.sin(angle)
        return self._harmonics[order]

    def turned(self, vector: Array | tuple[float, float]) -> Array:
        """(n, 2) a vector fixed on the rotor, in the base: `Rz(theta) @ vector`."""
        cos, sin = self.harmonic(1)
        return np.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]], axis=1)

    def rotated(self, by: Array) -> RotorState:
        """The same instants with the true rotation ahead of this one by `by` (n,) rad."""
        return replace(self, theta=self.theta + by, _harmonics={})


class StageEffect(Effect):
    """An effect of the rotary stage: overrides the hooks that it needs, the others leave everything as it is.

    The twin evaluates, for the samples of each stream: `delay`, then `rotation`, then `amend` of the description, then
    `radial` and `tilt` error motion, then `measured` for what the sensor makes of it.

    Attributes:
        acts_on: streams that it can move, `head` standing for all heads; a location `head_I` narrows it to that head.
    """

    acts_on: ClassVar[tuple[str, ...]] = (HEAD, AUTOCOLLIMATOR, LVDT)

    def touches(self, location: str, stream: str) -> bool:
        """Whether the effect there can move the prediction of that stream (`head_a`, …, `autocollimator`, `lvdt`)."""
        if location.startswith(f"{HEAD}_"):
            return stream == location
        return stream.partition("_")[0] in self.acts_on

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """The description with the effect in its parameters."""
        return stage

    def delay(self, values: Values, location: str) -> float:
        """Age of the samples at their stamp, s."""
        return 0.0

    def rotation(self, values: Values, state: RotorState) -> Array | None:
        """(n,) part of the true rotation beyond the command, rad."""
        return None

    def radial(self, values: Values, state: RotorState) -> Array | None:
        """(n, 2) part of the radial error motion at the ring, m."""
        return None

    def tilt(self, values: Values, state: RotorState) -> Array | None:
        """(n, 2) part of the tilt error motion, a rotation vector in rad."""
        return None

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """What the touched sensor says instead of `ideal`, which is (n,) for a head and (n, 2) for the others."""
        return ideal


def head_locations(stage: StageDescription) -> tuple[str, ...]:
    """Location of each read head."""
    return tuple(f"{HEAD}_{letter}" for letter in sorted(stage.encoder.azimuths))
