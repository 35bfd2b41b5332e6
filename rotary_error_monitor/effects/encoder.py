"""Effects of the graduated ring and its read heads."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from typing import Self

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Parameter, Role, Searched, Values, wave_of_order
from rotary_error_monitor.effects.rotor import HEAD, RotorState, StageEffect

_FLATTEST = 0.01
"""Least slope of the reading over the angle: a larger error turns it back, and no one angle can be told from it."""

_PHASE_RESOLUTION = 1e-7
"""A step of Newton's method below this, rad of a line, leaves its square."""

_MOST_STEPS = 8
"""Newton's steps from Danby's value: as many as the steepest error that can be told needs, of slope `_FLATTEST`; one of
half a radian of its period needs 4. A larger error has no one phase to arrive at."""

_CONTRACT = "Lou et al. 2019, Section 2 (read heads on a displaced ring)"


class HeadEffect(StageEffect):
    """Base of the effects of one read head."""

    acts_on = (HEAD,)

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each head."""
        return tuple(f"{HEAD}_{letter}" for letter in sorted(machine.azimuths))


class DiscEccentricity(StageEffect):
    """The ring's centre stands elsewhere on the rotor than the twin says."""

    name = "disc_eccentricity"
    title = "ring mounted off centre"
    remedy = "Centre the ring, or calibrate it between centres (`calibrate assembly`) and state encoder.eccentricity."
    source = _CONTRACT
    parameters = (Parameter("shift", "m", 1e-5, 2, bound=1e-3),)
    acts_on = (HEAD,)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the shift to the eccentricity."""
        x, y = stage.ring.eccentricity
        shifted = (x + float(values[0]), y + float(values[1]))
        return replace(stage, encoder=replace(stage.ring, eccentricity=shifted))


class GraduationError(StageEffect):
    """The graduation has an error of one more order. Order 1 is what eccentricity does: it goes by that name."""

    name = "graduation_error"
    title = "graduation error of one order"
    remedy = "Calibrate the graduation (`calibrate assembly`) and state it among encoder.graduation."
    source = "Lou et al. 2019, Section 2.2; Geckeler et al. 2006 (Fourier description of division errors)"
    parameters = wave_of_order("rad", 3e-6, bound=1e-3)
    stands_out_in = (HEAD, COMMAND)
    acts_on = (HEAD,)
    orders = 100
    falling = True
    lowest = 2

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Add the order to the graduation."""
        row = AngularHarmonic(round(values[0]), float(values[1]), float(values[2]))
        return replace(stage, encoder=replace(stage.ring, graduation=(*stage.ring.graduation, row)))


class SubdivisionalError(HeadEffect):
    """One head interpolates within a line with offset or unequal gain of its sine and cosine signals."""

    name = "subdivisional_error"
    title = "sub-divisional error of a head"
    remedy = "Adjust offset, gain and phase of this head's signals (its gap and tilt), or clean the ring."
    source = "Heydemann 1981 (sine and cosine signals); one period per line"
    parameters = (Parameter("cos", "rad", 5e-7, bound=1e-4), Parameter("sin", "rad", 5e-7, bound=1e-4))

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add one wave per line.

        Its phase is that of the angle before the error. The observed reading tells it far better than the command,
        which the rotor follows only to part of a line; the error itself is taken off it.
        """
        amplitude, delay = math.hypot(values[0], values[1]), math.atan2(values[1], values[0]) + math.pi / 2
        if state.observed is None:
            return ideal - amplitude * np.sin(state.lines * ideal - delay)
        phase = _before_error(state.lines * state.observed - delay, state.lines * amplitude)
        return ideal - amplitude * np.sin(phase)


def _before_error(read: Array, size: float) -> Array:
    """Phase E of which `read` is E - size sin E: Kepler's equation, by Newton's method from Danby's first value.

    Args:
        read: (n,) phase that a head reads, rad.
        size: amplitude of its error, rad of a line.
    """
    phase: Array = read + 0.85 * min(size, 1.0) * np.sign(np.sin(read))
    for _ in range(_MOST_STEPS):
        step = (phase - size * np.sin(phase) - read) / np.maximum(1 - size * np.cos(phase), _FLATTEST)
        # The error is no larger than its size: a reading that turns back must not throw the phase far away.
        phase = np.clip(phase - step, read - size, read + size)
        if not np.max(np.abs(step), initial=0.0) > _PHASE_RESOLUTION:
            break
    return phase


class HeadMisplacement(HeadEffect):
    """A head stands at another azimuth than the twin says."""

    name = "head_misplacement"
    title = "head at another azimuth"
    remedy = "Measure where the head sits and state its azimuth; a head's azimuth counts in the sense of rotation."
    source = _CONTRACT
    parameters = (Parameter("azimuth", "rad", 1e-2, bound=math.pi),)
    rescales = True
    displaces_instrument = True

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Move that head."""
        letter = location.removeprefix(f"{HEAD}_")
        azimuths = {**stage.azimuths, letter: stage.azimuths[letter] + float(values[0])}
        return replace(stage, encoder=replace(stage.ring, azimuths=azimuths))


