"""Effects of the autocollimator and the mirror that it looks at."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.effects.effect import Parameter, Values, planar_wave_of_order
from rotary_error_monitor.effects.rotor import ComponentGain, RotorState, StageEffect


class AutocollimatorGain(ComponentGain):
    """One component of the autocollimator reads too large or too small."""

    name = "autocollimator_gain"
    title = "autocollimator's scale"
    remedy = "Calibrate the scale against a small-angle generator and state it as gain of the autocollimator."
    source = "calibration of an autocollimator's scale factor"
    acts_on = (AUTOCOLLIMATOR,)


class AutocollimatorRoll(StageEffect):
    """The instrument is turned about its line of sight."""

    name = "autocollimator_roll"
    title = "autocollimator turned about its line of sight"
    remedy = "Turn the instrument about its line of sight, or state the angle as roll of the autocollimator."
    source = "rotation of the measuring axes"
    parameters = (Parameter("angle", "rad", 1e-2, bound=math.pi),)
    rescales = True
    acts_on = (AUTOCOLLIMATOR,)

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Components along the turned axes."""
        cos, sin = math.cos(values[0]), math.sin(values[0])
        return np.stack([cos * ideal[:, 0] + sin * ideal[:, 1], -sin * ideal[:, 0] + cos * ideal[:, 1]], axis=1)


class AutocollimatorNonlinearity(StageEffect):
    """The scale grows with the deflection."""

    name = "autocollimator_nonlinearity"
    title = "cubic error of the autocollimator"
    remedy = "Work nearer to the middle of the range (align the mirror), or calibrate the instrument."
    source = "odd distortion of the objective, lowest order"
    parameters = (Parameter("cubic", "rad^-2", 1e6, bound=1e9),)
    rescales = True
    acts_on = (AUTOCOLLIMATOR,)

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add the cubes of the components."""
        return np.asarray(ideal + values[0] * ideal**3, np.float64)


class AutocollimatorDrift(StageEffect):
    """The autocollimator's zero moves steadily."""

    name = "autocollimator_drift"
    title = "drift of the autocollimator"
    remedy = "Let the instrument warm up, shield it from draughts, and zero it again; note how long it took."
    source = "warming-up of the instrument, lowest order in time"
    parameters = (Parameter("rate", "rad/s", 1e-7, 2, bound=1e-4),)
    acts_on = (AUTOCOLLIMATOR,)

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add rate times time."""
        return ideal + state.time[:, None] * values


class AutocollimatorLatency(StageEffect):
    """The autocollimator's values are older than their stamps."""

    name = "autocollimator_latency"
    title = "autocollimator late"
    remedy = "State the delay as latency of the autocollimator, or have its driver stamp when it measures."
    source = "sampling delay: tilt error = rate of the tilt x delay"
    parameters = (Parameter("delay", "s", 1e-3, bound=1.0),)
    rescales = True
    acts_on = (AUTOCOLLIMATOR,)

    def delay(self, values: Values, location: str) -> float:
        """The age itself."""
        return float(values[0])


class MirrorWobble(StageEffect):
    """The mirror is mounted at another tilt than the twin says."""

    name = "mirror_wobble"
    title = "mirror mounted askew"
    remedy = "Align the mirror, or calibrate its tilt (`calibrate assembly`) and state it as mirror.tilt."
    source = "Lou et al. 2019, Section 2.3 (mirror on the rotor)"
    parameters = (Parameter("tilt", "rad", 1e-5, 2, bound=1e-2),)
    acts_on = (AUTOCOLLIMATOR,)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add to the mirror's tilt."""
        x, y = stage.mirror.tilt
        return replace(stage, mirror=replace(stage.mirror, tilt=(x + float(values[0]), y + float(values[1]))))


class MirrorFlatness(StageEffect):
    """The mirror's surface shows one more order over a turn. Order 1 is what a mirror askew shows."""

    name = "mirror_flatness"
    title = "mirror's flatness of one order"
    remedy = "Calibrate the mirror (`calibrate assembly`), or state the order among mirror.flatness."
    source = "Lou et al. 2019, Section 2.3 (mirror on the rotor)"
    parameters = planar_wave_of_order("rad", 3e-6, bound=1e-2)
    stands_out_in = (AUTOCOLLIMATOR,)
    acts_on = (AUTOCOLLIMATOR,)
    orders = 100
    falling = True
    lowest = 2

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the mirror's flatness."""
        row = planar_row(values)
        return replace(stage, mirror=replace(stage.mirror, flatness=(*stage.mirror.flatness, row)))


def planar_row(values: Values) -> PlanarHarmonic:
    """Row of a description from the values order, x (cos, sin), y (cos, sin)."""
    order, x_cos, x_sin, y_cos, y_sin = (float(value) for value in values)
    return PlanarHarmonic(round(order), (x_cos, x_sin), (y_cos, y_sin))
