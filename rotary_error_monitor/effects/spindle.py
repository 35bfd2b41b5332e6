"""Effects of the spindle: error motion of its axis, bearing, load, warmth, unbalance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.effects.autocollimator import planar_row
from rotary_error_monitor.effects.effect import (
    Parameter,
    ParameterEstimate,
    Role,
    Searched,
    Values,
    planar_wave_of_order,
    wave_of_order,
)
from rotary_error_monitor.effects.rotor import DISPLACEMENT, HEAD, LISTED, RotorState, StageEffect


class SpindleRadial(StageEffect):
    """The axis moves radially with one more order. Order 1 is what a ring or an artefact off centre shows."""

    name = "spindle_radial"
    title = "synchronous radial error motion of one order"
    remedy = "State the order among spindle.radial, or look for the bearing's form error of that many lobes."
    source = "ISO 230-7, synchronous radial error motion"
    parameters = planar_wave_of_order("m", 1e-6, bound=1e-3)
    stands_out_in = (HEAD, *DISPLACEMENT)
    acts_on = (HEAD, *DISPLACEMENT)
    orders = 100
    falling = True
    lowest = 2

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the spindle's radial error motion."""
        return replace(stage, spindle=replace(stage.spindle, radial=(*stage.spindle.radial, planar_row(values))))


class SpindleTilt(StageEffect):
    """The axis tilts with one more order. Order 1 is what a mirror askew shows."""

    name = "spindle_tilt"
    title = "synchronous tilt error motion of one order"
    remedy = "State the order among spindle.tilt, or look for a form error of the thrust bearing."
    source = "ISO 230-7, synchronous tilt error motion"
    parameters = planar_wave_of_order("rad", 3e-6, bound=1e-2)
    stands_out_in = (AUTOCOLLIMATOR, *DISPLACEMENT)
    acts_on = (AUTOCOLLIMATOR, *DISPLACEMENT)
    orders = 100
    falling = True
    lowest = 2

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the spindle's tilt error motion."""
        return replace(stage, spindle=replace(stage.spindle, tilt=(*stage.spindle.tilt, planar_row(values))))


class SpindleAxial(StageEffect):
    """The axis moves along itself with one more order. Order 1 is the fundamental axial error motion."""

    name = "spindle_axial"
    title = "synchronous axial error motion of one order"
    remedy = "State the order among spindle.axial, or look for an axial run-out of the thrust face."
    source = "ISO 230-7, synchronous axial error motion"
    parameters = wave_of_order("m", 1e-6, bound=1e-3)
    stands_out_in = (LISTED,)
    acts_on = (LISTED,)
    orders = 100
    falling = True

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the spindle's axial error motion."""
        row = AngularHarmonic(round(values[0]), float(values[1]), float(values[2]))
        return replace(stage, spindle=replace(stage.spindle, axial=(*stage.spindle.axial, row)))


class BearingAsynchronous(StageEffect):
    """Rolling elements and cage move the axis at an order that is no whole number.

    The value vector holds the cosine and sine parts of the radial motion, in which the prediction is linear; reports
    give its size and phase.

    Attributes:
        apart: least distance of its order from a whole one. What is nearer is a synchronous motion that departs from
            its textbook form.
    """

    name = "bearing_asynchronous"
    title = "asynchronous error motion of the bearing"
    remedy = "Compare the order with cage and ball-pass orders of the bearing; look at preload and lubrication."
    source = "ISO 230-7, asynchronous error motion; cage and ball-pass orders of rolling bearings"
    parameters = (
        Parameter("order", "1", 1.0, role=Role.SHAPE, bound=100.0, least=0.01),
        Parameter("radial_cos", "m", 5e-7, bound=1e-3),
        Parameter("radial_sin", "m", 5e-7, bound=1e-3),
        Parameter("tilt", "rad", 1e-6, bound=1e-2),
    )
    searched = Searched.WAVE
    apart = 0.0

    def seen_in(self, stage: StageDescription, apart: float) -> Self:
        """The effect with the distance from whole orders that a recording needs."""
        found = copy(self)
        found.apart = apart if apart < 0.5 else 0.0  # where no order is far enough none is told from any other
        return found

    def bounds(self, near: Values | None = None) -> tuple[Values, Values]:
        """Between the whole orders beside one that is near."""
        low, high = super().bounds()
        if near is not None:
            below = math.floor(near[0])
            low[0], high[0] = max(low[0], below + self.apart), min(high[0], below + 1 - self.apart)
        return low, high

    def radial(self, values: Values, state: RotorState) -> Array:
        """`radial * (cos(order theta + phase), sin(order theta + phase))`."""
        order, along, across, _ = values
        cos, sin = state.harmonic(float(order))
        return np.stack([along * cos - across * sin, along * sin + across * cos]).T

    def tilt(self, values: Values, state: RotorState) -> Array:
        """`tilt * (cos(order theta), sin(order theta))`."""
        return np.asarray(values[3] * np.stack(state.harmonic(float(values[0]))).T, np.float64)

    def report(self, values: Values, covariance: NDArray[np.float64]) -> dict[str, ParameterEstimate]:
        """Order, size, tilt and phase, their spread by first-order propagation."""
        order, along, across, tilt = (float(value) for value in values)
        size = math.hypot(along, across)
        to_polar = np.zeros((4, 4))
        to_polar[0, 0] = to_polar[2, 3] = 1.0
        if size > 0:
            to_polar[1, 1:3] = along / size, across / size
            to_polar[3, 1:3] = -across / size**2, along / size**2
        std = np.sqrt(np.maximum(np.diag(to_polar @ covariance @ to_polar.T), 0.0))
        polar = (order, size, tilt, math.atan2(across, along))
        return {
            name: ParameterEstimate(value, float(spread))
            for name, value, spread in zip(("order", "radial", "tilt", "phase"), polar, std, strict=True)
        }

    def values_from(self, parameters: Mapping[str, Any]) -> Values:
        """Cosine and sine parts from size and phase."""
        told = self.numbers(parameters, dict.fromkeys(("order", "radial", "tilt", "phase"), 1))
        order, radial, tilt, phase = (float(number) for (number,) in told.values())
        return self.checked(np.array([order, radial * math.cos(phase), radial * math.sin(phase), tilt]))


