"""Commanded motions: angle and velocity as functions of time, exact derivatives of one another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from .noise import drawn_log
from .options import MOTIONS, Options, Seeds

Array = NDArray[np.float64]
CREEP = 1e-4  # rad/s


class Motion(Protocol):
    """A commanded motion."""

    def angle(self, times: Array) -> Array:
        """(n,) commanded angle in rad at `times` in s."""

    def velocity(self, times: Array) -> Array:
        """(n,) commanded velocity in rad/s at `times` in s."""

    def acceleration(self, times: Array) -> Array:
        """(n,) commanded acceleration in rad/s² at `times` in s."""


class Polynomial:
    """Motion of given durations and velocities: in each piece the velocity goes from one to the next.

    Each piece is (duration, velocity at its end). A change of velocity has a continuous acceleration: the velocity
    follows 3u² - 2u³; `linear` ones have a constant acceleration, which jumps at both ends. Beyond both ends the motion
    goes on at constant velocity.
    """

    def __init__(
        self, start: float, velocity: float, pieces: Sequence[tuple[float, float]], *, linear: bool = False
    ) -> None:
        self._begin, self._pieces = (start, velocity), pieces
        hold = 1e3
        rows = [(0.0, 0.0, 0.0, velocity, start - hold * velocity)]
        knots = [-hold, 0.0]
        for duration, final in [*pieces, (hold, pieces[-1][1] if pieces else velocity)]:
            change = final - velocity
            bends = (0.0, 0.0, 0.5 * change / duration)
            if not linear:
                bends = (-change / (2.0 * duration**3), change / duration**2, 0.0)
            rows.append((*bends, velocity, start))
            knots.append(knots[-1] + duration)
            start += duration * 0.5 * (velocity + final)
            velocity = final
        self._angle = PPoly(np.array(rows).T, np.array(knots))
        self._velocity = self._angle.derivative()
        self._acceleration = self._velocity.derivative()

    def ramped(self, ramps: str, rng: np.random.Generator) -> Polynomial:
        """The same with `ramps` of `options.RAMPS`."""
        if ramps == "smooth":
            return self
        start, last = self._begin
        pieces: list[tuple[float, float]] = []
        for duration, final in self._pieces:
            count = int(rng.integers(3, 9)) if ramps == "jerky" and final != last else 1
            parts, shares = (each / each.sum() for each in rng.uniform(0.2, 1.0, (2, count)))
            speeds = last + (final - last) * np.cumsum(shares)
            pieces += zip((duration * parts).tolist(), [*speeds[:-1].tolist(), final], strict=True)
            last = final
        return Polynomial(start, self._begin[1], pieces, linear=True)

    def angle(self, times: Array) -> Array:
        """(n,) commanded angle in rad at `times` in s."""
        return np.asarray(self._angle(times), float)

    def velocity(self, times: Array) -> Array:
        """(n,) commanded velocity in rad/s at `times` in s."""
        return np.asarray(self._velocity(times), float)

    def acceleration(self, times: Array) -> Array:
        """(n,) commanded acceleration in rad/s² at `times` in s."""
        return np.asarray(self._acceleration(times), float)


@dataclass(frozen=True)
class Oscillation:
    """Sinusoidal motion about a centre."""

    centre: float
    amplitude: float
    frequency: float
    phase: float

    def angle(self, times: Array) -> Array:
        """(n,) commanded angle in rad at `times` in s."""
        return self.centre + self.amplitude * np.sin(2.0 * np.pi * self.frequency * times + self.phase)

    def velocity(self, times: Array) -> Array:
        """(n,) commanded velocity in rad/s at `times` in s."""
        pulsation = 2.0 * np.pi * self.frequency
        return self.amplitude * pulsation * np.cos(pulsation * times + self.phase)

    def acceleration(self, times: Array) -> Array:
        """(n,) commanded acceleration in rad/s² at `times` in s."""
        pulsation = 2.0 * np.pi * self.frequency
        return -self.amplitude * pulsation**2 * np.sin(pulsation * times + self.phase)


def make_motion(seeds: Seeds, duration: float, options: Options) -> tuple[str, Motion]:
    """Name and motion, drawn where the options leave it open."""
    rng = seeds.generator("motion")
    name = str(rng.choice(MOTIONS, p=(0.22, 0.22, 0.14, 0.14, 0.16, 0.06, 0.06)))
    name = options.motion or name
    start = float(rng.choice((0.0, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-300.0, 300.0)), p=(0.2, 0.6, 0.2)))
    start = start if options.start_angle is None else options.start_angle
    speed = drawn_log(rng, 0.1, 1.5)
    speed = speed if options.peak_speed is None else options.peak_speed
    motion = _MAKERS[name](rng, start, speed, duration)
    if isinstance(motion, Polynomial):
        motion = motion.ramped(options.ramps, seeds.generator("ramps"))
    return name, motion


def _s_curves(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Some long moves in one direction, at different speeds, at rest before and after."""
    sign = float(rng.choice((-1.0, 1.0)))
    speeds = sign * speed * np.append(rng.uniform(0.4, 1.0, int(rng.integers(0, 3))), 1.0)
    return _moves(rng, start, list(speeds), duration, rest=False)


