"""What acts on the stage from outside, as functions of time: forces that come and go, temperature that drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.noise import Noise

FORCE_CYCLE = 40.0
"""After how many seconds the forces of Lou et al. 2019 (Figure 15) come again."""


_LAG_STEP = 0.02
"""Step, s, at which a lagging temperature is computed: short against every part that lags."""


@dataclass(frozen=True)
class Push:
    """A force on the shaft that comes and goes.

    Attributes:
        start: when it begins to rise, s from the start of the cycle.
        duration: from the begin of the rise to the end of the fall, s.
        force: (x, y) in the base at full height, N.
        rise: how long rise and fall each take, s.
    """

    start: float
    duration: float
    force: tuple[float, float]
    rise: float = 0.1

    def __post_init__(self) -> None:
        if not (self.start >= 0 and self.rise > 0 and self.duration >= 2 * self.rise):
            raise InputError(f"{self}: start must not be negative, rise positive, duration at least twice the rise")


@dataclass(frozen=True)
class Forces:
    """Pushes one after another or at once, repeated every `cycle` seconds."""

    pushes: tuple[Push, ...] = ()
    cycle: float = FORCE_CYCLE

    def __post_init__(self) -> None:
        for push in self.pushes:
            if push.start + push.duration > self.cycle:
                raise InputError(f"{push} ends after the cycle of {self.cycle} s")

    def at(self, time: Array) -> Complex:
        """(n,) force at `time` (n,) s as `x + 1j * y`, N in the base."""
        force = np.zeros(len(time), dtype=np.complex128)
        within = np.mod(time, self.cycle)
        first, last = (within.min(), within.max()) if len(within) else (0.0, 0.0)
        for push in self.pushes:
            end = push.start + push.duration
            if push.start < last and end > first:
                u = np.clip(np.minimum(within - push.start, end - within) / push.rise, 0, 1)
                force += u * u * (3 - 2 * u) * complex(*push.force)
        return force


@dataclass(frozen=True)
class TemperatureCourse:
    """Temperature that settles: `start + rise * (1 - exp(-t / settling)) + swing * sin(2 pi t / period)`, °C and s."""

    start: float = 20.0
    rise: float = 2.5
    settling: float = 12.0
    swing: float = 0.0
    period: float = 3600.0

    def at(self, time: Array) -> Array:
        """(n,) temperature at `time` (n,) s, °C; before time 0 it is that of time 0."""
        passed = np.maximum(time, 0)
        return np.asarray(
            self.start
            - self.rise * np.expm1(-passed / self.settling)
            + self.swing * np.sin(2 * np.pi / self.period * passed),
            dtype=np.float64,
        )


def place_temperature(whole: TemperatureCourse, seed: int, place: str) -> TemperatureCourse:
    """Temperature of one place of a stage: it begins as the whole does, and warms in its own time by its own size."""
    draw = Noise(seed, f"temperature_{place}").generator()
    rise, settling = float(draw.uniform(1.0, 4.0)), float(np.exp(draw.uniform(np.log(3.0), np.log(120.0))))
    return TemperatureCourse(start=whole.start, rise=rise, settling=settling)


def lagged_warming(temperature: TemperatureCourse, reference: float, time: Array, lag: float) -> Array:
    """(n,) K above the reference at `time` (n,) s of a part that follows the temperature within `lag` s.

    The part begins at time 0 with the temperature of then. The equation of first order is solved on a fixed grid, so
    that a value does not depend on what else is asked for.
    """
    from scipy.signal import lfilter  # loads for a second or two, and most stages have no such part

    grid = np.arange(0.0, max(float(time.max()), 0.0) + 2 * _LAG_STEP, _LAG_STEP)
    outside = temperature.at(grid) - reference
    decay = np.exp(-_LAG_STEP / lag)
    follows, _ = lfilter([1 - decay], [1, -decay], outside, zi=[decay * outside[0]])
    return np.asarray(np.interp(time, grid, follows), dtype=np.float64)


def intermittent_forces(seed: int, cycle: float = FORCE_CYCLE) -> Forces:
    """Seeded pushes as by hand on the turning shaft (Lou et al. 2019, Figure 15): from any side, up to 180 N."""
    count = 5
    draw = Noise(seed, "forces").generator()
    starts = np.sort(draw.uniform(0.1, 0.85, count)) * cycle
    durations = draw.uniform(0.03, 0.13, count) * cycle
    angles, sizes = draw.uniform(0, 2 * np.pi, count), draw.uniform(0.1, 1.0, count) * 180.0
    rows = zip(starts, durations, sizes * np.cos(angles), sizes * np.sin(angles), strict=True)
    return Forces(tuple(Push(float(start), float(length), (float(x), float(y))) for start, length, x, y in rows), cycle)
