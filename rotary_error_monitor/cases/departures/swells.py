"""Faults of the stage whose size changes with what happens around them."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from rotary_error_monitor.cases.departures.departure import Departure, Part, Ranges, Reals, blended
from rotary_error_monitor.cases.faults import Named, StageFault
from rotary_error_monitor.plant.environment import lagged_warming
from rotary_error_monitor.plant.noise import Noise, TurbulenceCourse
from rotary_error_monitor.plant.scene import Fault, Plant, Scene

SIZES = (0.0, 0.5, 1.0)
"""Sizes at which a fault is simulated, times its own; those between and a little beyond follow from them."""

TYPICAL_FORCE = 100.0
"""Force, N, by which the dependence on force is counted; pushes by hand reach 180 N."""


@dataclass(frozen=True, kw_only=True)
class Swell(Departure):
    """The fault is larger or smaller at times; its size is 1 at the reference."""

    def parts(self, textbook: Named) -> tuple[Part, ...]:
        """The fault with changing size."""
        assert isinstance(textbook, StageFault)
        return (Swelling(textbook, self),)

    @abstractmethod
    def factor(self, scene: Scene) -> Reals:
        """(n,) how many times its own size the fault has in the scene, which is that without the fault."""


@dataclass(frozen=True)
class Swelling(Fault):
    """A fault of the stage of changing size."""

    textbook: StageFault
    swell: Swell

    def over_time(self, plant: Plant, stream: str, time: Reals) -> Reals:
        """Signals at the size that the fault has at each time."""
        others = tuple(fault for fault in plant.faults if fault is not self)
        signals = []
        for size in SIZES:
            faulty = (*others, self.textbook.scaled(size))
            signals.append(plant.having(faulty).signal(stream, time))
        return blended(signals, SIZES, self.swell.factor(plant.having(()).scene(time)))


@dataclass(frozen=True, kw_only=True)
class Warming(Swell):
    """Grows with the temperature of its own part, which lags the thermometer by `lag` s; strength in 1/K."""

    lag: float
    most: ClassVar[float] = 0.6
    told = "changes with temperature by {percent:+.3g} %/K, {lag:.0f} s behind the thermometer"
    ranges: ClassVar[Ranges] = {"lag": (1.0, 15.0)}

    def factor(self, scene: Scene) -> Reals:
        """In proportion to the temperature."""
        return 1 + self.strength * lagged_warming(
            scene.temperature, scene.stage.reference_temperature, scene.time, self.lag
        )


@dataclass(frozen=True, kw_only=True)
class OneWay(Swell):
    """Smaller or larger in the negative direction of travel, by the strength."""

    most: ClassVar[float] = 0.8
    told = "in the negative direction {percent:+.3g} % of its size"

    def factor(self, scene: Scene) -> Reals:
        """Between both sizes at rest."""
        return 1 + self.strength * 0.5 * (1 - np.tanh(scene.velocity / 0.01))


@dataclass(frozen=True, kw_only=True)
class LowSpeed(Swell):
    """Weaker near standstill, by the strength, up to about `speed` rad/s."""

    speed: float
    told = "by {percent:.3g} % weaker near standstill, up to {speed:.2g} rad/s"
    ranges: ClassVar[Ranges] = {"speed": (0.4, 2.5)}
    signed = False

    def factor(self, scene: Scene) -> Reals:
        """Rises to its size with the speed."""
        return 1 - self.strength * np.exp(-np.abs(scene.velocity) / self.speed)


@dataclass(frozen=True, kw_only=True)
class Fast(Swell):
    """Grows with the square of the speed; strength at 6 rad/s."""

    told = "changes with the square of the speed, by {percent:+.3g} % at 6 rad/s"

    def factor(self, scene: Scene) -> Reals:
        """In proportion to the square of the speed."""
        return 1 + self.strength * (scene.velocity / 6.0) ** 2


@dataclass(frozen=True, kw_only=True)
class Around(Swell):
    """Differs around the turn, `order` times: sidebands of what turns with the rotor."""

    order: int
    phase: float

    @property
    def words(self) -> str:
        """The mechanism."""
        times = {1: "once", 2: "twice"}.get(self.order, f"{self.order} times")
        return f"larger and smaller {times} around the turn, by {100 * self.strength:.3g} %"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Once or twice, anywhere."""
        return cls(order=int(draw.integers(1, 3)), phase=float(draw.uniform(0, 2 * np.pi)))

    def factor(self, scene: Scene) -> Reals:
        """Wave over the turn."""
        return 1 + self.strength * np.cos(self.order * scene.theta - self.phase)


@dataclass(frozen=True, kw_only=True)
class Wander(Swell):
    """Wanders slowly about its size, by the strength (standard deviation), within about `correlation` s."""

    seed: int
    correlation: float
    most: ClassVar[float] = 0.5
    told = "wanders by {percent:.3g} % within {correlation:.0f} s"

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """Over some seconds."""
        return cls(seed=int(draw.integers(2**31)), correlation=float(draw.uniform(4.0, 15.0)))

    def factor(self, scene: Scene) -> Reals:
        """First-order autoregressive noise, smoothed over a tenth of its correlation time."""
        noise = TurbulenceCourse(Noise(self.seed, "wander"), self.correlation)
        shifts = np.linspace(-0.05, 0.05, 5) * self.correlation
        smooth = np.mean([noise.at(scene.time + shift) for shift in shifts], axis=0)
        return np.asarray(1 + self.strength * smooth, np.float64)


@dataclass(frozen=True, kw_only=True)
class RunIn(Swell):
    """Runs in: larger or smaller at first by the strength, which fades within `settling` s."""

    settling: float
    told = "at first {percent:+.3g} % of its size, fading within {settling:.0f} s"
    ranges: ClassVar[Ranges] = {"settling": (3.0, 15.0)}

    def factor(self, scene: Scene) -> Reals:
        """Fades exponentially."""
        return 1 + self.strength * np.exp(-scene.time / self.settling)


@dataclass(frozen=True, kw_only=True)
class Pressed(Swell):
    """Changes while a force presses; strength at 100 N."""

    most: ClassVar[float] = 2.0
    told = f"changes under load, by {{percent:+.3g}} % at {TYPICAL_FORCE:.0f} N"

    def factor(self, scene: Scene) -> Reals:
        """In proportion to the force."""
        return 1 + self.strength * np.abs(scene.force) / TYPICAL_FORCE