def _both_directions(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Long moves forth and back."""
    sign = float(rng.choice((-1.0, 1.0)))
    speeds = [sign * speed * (-1.0) ** i for i in range(int(rng.integers(2, 6)))]
    return _moves(rng, start, speeds, duration, rest=bool(rng.integers(0, 2)))


def _indexing(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Short moves with a rest after each."""
    sign = float(rng.choice((-1.0, 1.0)))
    count = max(2, int(duration / rng.uniform(2.5, 6.0)))
    return _moves(rng, start, [sign * speed] * count, duration, rest=True)


def _moves(rng: np.random.Generator, start: float, speeds: list[float], duration: float, rest: bool) -> Motion:
    """Moves that fill the duration, with accelerations of 1 to 20 rad/s²."""
    share = duration / len(speeds)
    pieces = [(0.02 * duration + 1e-3, 0.0)]
    last = 0.0
    for speed in speeds:
        ramp = min(max(abs(speed - last) * 1.5 / drawn_log(rng, 1.0, 20.0), 0.03), 0.2 * share)
        pause = share * rng.uniform(0.1, 0.3) if rest else 0.0
        pieces += [(ramp, speed), (share * 0.96 - pause - (2.0 if rest else 1.0) * ramp, speed)]
        last = speed
        if rest:
            pieces += [(ramp, 0.0), (pause, 0.0)]
            last = 0.0
    if not rest:
        pieces.append((min(0.01 * duration, 0.5), 0.0))
    return Polynomial(start, 0.0, pieces)


def _oscillation(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Sinusoidal oscillation of at least one period."""
    frequency = drawn_log(rng, max(0.03, 1.0 / duration), 2.0)
    amplitude = speed / (2.0 * np.pi * frequency)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    return Oscillation(start - amplitude * np.sin(phase), amplitude, frequency, phase)


def _steady(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Constant speed from before the begin on, for as many turns as there are."""
    return Polynomial(start, speed * float(rng.choice((-1.0, 1.0))), [])


def _standstill(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """No motion at all."""
    return Polynomial(start, 0.0, [])


def _creep(rng: np.random.Generator, start: float, speed: float, duration: float) -> Motion:
    """Very slow motion."""
    return Polynomial(start, CREEP * float(rng.choice((-1.0, 1.0))), [])


_MAKERS: dict[str, Callable[[np.random.Generator, float, float, float], Motion]] = {
    "s_curves": _s_curves,
    "both_directions": _both_directions,
    "indexing": _indexing,
    "oscillation": _oscillation,
    "steady": _steady,
    "standstill": _standstill,
    "creep": _creep,
}
