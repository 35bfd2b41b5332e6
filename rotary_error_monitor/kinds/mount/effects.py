"""Effects of a two-axis mount: of its axes (encoders, gears, backlash, slip), its bodies (flexure), ground and air.

At a star only directions count, so whatever yields, slips or is refracted is one small rotation of the tube: it may be
told in the ground's frame, whichever body it acts on, and the rotations of several effects add up. A beam that carries
its own weight turns its end by an angle in proportion to the moment, which is the cross product of the beam's direction
and gravity; each flexure is that product for one body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Harmonic
from rotary_error_monitor.effects.effect import Effect, Parameter, Values, wave_of_order
from rotary_error_monitor.effects.machine_effect import sign_of, with_positioning_error

_POINTING = "Wallace 2002, A rigorous algorithm for telescope pointing (Proc. SPIE 4848)"


@dataclass(frozen=True)
class PointingState:
    """Where a mount stands at n pointings; vectors (3, n) are unit vectors in the ground's frame, z up.

    Attributes:
        polar: along the hour axis, to the pole.
        declination: along the declination axis; the tube moves this way when the hour axis turns west.
        tube: optical axis.
        upward: (3, 1) to the zenith.
        sought: (3, n) to the star as it would stand without refraction.
        refraction: (n,) angle, rad, by which the twin says that the air lifts it.
        side: (n,) -1 with the tube on the side of the pier where declination reads below 90°, 1 on the other.
        time: (n,) s from the middle of the recording.
    """

    polar: Array
    declination: Array
    tube: Array
    upward: Array
    sought: Array
    refraction: Array
    side: Array
    time: Array


class MountEffect(Effect[MachineDescription]):
    """An effect of a two-axis mount; a concrete one has `amend`, `turn`, or both.

    Attributes:
        harmonic_orders: orders of the axis that its parameter `order` may have; 0 for an effect without one.
    """

    harmonic_orders: ClassVar[tuple[int, ...]] = (0,)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """The mount's machine with the effect in it."""
        return machine

    def turn(self, values: Values, location: str, state: PointingState) -> Array | None:
        """(3, n) small rotation of the tube in the ground's frame, rad; None for none."""
        return None


def cross(a: Array, b: Array) -> Array:
    """(3, n) cross products of (3, n) or (3, 1) vectors."""
    a, b = np.broadcast_arrays(a, b)
    return np.asarray(np.cross(a, b, axis=0), np.float64)


def dot(a: Array, b: Array) -> Array:
    """(n,) scalar products."""
    return np.asarray(np.sum(a * b, axis=0), np.float64)


def about_axis(state: PointingState, letter: str) -> Array:
    """(3, n) unit vector about which an axis turns positively, in the ground's frame."""
    return -state.polar if letter == "H" else state.declination


class _AxisEffect(MountEffect):
    """An effect of one of the two axes."""

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Each axis."""
        return machine.letters


class AxisEccentricity(_AxisEffect):
    """The encoder's ring or the gear's wheel of an axis sits off centre."""

    name = "axis_eccentricity"
    title = "encoder or gear off centre"
    remedy = "Centre the wheel or ring, or put the term into the pointing model."
    source = f"{_POINTING}: HCES, HCEC, DCES, DCEC; ISO 230-1, 3.4.17 (ECC), order 1"
    parameters = (Parameter("cos", "rad", 3e-4, bound=0.1), Parameter("sin", "rad", 3e-4, bound=0.1))

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add order 1 to the axis's positioning error."""
        return _with_wave(machine, location, 1, values[0], values[1])


class AxisHarmonic(_AxisEffect):
    """The positioning error of an axis has one more low order."""

    name = "axis_harmonic"
    title = "shape of encoder or gear"
    remedy = "Look for an oval or three-lobed wheel; put the term into the pointing model."
    source = "ISO 230-1, 3.4.17 (ECC); oval and three-lobed wheels, strain wave gears"
    parameters = wave_of_order("rad", 3e-4, bound=0.1, highest=4)
    harmonic_orders = (2, 3, 4)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add the order to the axis's positioning error."""
        return _with_wave(machine, location, round(float(values[0])), values[1], values[2])


