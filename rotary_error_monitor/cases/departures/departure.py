"""What a departure is: how a real fault differs from the form that textbooks give it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.plant.machine import MachineFault
from rotary_error_monitor.plant.scene import Fault

Reals = NDArray[np.float64]
Ranges = Mapping[str, tuple[float, float]]
Part = Fault | MachineFault
"""What acts in the plant: a fault of the stage or of the machine."""


@dataclass(frozen=True, kw_only=True)
class Departure(ABC):
    """A mechanism by which a fault differs from its textbook form; 0 is no difference.

    Attributes:
        strength: how much; what it multiplies is said by each class.
        most: largest strength that a real stage or machine may have.
        signed: whether the strength may be negative.
        ranges: of the values of its shape, drawn evenly in this order.
        told: the mechanism, with its values and the strength in `percent` to be filled in.
    """

    strength: float = 1.0
    most: ClassVar[float] = 1.0
    signed: ClassVar[bool] = True
    ranges: ClassVar[Ranges] = {}
    told: ClassVar[str] = ""

    @property
    def words(self) -> str:
        """The mechanism, for a reader."""
        return self.told.format(percent=100 * self.strength, **vars(self))

    @abstractmethod
    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """What acts in the plant instead of the textbook fault."""

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """The mechanism with drawn shape, if it has one, and a strength of 1 or -1, to be scaled."""
        strength = sign(draw) if cls.signed else 1.0
        return cls(strength=strength, **{name: float(draw.uniform(*each)) for name, each in cls.ranges.items()})

    def scaled(self, factor: float) -> Self:
        """The same mechanism, `factor` times as strong."""
        return replace(self, strength=factor * self.strength)


@dataclass(frozen=True)
class Varied:
    """A fault of the vocabulary that departs from its textbook form.

    Attributes:
        textbook: the fault as the vocabulary describes it, with the parameters at the reference.
        departure: how it differs.
    """

    textbook: Named
    departure: Departure

    @property
    def name(self) -> str:
        """Name of the effect in the vocabulary."""
        return self.textbook.name

    @property
    def location(self) -> str:
        """Where it sits."""
        return self.textbook.location

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the textbook form."""
        return self.textbook.parameters


AnyFault = Named | Varied


def acting(faults: Sequence[AnyFault]) -> tuple[Part, ...]:
    """What acts in the plant where these faults are present."""
    parts: list[Part] = []
    for fault in faults:
        if isinstance(fault, Varied):
            parts += fault.departure.parts(fault.textbook)
        elif isinstance(fault, Fault | MachineFault):
            parts.append(fault)
    return tuple(parts)


def sign(draw: np.random.Generator) -> float:
    """1 or -1, drawn."""
    return float(draw.choice([-1.0, 1.0]))


def blended(signals: Sequence[Reals], sizes: Sequence[float], factor: Reals) -> Reals:
    """Signals at the size `factor` (n,), from those at some fixed sizes, each (n, k), by Lagrange's interpolation.

    A fault whose size changes slowly acts at each moment as if it had always been of that size. Signals are almost in
    proportion to the size, so three sizes give those between to less than rounding.
    """
    total = np.zeros_like(signals[0])
    for i, (signal, size) in enumerate(zip(signals, sizes, strict=True)):
        weight = np.ones_like(factor)
        for j, other in enumerate(sizes):
            if i != j:
                weight = weight * (factor - other) / (size - other)
        total += weight[:, None] * signal
    return total
