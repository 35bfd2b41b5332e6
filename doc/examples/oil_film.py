"""An effect of one's own: the rotor floats up on its oil film, the faster it turns."""

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Parameter, Values
from rotary_error_monitor.effects.rotor import RotorState, StageEffect


class OilFilm(StageEffect):
    """Lift that goes with the root of the speed and points to one side of the base, whichever way the rotor turns."""

    name = "oil_film"
    title = "lift on the oil film"
    source = "hydrodynamic journal bearing, short-bearing approximation at small lift"
    parameters = (Parameter("lift", "m/(rad/s)^0.5", 1e-6, size=2, bound=1e-3),)

    def radial(self, values: Values, state: RotorState) -> Array:
        """Displacement (n, 2) of the rotor, m."""
        return np.sqrt(np.abs(state.omega))[:, None] * values
