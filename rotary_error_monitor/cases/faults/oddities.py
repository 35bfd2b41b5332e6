"""Faults of the stage that no vocabulary names: the right diagnosis of each is that it is unknown."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.cases.faults.named import Pair, Reals, StageFault, unnamed
from rotary_error_monitor.plant.geometry import Plane
from rotary_error_monitor.plant.scene import Scene


@unnamed("tilt_loop")
class TiltLoop(StageFault):
    """Friction lets the tilt run through a loop: another side forward than backward, turning twice with the rotor."""

    amplitude: Pair

    def lean(self, tilt: Plane, scene: Scene) -> Plane:
        """Loop."""
        return tilt + complex(*self.amplitude) * np.tanh(scene.velocity / 0.05) * scene.turns(2)


@unnamed("thermal_eccentricity")
class ThermalEccentricity(StageFault):
    """The ring wanders on its hub as it warms."""

    rate: Pair

    def centre(self, eccentricity: Plane, scene: Scene) -> Plane:
        """Wandering ring."""
        return eccentricity + complex(*self.rate) * scene.warming


@unnamed("loaded_gear_mesh")
class LoadedGearMesh(StageFault):
    """Teeth bend under load: a wave once per tooth that is as large as the force."""

    teeth: int
    amplitude: float

    def drive(self, theta: Reals, scene: Scene) -> Reals:
        """Wave under load."""
        return theta + self.amplitude * np.abs(scene.force) * np.cos(self.teeth * scene.command)


@unnamed("head_tilt_sensitivity")
class HeadTiltSensitivity(StageFault):
    """One head mistakes the squared tilt of the ring for rotation: its signal leaves the linear range."""

    gain: float

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Reading that depends on tilt."""
        return angle + self.gain * np.abs(scene.tilt) ** 2 if stream == self.location else angle


@unnamed("warm_crosstalk")
class WarmCrosstalk(StageFault):
    """The autocollimator's axes mix, more as it warms."""

    rate: float

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Part of y in x."""
        return tilt + self.rate * scene.warming * tilt.imag


@unnamed("stiffening_bearing")
class StiffeningBearing(StageFault):
    """The bearing stiffens: displacement goes with the square of the force, along it."""

    radial: float

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Displacement under load."""
        return radial + self.radial * np.abs(scene.force) * scene.force


@unnamed("ring_scratch")
class RingScratch(StageFault):
    """A scratch at one place of the ring, `extent` rad wide, shifts the graduation by `depth`."""

    place: float
    extent: float
    depth: float

    def graduate(self, error: Reals, place: Reals, scene: Scene) -> Reals:
        """Bump on the ring."""
        distance = np.remainder(place - self.place + np.pi, 2 * np.pi) - np.pi
        return error + self.depth * np.exp(-0.5 * (distance / self.extent) ** 2)


@unnamed("floor_vibration")
class FloorVibration(StageFault):
    """The rotor swings with the floor at a frequency of its own, whatever the speed."""

    frequency: float
    radial: Pair

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Swing."""
        return radial + complex(*self.radial) * np.sin(2 * np.pi * self.frequency * scene.time)


@unnamed("mirror_slip")
class MirrorSlip(StageFault):
    """The mirror slips on its seat at one moment and leans otherwise from then on."""

    time: float
    tilt: Pair

    def look(self, tilt: Plane, scene: Scene) -> Plane:
        """Tilt of the slipped mirror."""
        return tilt + complex(*self.tilt) * scene.turns.once * (scene.time >= self.time)


@unnamed("oil_film")
class OilFilm(StageFault):
    """The rotor floats up on its film with the root of the speed, fixed in the base."""

    radial: Pair

    def displace(self, radial: Plane, scene: Scene) -> Plane:
        """Lift."""
        return radial + complex(*self.radial) * np.sqrt(np.abs(scene.velocity))


@unnamed("probe_curvature")
class ProbeCurvature(StageFault):
    """The reference's characteristic is bent: it shows the square of what it touches, beside it."""

    quadratic: float

    def touch(self, radial: Plane, scene: Scene) -> Plane:
        """Bent characteristic."""
        return radial + self.quadratic * (radial.real**2 + 1j * radial.imag**2)


@unnamed("disc_slip")
class DiscSlip(StageFault):
    """The ring slips on the shaft at one moment: all heads go on from another angle, the rotor does not move."""

    time: float
    step: float

    def read(self, angle: Reals, stream: str, scene: Scene) -> Reals:
        """Step in every reading that stays."""
        return angle + self.step * (scene.time >= self.time)
