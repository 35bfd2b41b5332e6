"""Faults that are there in one half of a recording only: they resemble a known effect by about half of its power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Ranges, Reals
from rotary_error_monitor.cases.departures.poses import ByAxis, PoseSwell, place
from rotary_error_monitor.cases.departures.swells import Swell
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.plant.machine import MachineStates
from rotary_error_monitor.plant.scene import Scene

USUAL_DURATION = 40.0
"""Duration, s, of the recordings that moments and pauses are drawn for."""


@dataclass(frozen=True, kw_only=True)
class Begins(Swell):
    """Nothing until `time` s, all of it from then on."""

    time: float
    told = "from {time:.0f} s on"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """About the middle."""
        return cls(time=float(draw.uniform(0.35, 0.65)) * USUAL_DURATION)

    def factor(self, scene: Scene) -> Reals:
        """Step."""
        return np.asarray(scene.time >= self.time, np.float64)


@dataclass(frozen=True, kw_only=True)
class GrowsFromNothing(Swell):
    """Nothing at first, growing with a power of the time."""

    power: float
    told = "growing from nothing with time to the {power:.1f}"
    ranges: ClassVar[Ranges] = {"power": (1.8, 5.0)}
    signed = False

    def factor(self, scene: Scene) -> Reals:
        """Power of the time."""
        return np.asarray(np.clip(scene.time / USUAL_DURATION, 0, None) ** self.power, np.float64)


@dataclass(frozen=True, kw_only=True)
class ComesAndGoes(Swell):
    """There for some seconds, then not for as long, again and again."""

    period: float
    phase: float
    told = "coming and going every {period:.0f} s"
    ranges: ClassVar[Ranges] = {"period": (5.0, 14.0), "phase": (0, 2 * np.pi)}
    signed = False

    def factor(self, scene: Scene) -> Reals:
        """On and off, within a tenth of a second or so."""
        return np.asarray(0.5 + 0.5 * np.tanh(10 * np.sin(2 * np.pi / self.period * scene.time + self.phase)))


@dataclass(frozen=True, kw_only=True)
class HalfTurn(Swell):
    """There over one half of the turn only."""

    middle: float
    ranges: ClassVar[Ranges] = {"middle": (0, 2 * np.pi)}
    signed = False

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"in the half turn about {np.degrees(self.middle):.0f}° only"

    def factor(self, scene: Scene) -> Reals:
        """On and off within some degrees."""
        return np.asarray(0.5 + 0.5 * np.tanh(10 * np.cos(scene.theta - self.middle)))


@dataclass(frozen=True, kw_only=True)
class OnlyOneWay(Swell):
    """There in one direction of travel only, that of the strength's sign."""

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"in the {'positive' if self.strength > 0 else 'negative'} direction only"

    def factor(self, scene: Scene) -> Reals:
        """By the direction of travel."""
        return 0.5 + 0.5 * np.tanh(self.strength * scene.velocity / 0.01)


@dataclass(frozen=True, kw_only=True)
class PoseBegins(PoseSwell):
    """Nothing until a part of the poses is done, all of it from then on."""

    part: float
    ranges: ClassVar[Ranges] = {"part": (0.35, 0.65)}
    signed = False

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"after {100 * self.part:.0f} % of the poses"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """Step."""
        count = len(poses.warming)
        return np.asarray(np.arange(count) >= self.part * count, np.float64)


@dataclass(frozen=True, kw_only=True)
class PoseGrows(PoseSwell):
    """Nothing at first, growing with a power of the number of poses."""

    power: float
    told = "growing from nothing with the poses to the {power:.1f}"
    ranges: ClassVar[Ranges] = {"power": (1.8, 5.0)}
    signed = False

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """Power of the number."""
        return np.asarray(np.linspace(0, 1, len(poses.warming)) ** self.power, np.float64)


@dataclass(frozen=True, kw_only=True)
class PoseOnlyOneWay(ByAxis):
    """There where axis `letter` came from one side only, that of the strength's sign."""

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"where {self.letter} travelled in its {'positive' if self.strength > 0 else 'negative'} direction only"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """By the direction of travel."""
        direction = poses.directions[:, machine.letters.index(self.letter)]
        return 0.5 + 0.5 * self.strength * direction


@dataclass(frozen=True, kw_only=True)
class HalfTravel(ByAxis):
    """There over one half of the travel of axis `letter` only, that of the strength's sign."""

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"in the {'upper' if self.strength > 0 else 'lower'} half of the travel of {self.letter} only"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """By the position, within a tenth of the travel."""
        return 0.5 + 0.5 * np.tanh(10 * self.strength * place(poses, machine, self.letter))


STAGE_HALVES = (Begins, GrowsFromNothing, ComesAndGoes, HalfTurn, OnlyOneWay)
MACHINE_HALVES = (PoseBegins, PoseGrows, PoseOnlyOneWay, HalfTravel)
