"""What an effect of a pair of sine and cosine signals does: it displaces the point that goes round the circle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.quadrature import QuadratureDescription
from rotary_error_monitor.effects.effect import Effect, Values

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class CircleState:
    """The ideal signals at n true phases: cosine + i sine, in counts.

    Attributes:
        turning: (n,) of length 1.
        amplitude: counts.
        signals: (n,) what the effects before this one leave.
    """

    turning: Complex
    amplitude: float
    signals: Complex


class QuadratureEffect(Effect[QuadratureDescription]):
    """An effect of sine and cosine signals.

    Attributes:
        rank: effects act in rising order: optics and photodiodes first, converters last.
        rescales: whether it is looked at beside the causes found: where signals are cut off, a gain shows otherwise.
            Not so harmonics and saturation: beside each other they differ by next to nothing, and that must not count.
    """

    rank: ClassVar[int] = 0
    rescales: ClassVar[bool] = False

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """(n,) by how much the point is displaced, cosine + i sine, counts."""
        raise TypeError(f"{type(self).__name__} does not say what it does")