class HeadLatency(HeadEffect):
    """The values of one head are older than their stamps."""

    name = "head_latency"
    title = "one head late"
    remedy = "State the delay as this head's latency, or latch all heads by one signal."
    source = "sampling delay: angle error = speed x delay"
    parameters = (Parameter("delay", "s", 1e-4, bound=1.0),)

    def delay(self, values: Values, location: str) -> float:
        """The age itself."""
        return float(values[0])


class EncoderLatency(StageEffect):
    """The values of all heads are older than their stamps: the rotation itself is on time."""

    name = "encoder_latency"
    title = "all heads late"
    remedy = "State the delay as latency of the heads, or have their counter latch and stamp at one instant."
    source = "sampling delay: angle error = speed x delay"
    parameters = (Parameter("delay", "s", 1e-4, bound=1.0),)
    acts_on = (HEAD,)

    def delay(self, values: Values, location: str) -> float:
        """The age itself."""
        return float(values[0])


class HeadMissedCounts(HeadEffect):
    """A head loses counts at one moment and stays off by them: by one at least, as the stage states its size.

    Attributes:
        count: size of one count, rad; 0 where it is not known.
    """

    name = "head_missed_counts"
    title = "counts lost by a head"
    remedy = "Look at cable, shield and speed limit of this head, and clean the ring; reference it again."
    source = "incremental counting: a lost count stays lost"
    parameters = (Parameter("time", "s", 1.0, role=Role.FIXED, bound=1e9), Parameter("step", "rad", 2e-5, bound=1.0))
    searched = Searched.MOMENT
    count = 0.0

    def seen_in(self, stage: StageDescription, apart: float) -> Self:
        """The effect with the size of the stage's counts."""
        found = copy(self)
        found.count = min(stage.ring.resolution, self.parameters[1].bound)
        return found

    def bounds(self, near: Values | None = None) -> tuple[Values, Values]:
        """From one count on in the sense of a step that is near; no step is none."""
        low, high = super().bounds()
        if near is not None and near[1]:
            (low if near[1] > 0 else high)[1] = math.copysign(self.count, near[1])
        return low, high

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Add the step from its moment on."""
        return np.asarray(ideal + values[1] * (state.time >= values[0]), np.float64)


class DiscScale(StageEffect):
    """The ring's radius differs from the twin's: all that divides by it is scaled."""

    name = "disc_scale"
    title = "ring of another radius"
    remedy = "Check disc_radius in the stage file against the data sheet of the ring (radius, not diameter)."
    source = _CONTRACT
    parameters = (Parameter("relative", "1", 1e-2, bound=0.5),)
    rescales = True
    acts_on = (HEAD,)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """Scale the radius."""
        radius = stage.ring.disc_radius * (1 + float(values[0]))
        return replace(stage, encoder=replace(stage.ring, disc_radius=radius))
