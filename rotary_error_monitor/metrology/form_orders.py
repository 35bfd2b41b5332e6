"""Which form errors of what turns with the rotor pass for error motion to a set of sensors, and which contradict it.

A surface with waves of order k around the rotor, such as a graduation, an artefact or a face, shows a sensor at azimuth
phi the wave `exp(i k phi)` times the same amplitude as any other. What of these waves lies in the column space of the
map from error motion to sensors looks like error motion (Donaldson 1972); the rest is a residual that shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.encoder_heads import LEAK, Waves, explained
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.metrology.rigid_motion import SCALE, seen_directions


@dataclass(frozen=True)
class OrderView:
    """How waves of one order appear to a set of sensors.

    Attributes:
        order: waves per revolution.
        passing: largest part of their whitened square, 0 to 1, that some error motion explains, of any such form.
        components: of that error motion; empty where nothing passes.
    """

    order: int
    passing: float
    components: tuple[str, ...]

    @property
    def is_hidden(self) -> bool:
        """Whether no residual of these sensors shows a form of the order."""
        return self.passing == 1.0

    @property
    def is_seen(self) -> bool:
        """Whether all of it is residual."""
        return self.passing == 0.0


def view_order(order: int, sensitivity: Array, deviation: Array, waves: Waves) -> OrderView:
    """How one order of a surface appears.

    Args:
        order: waves per revolution.
        sensitivity: (p, 6) what each field of the sensors sees of exc eyc ezc eac ebc ecc.
        deviation: (p,) standard deviation of each, above 0.
        waves: (p, q) what each sees of the q shapes that a form may be mixed of; 0 of another surface.
    """
    basis = seen_directions(sensitivity)
    white = (sensitivity / SCALE) @ basis / deviation[:, None]
    shapes, _ = np.linalg.qr(waves / deviation[:, None])  # orthonormal: no mixture of them has another size
    motion, left = explained(white, shapes, 1e-12)
    _, sizes, mixtures = np.linalg.svd(left)
    residual = float(sizes[-1])  # of the mixture of which least is left
    moved = np.abs(basis @ motion @ mixtures[-1].conj())
    passing = 1.0 if residual < LEAK else 1.0 - residual**2
    if passing < LEAK**2:
        return OrderView(order, 0.0, ())
    if passing == 1.0:  # then of all mixtures that pass
        moved = np.abs(basis @ motion @ mixtures[sizes < LEAK].conj().T).max(axis=1)
    named = tuple(name for name, size in zip(COMPONENTS, moved, strict=True) if size > LEAK * moved.max())
    return OrderView(order, passing, named)
