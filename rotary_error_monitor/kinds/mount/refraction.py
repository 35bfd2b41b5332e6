"""How far the air lifts a star."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array

LOWEST = np.radians(5.0)
"""Altitude, rad, down to which two terms hold to a few arcseconds; lower stars do not count, with the
refraction of this altitude."""


@dataclass(frozen=True)
class Weather:
    """The air at the site: temperature °C, pressure hPa, humidity 0 … 1, wavelength of the light µm."""

    temperature: float
    pressure: float
    humidity: float
    wavelength: float = 0.55


def refraction_constants(weather: Weather) -> tuple[float, float]:
    """A and B, rad, of refraction `A tan z + B tan³ z` in the apparent zenith distance z, for visible light.

    Refractivity of Gill 1982 (Atmosphere-Ocean Dynamics, saturation pressure) and Green 1985 (Spherical Astronomy),
    B of Stone 1996 (PASP 108, 1051, Equation 4).
    """
    celsius, pressure = weather.temperature, weather.pressure
    if pressure <= 0:
        return 0.0, 0.0
    kelvin = celsius + 273.15
    saturated = 10 ** ((0.7859 + 0.03477 * celsius) / (1 + 0.00412 * celsius))
    saturated *= 1 + pressure * (4.5e-6 + 6e-10 * celsius**2)
    vapour = weather.humidity * saturated / (1 - (1 - weather.humidity) * saturated / pressure)
    square = weather.wavelength**2
    dry = 77.53484e-6 + (4.39108e-7 + 3.666e-9 / square) / square
    refractivity = (dry * pressure - 11.2684e-6 * vapour) / kelvin
    height = 4.4474e-6 * kelvin
    return float(refractivity * (1 - height)), float(-refractivity * (height - 0.5 * refractivity))


def refraction_of(altitude: Array, weather: Weather) -> Array:
    """(n,) angle, rad, by which a star at the true altitude (n,) seems higher.

    The constants hold for the apparent altitude; one step of Newton's method goes from there to the true one.
    """
    a, b = refraction_constants(weather)
    tangent = 1 / np.tan(np.maximum(altitude, LOWEST))
    lift = (a + b * tangent**2) * tangent
    slope = (1 + tangent**2) * (a + 3 * b * tangent**2)
    return np.asarray(lift / (1 + slope), np.float64)
