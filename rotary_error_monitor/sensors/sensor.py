"""What every kind of sensor declares: its streams, fields and unit, its noise, and what it shows of the rotor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.effects.rotor import RotorState


class Pose(Protocol):
    """The rotor as a twin has it at the n samples of a stream: how it turns, and how it moves beside that."""

    @property
    def stage(self) -> StageDescription:
        """The description, with what effects change of it."""

    @property
    def state(self) -> RotorState:
        """Rotation, speed, force and warming."""

    def radial(self) -> Array:
        """(n, 2) radial error motion at the ring, m."""

    def axial(self) -> Array:
        """(n,) axial error motion, m."""

    def tilt(self) -> Array:
        """(n, 2) tilt error motion, a rotation vector in rad."""


@dataclass(frozen=True, kw_only=True)
class RadialView:
    """How a sensor sees the radial error motion at one height: the estimate can be held against it.

    Attributes:
        axes, directions: p names, such as `x` and `y`, and (p, 2) unit vectors in the plane of the stage.
        height: above the ring, m.
        form, azimuth: of the target by orders of the place on it, m, but its eccentricity; where that is seen, rad.
        eccentricity: of the target (x, y) in the rotor's frame, m.
        zero, scale: (p,) reading of a perfect axis, m, and reading per displacement; 0 and 1 of corrected samples.
        noise, resolution: standard deviation of a sample before rounding, and its step, m; 0 where none is stated.
        gain, roll, place: stated standard uncertainty of the gain (of 1), the directions (rad), the height (m).
        lasting: variance of what is the same in each turn, such as the stated form, m².
    """

    axes: tuple[str, ...]
    directions: Array
    height: float
    form: tuple[AngularHarmonic, ...] = ()
    azimuth: float = 0.0
    eccentricity: tuple[float, float]
    zero: tuple[float, ...] = (0.0, 0.0)
    scale: float = 1.0
    noise: float
    resolution: float = 0.0
    gain: float
    roll: float
    place: float
    lasting: float = 0.0


class Sensor(ABC):
    """Base of all kinds of sensor; one object stands for all sensors of a kind.

    Attributes:
        kind: first word of the names of its streams: `head` of `head_a`.
        section: of the stage's description that states it.
        fields: of a sample, as `msg_defs/` names them.
        unit: SI unit of the fields.
        is_needed: whether a recording without it is no recording of a stage.
        moved_by: beginnings of the names of the description's parameters that move what it shows.
    """

    kind: ClassVar[str] = ""
    section: ClassVar[str] = ""
    fields: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = ""
    is_needed: ClassVar[bool] = True
    moved_by: ClassVar[tuple[str, ...]] = ()

    @property
    def small_unit(self) -> str:
        """Unit in which people read what it shows: millionths of the SI unit."""
        return f"µ{self.unit}"

    @abstractmethod
    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """Names of the streams that a stage has of this kind."""

    @abstractmethod
    def noise(self, stage: StageDescription, stream: str) -> float:
        """Standard deviation of one sample, rounding included."""

    def resolution(self, stage: StageDescription, stream: str) -> float:
        """Step of a sample, in the same unit; 0 where none is stated."""
        return 0.0

    def turbulence(self, stage: StageDescription) -> Turbulence | None:
        """Slow part of its noise; None where it has none."""
        return None

    @abstractmethod
    def shown(self, stream: str, pose: Pose) -> Array:
        """What a sensor without fault shows of the rotor, (n,) or (n, fields)."""

    def radial_view(self, stage: StageDescription, stream: str) -> RadialView | None:
        """How it sees the radial error motion at a height; None of one that does not, or sees more than that."""
        return None

    def within_range(self, stage: StageDescription, stream: str, shown: Array) -> Array:
        """What an instrument says that would show this; what lies beyond its range stays at its end."""
        return shown
