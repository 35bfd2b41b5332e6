"""Neighbours: orders and waves that come along with the one that a textbook names."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Departure, Part, Ranges
from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.cases.faults.axes import CyclicError
from rotary_error_monitor.plant.machine import MachineFault
from rotary_error_monitor.plant.scene import Fault

LEAST_ORDER = 2
"""Order 1 is another effect where radial, tilt and the mirror are concerned."""


@dataclass(frozen=True, kw_only=True)
class Neighbours(Departure):
    """The orders below and above come along, each with part of the size; strength is the larger part.

    Attributes:
        below, above: (4,) what the coefficients of the fault are multiplied by in either neighbour.
    """

    below: tuple[float, ...]
    above: tuple[float, ...]
    told = "with the neighbouring orders, up to {percent:.3g} % of its size"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Any phase; one neighbour as a rule larger than the other."""
        below, above = draw.normal(size=(2, 4)) * draw.uniform(0.1, 1.0, (2, 1))
        largest = float(max(np.abs(below).max(), np.abs(above).max()))
        return cls(below=tuple((below / largest).tolist()), above=tuple((above / largest).tolist()))

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The order and its neighbours."""
        order = int(textbook.parameters["order"])
        rows = [textbook, self._neighbour(textbook, order + 1, self.above)]
        if order > LEAST_ORDER:
            rows.append(self._neighbour(textbook, order - 1, self.below))
        return tuple(row for row in rows if isinstance(row, Fault | MachineFault))

    def _neighbour(self, textbook: Named, order: int, parts: tuple[float, ...]) -> Named:
        """The fault at another order; its coefficients are those of the textbook's size, with other phases."""
        names = [row.name for row in fields(textbook) if row.name not in ("location", "order")]
        size = float(np.linalg.norm(np.concatenate([np.atleast_1d(getattr(textbook, name)) for name in names])))
        changes: dict[str, Any] = {"order": order}
        taken = 0
        for name in names:
            count = len(np.atleast_1d(getattr(textbook, name)))
            values = [self.strength * size / 2 * part for part in parts[taken : taken + count]]
            changes[name] = tuple(values) if count > 1 else values[0]
            taken += count
        return replace(textbook, **changes)


@dataclass(frozen=True, kw_only=True)
class SecondWave(Departure):
    """A lead screw's wave of half the period comes along, `strength` times as large."""

    phase: float
    most: ClassVar[float] = 1.0
    told = "with a wave of half the period, {percent:.3g} % of its size"
    ranges: ClassVar[Ranges] = {"phase": (0, 2 * np.pi)}
    signed = False

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """Both waves."""
        assert isinstance(textbook, CyclicError)
        size = self.strength * float(np.hypot(textbook.cos, textbook.sin))
        cos, sin = size * float(np.cos(self.phase)), size * float(np.sin(self.phase))
        return (textbook, replace(textbook, period=textbook.period / 2, cos=cos, sin=sin))
