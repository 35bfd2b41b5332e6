"""What an effect of a pair of sine and cosine signals does: it displaces the point that goes round the circle."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    rank: int = 0

    def displacement(self, values: Values, location: str, state: CircleState) -> Complex:
        """(n,) by how much the point is displaced, cosine + i sine, counts."""
        raise TypeError(f"{type(self).__name__} does not say what it does")
