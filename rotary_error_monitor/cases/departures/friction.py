"""Play and friction that remember the way: what a reversal leaves until the drive has travelled on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Departure, Part, Reals
from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.cases.faults.rotor import RadialHysteresis, ReversalBacklash
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.motion import CommandedCourse
from rotary_error_monitor.plant.scene import Fault, Scene

STEP = 0.004
"""Step, s, at which the past of a drive is followed."""
AT_REST = 1e-9
"""Travel, rad, within a step that is rounding."""


def side_of_play(motion: CommandedCourse, time: Reals, travel: float, release: float, before: float) -> Reals:
    """Side, from -1 to 1, on which a drive with friction and compliant flanks lies at `time` (n,) s.

    While it moves the side goes to that of the travel as `exp(-travelled / travel)`: Dahl's friction, of which the play
    operator with stiff flanks is the limit of no travel. At rest it stays where it is, and is released slowly by creep.

    Args:
        motion: what drives.
        time: ascending; from 0 on.
        travel: over which the flanks yield, rad.
        release: time constant of the creep at rest, s.
        before: side at time 0, from -1 to 1.
    """
    grid = np.arange(0.0, max(float(time.max()), 0.0) + 2 * STEP, STEP)
    steps = np.diff(motion.at(grid)[0])
    kept = np.exp(-np.abs(steps) / travel)
    crept = float(np.exp(-STEP / release))
    sides = [before]
    for step, keep in zip(steps.tolist(), kept.tolist(), strict=True):
        side = sides[-1]
        if abs(step) <= AT_REST:
            sides.append(side * crept)
        else:
            way = 1.0 if step > 0 else -1.0
            sides.append(way + (side - way) * keep)
    return np.asarray(np.interp(time, grid, sides), dtype=np.float64)


@dataclass(frozen=True)
class Sided(Fault, ABC):
    """Backlash or hysteresis of which the side is not that of the present travel alone."""

    textbook: ReversalBacklash | RadialHysteresis

    @abstractmethod
    def side(self, scene: Scene) -> Reals:
        """(n,) side, from -1 to 1."""

    def drive(self, theta: Reals, scene: Scene) -> Reals:
        """Lag behind the command."""
        fault = self.textbook
        return theta - fault.width / 2 * self.side(scene) if isinstance(fault, ReversalBacklash) else theta

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Side of the clearance."""
        fault = self.textbook
        return radial + complex(*fault.radial) / 2 * self.side(scene) if isinstance(fault, RadialHysteresis) else radial


@dataclass(frozen=True)
class RememberedSide(Sided):
    """The side follows the travelled way."""

    travel: float
    release: float
    before: float

    def side(self, scene: Scene) -> Reals:
        """As the drive left it."""
        return side_of_play(scene.motion, scene.time, self.travel, self.release, self.before)


@dataclass(frozen=True, kw_only=True)
class CompliantFlanks(Departure):
    """Play that stays at rest, with flanks that yield over a travel; strength in rad."""

    release: float
    before: float
    most: ClassVar[float] = 20.0

    @property
    def words(self) -> str:
        """The mechanism."""
        return (
            f"stays at rest where it was (creep within {self.release:.2g} s); "
            f"flanks yield over {self.strength:.2g} rad of travel"
        )

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Fast or slow creep; before the recording either side."""
        release = float(np.exp(draw.uniform(np.log(0.02), np.log(20.0))))
        return cls(release=release, before=float(draw.choice([-1.0, 1.0])))

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """Backlash or hysteresis with memory."""
        assert isinstance(textbook, ReversalBacklash | RadialHysteresis)
        return (RememberedSide(textbook, max(self.strength, 1e-6), self.release, self.before),)


@dataclass(frozen=True)
class SoftSign(Sided):
    """An oil film softens it at low speed, within `speed` rad/s."""

    speed: float

    def side(self, scene: Scene) -> Reals:
        """By the speed."""
        return np.tanh(scene.velocity / self.speed)


@dataclass(frozen=True, kw_only=True)
class OilFilmSide(Departure):
    """The side turns softly with the speed; strength is the speed, rad/s."""

    most: ClassVar[float] = 10.0
    signed = False  # one shape only
    told = "soft at low speed, within {strength:.2g} rad/s"

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """Backlash or hysteresis, softened."""
        assert isinstance(textbook, ReversalBacklash | RadialHysteresis)
        return (SoftSign(textbook, max(self.strength, 1e-6)),)
