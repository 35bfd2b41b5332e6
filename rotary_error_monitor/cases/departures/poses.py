"""Faults of the machine whose size changes from pose to pose."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Departure, Part, Ranges, Reals, blended, sign
from rotary_error_monitor.cases.departures.swells import SIZES
from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.cases.faults.axes import AxisFault
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.plant.machine import MachineFault, MachinePlant, MachineStates, over_travel
from rotary_error_monitor.plant.noise import Noise, TurbulenceCourse


@dataclass(frozen=True, kw_only=True)
class PoseSwell(Departure):
    """The fault is larger or smaller in some poses; its size is 1 at the reference."""

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The fault with changing size."""
        assert isinstance(textbook, AxisFault)
        return (PoseSwelling(textbook, self),)

    @abstractmethod
    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """(n,) how many times its own size the fault has at each pose; poses follow one another in time."""


@dataclass(frozen=True)
class PoseSwelling(MachineFault):
    """A fault of the machine of changing size."""

    textbook: AxisFault
    swell: PoseSwell

    def over_poses(
        self, plant: MachinePlant, poses: MachineStates, corrections: Reals | None, monitored: Reals | None
    ) -> Reals:
        """Offsets of the tool at the size that the fault has at each pose."""
        others = tuple(fault for fault in plant.faults if fault is not self)
        offsets = []
        for size in SIZES:
            sized = replace(plant, faults=(*others, self.textbook.scaled(size)))
            offsets.append(sized.tool_offset(poses, corrections, monitored))
        return blended(offsets, SIZES, self.swell.factor(poses, plant.description))


def place(poses: MachineStates, machine: MachineDescription, letter: str) -> Reals:
    """(n,) where an axis is at each pose, scaled to its travel."""
    return over_travel(machine.axis(letter), poses.positions[:, machine.letters.index(letter)])


def lagging(warming: Reals, lag: float) -> Reals:
    """(n,) K of a part that follows the temperature (n,) of one pose after another, `lag` poses behind."""
    kept = np.exp(-1 / lag)
    follows = [float(warming[0])]
    for value in warming[1:].tolist():
        follows.append(value + (follows[-1] - value) * kept)
    return np.array(follows)


@dataclass(frozen=True, kw_only=True)
class PoseWarming(PoseSwell):
    """Grows with the temperature of its own part, `lag` poses behind the thermometer; strength in 1/K."""

    lag: float
    most: ClassVar[float] = 0.6
    told = "changes with temperature by {percent:+.3g} %/K, {lag:.0f} poses late"
    ranges: ClassVar[Ranges] = {"lag": (2.0, 40.0)}

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """In proportion to the temperature."""
        return 1 + self.strength * lagging(poses.warming, self.lag)


@dataclass(frozen=True, kw_only=True)
class LaggingScale(PoseSwell):
    """A scale expands with its own temperature, which lags the thermometer; strength in poses."""

    most: ClassVar[float] = 80.0
    signed = False  # lags are positive
    told = "the scale lags the thermometer by {strength:.3g} poses"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """Own temperature over that of the thermometer."""
        follows = lagging(poses.warming, max(self.strength, 1e-3))
        return np.divide(follows, poses.warming, out=np.zeros_like(follows), where=poses.warming != 0)


@dataclass(frozen=True, kw_only=True)
class ByAxis(PoseSwell):
    """Another size by where axis `letter` is, or by the way it came."""

    letter: str

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Any axis, either sign."""
        return cls(strength=sign(draw), letter=str(draw.choice(list("XYZCA"))))


@dataclass(frozen=True, kw_only=True)
class PoseOneWay(ByAxis):
    """Another size where axis `letter` came from the positive side, by the strength."""

    most: ClassVar[float] = 0.8
    told = "where {letter} travelled in its negative direction {percent:+.3g} % of its size"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """By the direction of travel."""
        return 1 + self.strength * (1 - poses.directions[:, machine.letters.index(self.letter)]) / 2


@dataclass(frozen=True, kw_only=True)
class AlongTravel(PoseSwell):
    """Changes along the travel of axis `letter` (None: the fault's), as its power 1 or 2; strength at the ends."""

    letter: str | None
    power: int

    @property
    def words(self) -> str:
        """The mechanism."""
        shape = {1: "towards one end", 2: "towards both ends"}[self.power]
        axis = f" of {self.letter}" if self.letter else ""
        return f"changes by {100 * self.strength:+.3g} % {shape} of the travel{axis}"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Any axis."""
        return cls(strength=sign(draw), letter=str(draw.choice(list("XYZCA"))), power=int(draw.integers(1, 3)))

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The fault with changing size along the travel."""
        letter = self.letter or (textbook.location[-1] if textbook.location else "Z")
        return PoseSwell.parts(replace(self, letter=letter), textbook)

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """Power of the position, scaled to the travel."""
        return 1 + self.strength * place(poses, machine, self.letter or "Z") ** self.power


@dataclass(frozen=True, kw_only=True)
class AlongOwn(AlongTravel):
    """Changes along the travel of the fault's own axis."""

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Towards one end or both."""
        return cls(strength=sign(draw), letter=None, power=int(draw.integers(1, 3)))


@dataclass(frozen=True, kw_only=True)
class PoseWander(PoseSwell):
    """Wanders slowly about its size, by the strength (standard deviation), within about `correlation` poses."""

    seed: int
    correlation: float
    most: ClassVar[float] = 0.5
    told = "wanders by {percent:.3g} % within {correlation:.0f} poses"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Over tens of poses."""
        return cls(seed=int(draw.integers(2**31)), correlation=float(draw.uniform(20.0, 80.0)))

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """First-order autoregressive noise."""
        noise = TurbulenceCourse(Noise(self.seed, "wander"), self.correlation)
        return 1 + self.strength * noise.at(np.arange(len(poses.warming), dtype=np.float64))


@dataclass(frozen=True, kw_only=True)
class PoseRunIn(PoseSwell):
    """Settles: another size at first, by the strength, which fades within `settling` poses."""

    settling: float
    told = "at first {percent:+.3g} % of its size, fading within {settling:.0f} poses"
    ranges: ClassVar[Ranges] = {"settling": (15.0, 80.0)}

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """Fades exponentially."""
        return 1 + self.strength * np.exp(-np.arange(len(poses.warming)) / self.settling)


@dataclass(frozen=True, kw_only=True)
class StiffeningHead(PoseSwell):
    """The head stiffens as it leans: less droop per lever, by the strength at full lever."""

    most: ClassVar[float] = 3.0
    signed = False  # springs only stiffen
    told = "stiffens under its weight: divided by 1 + {strength:.3g} at full lever"

    def factor(self, poses: MachineStates, machine: MachineDescription) -> Reals:
        """By the lever of the weight."""
        lever = np.abs(np.sin(poses.positions[:, machine.letters.index("A")]))
        return np.asarray(1 / (1 + self.strength * lever), np.float64)
