"""Faults of what moves: drive, bearing, and how the rotor yields to force, heat and speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotary_error_monitor.cases.faults.named import Pair, Reals, StageFault, vocabulary
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.scene import Scene


@vocabulary("spindle_radial")
class SpindleRadial(StageFault):
    """One more order of synchronous radial error motion."""

    order: int
    x: Pair
    y: Pair

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other radial error motion."""
        rows = (*stage.spindle.radial, PlanarHarmonic(self.order, self.x, self.y))
        return replace(stage, spindle=replace(stage.spindle, radial=rows))


@vocabulary("spindle_tilt")
class SpindleTilt(StageFault):
    """One more order of synchronous tilt error motion."""

    order: int
    x: Pair
    y: Pair

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other tilt error motion."""
        rows = (*stage.spindle.tilt, PlanarHarmonic(self.order, self.x, self.y))
        return replace(stage, spindle=replace(stage.spindle, tilt=rows))


@vocabulary("bearing_asynchronous")
class BearingAsynchronous(StageFault):
    """The rotor orbits with an order that is no whole number, as rolling elements make it."""

    order: float
    radial: float
    tilt: float
    phase: float

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Orbit."""
        phase = self.order * scene.theta + self.phase
        return radial + self.radial * (np.cos(phase) + 1j * np.sin(phase))

    def lean(self, tilt: Plane, scene: Scene) -> Plane:
        """Cone."""
        phase = self.order * scene.theta
        return tilt + self.tilt * (np.cos(phase) + 1j * np.sin(phase))


@vocabulary("load_compliance")
class LoadCompliance(StageFault):
    """The rotor yields more to force than described."""

    radial: float
    tilt: float

    def describe(self, stage: StageDescription) -> StageDescription:
        """Other compliances."""
        spindle = replace(
            stage.spindle,
            radial_compliance=stage.spindle.radial_compliance + self.radial,
            tilt_compliance=stage.spindle.tilt_compliance + self.tilt,
        )
        return replace(stage, spindle=spindle)


@vocabulary("thermal_drift")
class ThermalDrift(StageFault):
    """The rotor drifts more with temperature than described."""

    radial: Pair

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Drift; a location is the place of a thermometer whose warming it goes with."""
        return radial + complex(*self.radial) * scene.warming_at(self.location)


@vocabulary("unbalance")
class Unbalance(StageFault):
    """Unbalance pulls the rotor with the square of the speed."""

    radial: Pair

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Whirl."""
        return radial + complex(*self.radial) * scene.velocity**2 * scene.turns.once


@vocabulary("radial_hysteresis")
class RadialHysteresis(StageFault):
    """The rotor sits elsewhere forward than backward, by `radial`."""

    radial: Pair

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Side of the clearance."""
        return radial + complex(*self.radial) / 2 * _way(scene.velocity)


@vocabulary("reversal_backlash")
class ReversalBacklash(StageFault):
    """The rotor lags the command by half of `width` in the direction of travel."""

    width: float

    def drive(self, theta: Reals, scene: Scene) -> Reals:
        """Lag."""
        return theta - self.width / 2 * _way(scene.velocity)


@vocabulary("following_error")
class FollowingError(StageFault):
    """The rotor follows the command of `delay` ago."""

    delay: float

    def trail(self) -> float:
        """Delay of the drive."""
        return self.delay


@vocabulary("drive_cyclic_error")
class DriveCyclicError(StageFault):
    """Gear or motor let the rotation err as a wave in the command."""

    order: int
    cos: float
    sin: float

    def drive(self, theta: Reals, scene: Scene) -> Reals:
        """Wave in the rotation."""
        phase = self.order * scene.command
        return theta + self.cos * np.cos(phase) + self.sin * np.sin(phase)


def _way(velocity: Reals) -> Reals:
    """Direction of travel: 1, -1, or 0 at rest, where rounding leaves the velocity a little off zero."""
    return np.sign(np.where(np.abs(velocity) > 1e-9, velocity, 0.0))
