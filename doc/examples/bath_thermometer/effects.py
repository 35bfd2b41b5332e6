"""A thermometer as it is described, and what it can do wrong."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.effects.effect import Effect, Parameter, Values

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Thermometer:
    """Section `thermometer` of a twin."""

    noise: Annotated[float, Expected("standard deviation of a reading in K", above=0, most=10)]
    zero: Annotated[float, Expected("standard uncertainty of the zero in K", 0, 10)]


class ThermometerEffect(Effect[Thermometer]):
    """An effect of a thermometer."""

    def shown(self, values: Values, time: Array, temperature: Array) -> Array:
        """(n,) what it shows, °C, of a temperature (n,) at times (n,) in s."""
        raise NotImplementedError


class Lag(ThermometerEffect):
    """The thermometer takes time to become as warm as the bath."""

    name = "thermometer_lag"
    title = "thermometer lags behind the bath"
    source = "Newton's law of cooling"
    parameters = (Parameter("constant", "s", 5.0, bound=600.0, least=0.0),)

    def shown(self, values: Values, time: Array, temperature: Array) -> Array:
        """Exact where the temperature runs straight between samples."""
        if values[0] <= 0:
            return temperature
        behind, step = np.zeros(len(time)), np.diff(time)
        lags = values[0] * np.diff(temperature) / step
        for i, kept in enumerate(np.exp(-step / values[0])):
            behind[i + 1] = behind[i] * kept + lags[i] * (1 - kept)
        return temperature - behind
