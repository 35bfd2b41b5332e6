"""Forms of faults of the stage as their physics gives them, where the textbook takes the first term only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Departure, Part, Ranges
from rotary_error_monitor.cases.departures.swells import TYPICAL_FORCE
from rotary_error_monitor.cases.faults import Named
from rotary_error_monitor.cases.faults import rotor as moved
from rotary_error_monitor.plant.environment import lagged_warming
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.scene import Fault, Scene


@dataclass(frozen=True, kw_only=True)
class Form(Departure, Fault):
    """A departure that is itself what acts in the plant, with the textbook fault inside."""

    textbook: Named | None = field(default=None, repr=False)

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The fault in its own form."""
        return (self.of(textbook),)

    def of(self, textbook: Named) -> Self:
        """The same departure of a textbook fault."""
        return type(self)(**{**vars(self), "textbook": textbook})


@dataclass(frozen=True, kw_only=True)
class Stiffening(Form):
    """A contact that stiffens under load; strength at 100 N."""

    most: ClassVar[float] = 3.0
    signed = False  # contacts only stiffen
    told = f"stiffens under load: compliance divided by 1 + {{strength:.3g}} at {TYPICAL_FORCE:.0f} N"

    def _force(self, scene: Scene) -> Plane:
        return np.asarray(scene.force / (1 + self.strength * np.abs(scene.force) / TYPICAL_FORCE))

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Displacement under load."""
        assert isinstance(self.textbook, moved.LoadCompliance)
        return radial + self.textbook.radial * self._force(scene)

    def lean(self, tilt: Plane, scene: Scene) -> Plane:
        """Tilt under load, about the axis across the force."""
        assert isinstance(self.textbook, moved.LoadCompliance)
        return tilt + 1j * self.textbook.tilt * self._force(scene)


@dataclass(frozen=True, kw_only=True)
class UnlikeSides(Stiffening):
    """A bearing that yields more along an axis at `azimuth` than across it, by the strength."""

    azimuth: float
    most: ClassVar[float] = 0.8
    ranges: ClassVar[Ranges] = {"azimuth": (0, np.pi)}
    signed = False

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"by {100 * self.strength:.3g} % softer along {np.degrees(self.azimuth):.0f}°, stiffer across"

    def _force(self, scene: Scene) -> Plane:
        return np.asarray(scene.force + self.strength * np.exp(2j * self.azimuth) * scene.force.conj())


@dataclass(frozen=True, kw_only=True)
class Resonant(Form):
    """Unbalance below a resonance, damped by 5 %; strength is the square of 6 rad/s over the resonance's speed."""

    most: ClassVar[float] = 0.5
    signed = False  # resonances lie above the speeds

    @property
    def words(self) -> str:
        """The mechanism."""
        return f"grows towards a resonance at {6 / np.sqrt(self.strength):.3g} rad/s"

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Whirl of a rotor on springs (Jeffcott 1919)."""
        assert isinstance(self.textbook, moved.Unbalance)
        ratio = self.strength * (scene.velocity / 6.0) ** 2
        whirl = complex(*self.textbook.radial) * scene.velocity**2 / (1 - ratio + 0.1j * np.sqrt(ratio))
        return np.asarray(radial + whirl * scene.turns.once)


@dataclass(frozen=True, kw_only=True)
class LaggingDrift(Form):
    """The housing drifts with its own temperature, which lags the thermometer; strength in s."""

    most: ClassVar[float] = 25.0
    signed = False  # lags are positive
    told = "the housing lags the thermometer by {strength:.3g} s"

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Drift."""
        assert isinstance(self.textbook, moved.ThermalDrift)
        reference = scene.stage.reference_temperature
        lag = max(self.strength, 1e-3)
        return radial + complex(*self.textbook.radial) * lagged_warming(scene.temperature, reference, scene.time, lag)
