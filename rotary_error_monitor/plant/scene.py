"""What is true of the stage at any time, and what a fault may change about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.environment import TemperatureCourse
from rotary_error_monitor.plant.geometry import Plane, Turns, as_columns
from rotary_error_monitor.plant.motion import CommandedCourse


@dataclass(frozen=True)
class Scene:
    """What is true at each of n times.

    Attributes:
        time: (n,) s after the epoch.
        command: (n,) what the controller commands, rad.
        velocity: (n,) the speed that the drive follows, rad/s.
        theta: (n,) true rotation, rad.
        turns: powers of `exp(1j * theta)`.
        force: (n,) on the shaft as `x + 1j * y`, N.
        warming: (n,) temperature above the reference, K.
        radial: (n,) displacement of the rotor at the ring as `x + 1j * y`, m.
        axial: (n,) its displacement along z, m.
        tilt: (n,) its tilt, rotation vector as `x + 1j * y`, rad.
        stage: the true stage.
        motion, temperature: their whole course, for what depends on the past.
        places: the same of the temperature of each place with a thermometer, by its name.
    """

    time: NDArray[np.float64]
    command: NDArray[np.float64]
    velocity: NDArray[np.float64]
    theta: NDArray[np.float64]
    turns: Turns
    force: Plane
    warming: NDArray[np.float64]
    radial: Plane
    axial: NDArray[np.float64]
    tilt: Plane
    stage: StageDescription
    motion: CommandedCourse
    temperature: TemperatureCourse
    places: Mapping[str, TemperatureCourse] = field(default_factory=dict)

    def warming_at(self, place: str) -> NDArray[np.float64]:
        """(n,) temperature of a place above the reference, K; of the stage where the place has no name."""
        if not place:
            return self.warming
        return self.places[place].at(self.time) - self.stage.reference_temperature

    @property
    def error_motion(self) -> NDArray[np.float64]:
        """(n, 6) true error motion at the ring: exc eyc ezc (m) eac ebc ecc (rad)."""
        radial, tilt, angular = as_columns(self.radial), as_columns(self.tilt), self.theta - self.command
        return np.column_stack([radial, self.axial, tilt, angular])


class Plant(Protocol):
    """The true stage as a fault asks it."""

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What the description does not say."""

    def having(self, faults: tuple[Fault, ...]) -> Plant:
        """The same stage with other faults."""

    def scene(self, time: NDArray[np.float64]) -> Scene:
        """What is true at `time` (n,) s after the epoch."""

    def signal(self, stream: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, fields) what an instrument without noise shows at `time` (n,) s after the epoch."""


class Fault:
    """Something about the true stage that its description does not say; a subclass overrides what it changes.

    Every method gets the value so far and gives the changed one; arrays are never changed in place. Vectors in the
    plane are complex, `x + 1j * y`.
    """

    def describe(self, stage: StageDescription) -> StageDescription:
        """Parameters of the stage."""
        return stage

    def over_time(self, plant: Plant, stream: str, time: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """(n, fields) all that a stream shows, where the size of the fault changes over time; None where it does not.

        The fault is among those of the plant; nothing else of it is asked then.
        """
        return None

    def age(self, stream: str) -> float:
        """Age of the values of a stream at their stamps, s."""
        return 0.0

    def trail(self) -> float:
        """How long the rotor trails the command, s."""
        return 0.0

    def drive(self, theta: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
        """True rotation (n,); the scene holds all but radial, axial and tilt."""
        return theta

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Displacement of the rotor (n,) m; in the scene radial, axial and tilt are without faults."""
        return radial

    def lift(self, axial: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
        """Displacement of the rotor along z (n,) m; in the scene radial, axial and tilt are without faults."""
        return axial

    def lean(self, tilt: Plane, scene: Scene) -> Plane:
        """Tilt of the rotor (n,) rad; in the scene radial, axial and tilt are without faults."""
        return tilt

    def centre(self, eccentricity: Plane, scene: Scene) -> Plane:
        """Ring centre in the rotor, (1,) or (n,) m."""
        return eccentricity

    def graduate(self, error: NDArray[np.float64], place: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
        """Graduation error (n,) rad at the places (n,) rad on the ring."""
        return error

    def read(self, angle: NDArray[np.float64], stream: str, scene: Scene) -> NDArray[np.float64]:
        """What a head sees (n,) rad, before noise and rounding."""
        return angle

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """What the autocollimator sees (n,) rad, before noise and rounding."""
        return tilt

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """What the reference sees (n,) m, before noise."""
        return radial

    def sense(self, reading: NDArray[np.float64], stream: str, scene: Scene) -> NDArray[np.float64]:
        """Reading of a listed sensor (n,), of several fields (n, fields), m or rad, before noise, range and resolution.

        Its zero and gain are in it.
        """
        return reading
