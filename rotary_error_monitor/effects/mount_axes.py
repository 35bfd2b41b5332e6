"""Effects of a mount's two axes: eccentric encoders and gears, their shape, gear ratio, backlash, slip, pier side."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rotary_error_monitor.description.machine import Harmonic, MachineDescription
from rotary_error_monitor.effects.effect import Parameter, Role, Values
from rotary_error_monitor.effects.machine_effect import positioning_error
from rotary_error_monitor.effects.mount_effect import Array, MountEffect, PointingState

_POINTING = "Wallace 2002, A rigorous algorithm for telescope pointing (Proc. SPIE 4848)"


def sign_of(machine: MachineDescription, letter: str) -> float:
    """1 if the axis turns positively about a coordinate of its body, -1 if negatively: errors are told about that."""
    return float(np.sign(sum(machine.axis(letter).direction)))


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
    source = f"{_POINTING}: HCES, HCEC, DCES, DCEC; ISO 230-1, 3.4.17 (ECC), order 1"
    parameters = (Parameter("cos", "rad", 3e-4, bound=0.1), Parameter("sin", "rad", 3e-4, bound=0.1))

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add order 1 to the axis's positioning error."""
        return _with_wave(machine, location, 1, values[0], values[1])


class AxisHarmonic(_AxisEffect):
    """The positioning error of an axis has one more low order."""

    name = "axis_harmonic"
    title = "shape of encoder or gear"
    source = "ISO 230-1, 3.4.17 (ECC); oval and three-lobed wheels, strain wave gears"
    parameters = (
        Parameter("order", "1", 1.0, role=Role.FIXED, bound=4, least=1),
        Parameter("cos", "rad", 3e-4, bound=0.1),
        Parameter("sin", "rad", 3e-4, bound=0.1),
    )
    harmonic_orders: ClassVar[tuple[int, ...]] = (2, 3, 4)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add the order to the axis's positioning error."""
        return _with_wave(machine, location, round(float(values[0])), values[1], values[2])


class AxisGearRatio(_AxisEffect):
    """An axis turns by a little more or less than it says."""

    name = "axis_gear_ratio"
    title = "gear ratio of an axis"
    source = "number of steps per turn set wrongly: error in proportion to the angle"
    parameters = (Parameter("relative", "1", 1e-3, bound=0.1),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add in proportion to the position."""
        low, high = machine.axis(location).travel
        slope = sign_of(machine, location) * float(values[0])
        poly = (0.5 * slope * (low + high), 0.5 * slope * (high - low))
        return machine.with_error(positioning_error(machine, location), poly=poly)


class AxisBacklash(_AxisEffect):
    """An axis lags half of a width behind in its direction of travel."""

    name = "axis_backlash"
    title = "backlash of an axis"
    source = "ISO 230-2, 3.9 (reversal error B)"
    parameters = (Parameter("width", "rad", 3e-4, bound=0.1),)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """Add to the axis's reversal."""
        return machine.with_axis(location, reversal=float(values[0]))


class AxisSlip(_AxisEffect):
    """An axis slips steadily, or its motor loses steps: its zero moves with time."""

    name = "axis_slip"
    title = "zero of an axis moves with time"
    source = "slipping clutch or lost steps: error in proportion to time"
    parameters = (Parameter("rate", "rad/s", 1e-7, bound=1e-3),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Turn about the axis in proportion to time."""
        return np.asarray(values[0] * state.time * about_axis(state, location), np.float64)


class PierSideShift(_AxisEffect):
    """An axis stands otherwise by a step when the tube changes to the other side of the pier."""

    name = "pier_side_shift"
    title = "step of an axis between the sides of the pier"
    source = "play or yielding that tips over when the mount is reversed"
    parameters = (Parameter("shift", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Half of the step forward on one side, half of it back on the other."""
        return np.asarray(0.5 * values[0] * state.side * about_axis(state, location), np.float64)


def _with_wave(
    machine: MachineDescription, letter: str, order: int, cos: np.float64, sin: np.float64
) -> MachineDescription:
    sign = sign_of(machine, letter)
    wave = Harmonic(order, sign * float(cos), sign * float(sin))
    return machine.with_error(positioning_error(machine, letter), harmonic=(wave,))