class AxisGearRatio(_AxisEffect):
    """An axis turns by a little more or less than it says."""

    name = "axis_gear_ratio"
    title = "gear ratio of an axis"
    remedy = "Correct the number of steps per turn in the controller."
    source = "number of steps per turn set wrongly: error in proportion to the angle"
    parameters = (Parameter("relative", "1", 1e-3, bound=0.1),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add in proportion to the position."""
        low, high = machine.axis(location).travel
        slope = sign_of(machine, location) * float(values[0])
        poly = (0.5 * slope * (low + high), 0.5 * slope * (high - low))
        return with_positioning_error(machine, location, poly=poly)


class AxisBacklash(_AxisEffect):
    """An axis lags half of a width behind in its direction of travel."""

    name = "axis_backlash"
    title = "backlash of an axis"
    remedy = "Adjust the mesh of worm and wheel; approach from one side meanwhile."
    source = "ISO 230-2, 3.9 (reversal error B)"
    parameters = (Parameter("width", "rad", 3e-4, bound=0.1),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add to the axis's reversal."""
        return machine.with_axis(location, reversal=float(values[0]))


class AxisSlip(_AxisEffect):
    """An axis slips steadily, or its motor loses steps: its zero moves with time."""

    name = "axis_slip"
    title = "zero of an axis moves with time"
    remedy = "Tighten clutch and set screws; look for lost steps (current, acceleration)."
    source = "slipping clutch or lost steps: error in proportion to time"
    parameters = (Parameter("rate", "rad/s", 1e-7, bound=1e-3),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Turn about the axis in proportion to time."""
        return np.asarray(values[0] * state.time * about_axis(state, location), np.float64)


class PierSideShift(_AxisEffect):
    """An axis stands otherwise by a step when the tube changes to the other side of the pier."""

    name = "pier_side_shift"
    title = "step of an axis between the sides of the pier"
    remedy = "Look for play that tips over at the meridian flip (dovetail, mirror, adapter)."
    source = "play or yielding that tips over when the mount is reversed"
    parameters = (Parameter("shift", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Half of the step forward on one side, half of it back on the other."""
        return np.asarray(0.5 * values[0] * state.side * about_axis(state, location), np.float64)


class TubeFlexure(MountEffect):
    """The tube, or what holds mirror and camera in it, sags."""

    name = "tube_flexure"
    title = "tube sags"
    remedy = "Stiffen tube, dovetail and focuser, or put the term into the pointing model."
    source = f"{_POINTING}: TF; in proportion to the sine of the zenith distance"
    parameters = (Parameter("sag", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Downward by the sag times the sine of the zenith distance."""
        return np.asarray(values[0] * cross(state.tube, -state.upward), np.float64)


class DeclinationAxisFlexure(MountEffect):
    """The declination axis sags."""

    name = "declination_axis_flexure"
    title = "declination axis sags"
    remedy = "Stiffen the declination axis, or put the term into the pointing model."
    source = f"{_POINTING}: DAF"
    parameters = (Parameter("sag", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """The axis's end that the tube sits on goes down."""
        return np.asarray(values[0] * cross(state.declination, -state.upward), np.float64)


class ForkFlexure(MountEffect):
    """What carries the declination axis's bearings yields about that axis."""

    name = "fork_flexure"
    title = "fork yields"
    remedy = "Stiffen the fork, or put the term into the pointing model."
    source = f"{_POINTING}: FO"
    parameters = (Parameter("yield", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """About the declination axis, by the part of the weight across the fork."""
        # Gravity along both axes is borne; what is left, across their plane, bends the fork's arms about the bearings.
        across = cross(state.polar, state.declination)
        return np.asarray(values[0] * dot(across, state.upward) * state.declination, np.float64)


class SettlingGround(MountEffect):
    """The ground or a leg of the tripod gives way steadily."""

    name = "settling_ground"
    title = "mount tips over time"
    remedy = "Let the pier settle, or set the tripod on firm ground; align again."
    source = "rotation of the base about a level axis in proportion to time"
    parameters = (Parameter("rate", "rad/s", 1e-8, 2, bound=1e-4),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """About south and east in proportion to time."""
        return np.stack([values[0] * state.time, values[1] * state.time, np.zeros_like(state.time)])


class RefractionScale(MountEffect):
    """The air bends light otherwise than the twin says, or the controller has taken a part of it out already."""

    name = "refraction_scale"
    title = "other refraction"
    remedy = "Check temperature and pressure that refraction is taken off with, and that it is taken off once."
    source = "Stone 1996, PASP 108, 1051 (refraction in proportion to density); -1: none is left in the file"
    parameters = (Parameter("relative", "1", 0.3, bound=10.0),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """The mount that shows a star stands lower by what is more: the prediction moves down, not the star up."""
        up = cross(state.sought, state.upward)
        level = up / np.maximum(np.sqrt(dot(up, up)), 1e-12)
        return np.asarray(-values[0] * state.refraction * level, np.float64)


def _with_wave(
    machine: MachineDescription, letter: str, order: int, cos: np.float64, sin: np.float64
) -> MachineDescription:
    sign = sign_of(machine, letter)
    wave = Harmonic(order, sign * float(cos), sign * float(sin))
    return with_positioning_error(machine, letter, harmonic=(wave,))