class LoadCompliance(StageEffect):
    """The shaft yields to force more, or less, than the twin says."""

    name = "load_compliance"
    title = "compliance under load"
    remedy = "Check preload and clamping; state the compliances in the stage file so that forces are corrected."
    source = "Lou et al. 2019, Figure 15 (external force on the shaft)"
    parameters = (Parameter("radial", "m/N", 1e-8, bound=1e-5), Parameter("tilt", "rad/N", 3e-8, bound=1e-5))

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add to both compliances."""
        spindle = stage.spindle
        return replace(
            stage,
            spindle=replace(
                spindle,
                radial_compliance=spindle.radial_compliance + float(values[0]),
                tilt_compliance=spindle.tilt_compliance + float(values[1]),
            ),
        )


class ThermalDrift(StageEffect):
    """The axis moves sideways as the stage warms, or one place of it."""

    name = "thermal_drift"
    title = "radial drift with temperature"
    remedy = "Wait until the stage is warm, cool it, or state spindle.radial_thermal so that it is corrected."
    source = "ISO 230-3, drift of the axis average line"
    parameters = (Parameter("radial", "m/K", 5e-7, 2, bound=1e-4),)
    acts_on = (HEAD, *DISPLACEMENT)
    warms = True

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add to the drift per kelvin of the stage; that of a place has no place in a description."""
        if location:
            return stage
        x, y = stage.spindle.radial_thermal
        drift = (x + float(values[0]), y + float(values[1]))
        return replace(stage, spindle=replace(stage.spindle, radial_thermal=drift))

    def radial(self, values: Values, state: RotorState) -> Array | None:
        """In proportion to the warming of the place; that of the stage is in its description."""
        return np.outer(state.warming, values) if state.place else None


class AxialGrowth(StageEffect):
    """The spindle grows along its axis as the stage warms, or one place of it."""

    name = "axial_growth"
    title = "axial growth with temperature"
    remedy = "Wait until the spindle is warm, cool it, or compensate by its temperature."
    source = "ISO 230-3, axial drift of a rotating spindle"
    parameters = (Parameter("axial", "m/K", 5e-7, bound=1e-4),)
    acts_on = (LISTED,)
    warms = True

    def axial(self, values: Values, state: RotorState) -> Array:
        """In proportion to the warming."""
        return np.asarray(values[0] * state.warming, np.float64)


class RadialHysteresis(StageEffect):
    """The axis lies elsewhere in one direction of rotation than in the other."""

    name = "radial_hysteresis"
    title = "radial shift with the direction of rotation"
    remedy = "Look for a loose bearing seat, coupling or seal that drags the rotor sideways; preload the bearing."
    source = "ISO 230-1, 3.4.16 ff. (reversal)"
    parameters = (Parameter("radial", "m", 1e-6, 2, bound=1e-3),)
    acts_on = (HEAD, *DISPLACEMENT)

    def radial(self, values: Values, state: RotorState) -> Array:
        """Half of it in the direction of rotation."""
        return 0.5 * state.direction[:, None] * values


class Unbalance(StageEffect):
    """A turning force that grows with the square of the speed moves the axis."""

    name = "unbalance"
    title = "unbalance"
    remedy = "Balance the rotor with what it carries."
    source = "ISO 21940-11 (centrifugal force) on a compliant bearing"
    parameters = (Parameter("radial", "m s^2/rad^2", 3e-8, 2, bound=1e-5),)
    acts_on = (HEAD, *DISPLACEMENT)

    def radial(self, values: Values, state: RotorState) -> Array:
        """Speed squared times the vector on the rotor."""
        return np.square(state.omega)[:, None] * state.turned(values)
