"""A shaft between centres by the formulas of the contract, sample by sample, with departures from the textbook.

Nothing here is taken from the package: c is the displacement of the ring's centre, a head at azimuth phi reads
theta + (-c_x sin phi + c_y cos phi) / r + G(phi - theta), the autocollimator sees Rz(theta) tilt + flatness(theta).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

Array = NDArray[np.float64]
AZIMUTHS = {"a": 0.0, "b": np.pi, "c": np.pi / 2, "d": 3 * np.pi / 2}


@dataclass(frozen=True)
class Shaft:
    """Truth and instruments.

    Attributes:
        graduation: (cos, sin) by order, rad.
        flatness: (x cos, x sin, y cos, y sin) by order, rad.
        radial, lean: error motion of the shaft over rotation, time and direction, m and rad as x + i y; none between
            centres.
        head_colour, tilt_colour: correlation time of the instruments' noise, s; zero for white noise.
        delay: age of the autocollimator's values, s.
        standing: read only while the shaft stands still.
    """

    radius: float = 0.1
    azimuths: Mapping[str, float] = field(default_factory=lambda: AZIMUTHS)
    eccentricity: tuple[float, float] = (2.4e-5, -1.1e-5)
    graduation: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    tilt: tuple[float, float] = (7.0e-5, 2.4e-5)
    flatness: Mapping[int, tuple[float, float, float, float]] = field(default_factory=dict)
    radial: Callable[[Array, Array, Array], Array] | None = None
    lean: Callable[[Array, Array, Array], Array] | None = None
    head_noise: float = 3e-7
    head_step: float = 2 * np.pi / 3148800
    head_colour: float = 0.0
    tilt_noise: float = 5e-7
    tilt_step: float = 4.848e-7
    tilt_range: float = 4.848e-4
    tilt_colour: float = 0.0
    delay: float = 0.0
    head_rate: float = 250.0
    tilt_rate: float = 400.0
    jitter: float = 2e-6
    turns_off: Mapping[str, int] = field(default_factory=dict)
    standing: bool = False


Motion = tuple[Callable[[Array], Array], float]
RAMP = 0.2


def driven(speeds: list[float], lengths: list[float]) -> Motion:
    """Rotation over time at speeds (rad/s) for lengths (s), changed by ramps of `RAMP` s or less; its duration, s."""
    ends, ramp = np.cumsum(lengths), min(RAMP, 0.8 * min(lengths))
    times, values = [-1.0], [speeds[0]]
    for before, after, end in zip(speeds, speeds[1:], ends, strict=False):
        times += [end - ramp / 2, end + ramp / 2]
        values += [before, after]
    spline = make_interp_spline([*times, ends[-1] + 1.0], [*values, speeds[-1]], k=1).antiderivative()
    return lambda t: spline(t) - spline(0.0), float(ends[-1])


def reversing(speeds: tuple[float, ...], each: float) -> Motion:
    """Each speed for `each` s, then back again."""
    both = [*speeds, *(-speed for speed in speeds)]
    return driven(both, [each] * len(both))


def one_way(speed: float, duration: float, uneven: float = 0.0) -> Motion:
    """One direction; `uneven` is the relative amplitude of a slow wave of the speed."""
    return lambda t: speed * (t + uneven * np.sin(0.9 * t) / 0.9), duration


def stops(count: int, dwell: float, move: float, turns: int = 1) -> Motion:
    """`count` stops a turn, each for `dwell` s, with moves of `move` s between."""
    total = count * turns
    speeds = [0.0, 2 * np.pi / count / move] * total + [0.0]
    return driven(speeds, [dwell, move] * total + [dwell])


Streams = tuple[dict[str, tuple[NDArray[np.int64], Array]], tuple[NDArray[np.int64], Array]]


def record(shaft: Shaft, motion: Callable[[Array], Array], duration: float, seed: int) -> Streams:
    """Streams of the heads and of the autocollimator: times (n,) ns and values (n, 1) or (n, 2)."""
    rng = np.random.default_rng(seed)
    lines = [(rng.uniform(3, 120), rng.uniform(0, 2 * np.pi)) for _ in range(6)]

    def theta_at(t: Array) -> Array:
        return motion(t) + shaft.jitter * np.sqrt(1 / 3) * sum(np.sin(w * t + p) for w, p in lines)

    def moved(t: Array) -> tuple[Array, Array, Array]:
        return theta_at(t), t, np.sign(motion(t + 1e-3) - motion(t - 1e-3))

    heads = {}
    for number, (name, phi) in enumerate(shaft.azimuths.items()):
        t = sampled(shaft.head_rate, duration, 0.2 + 0.03 * number)
        theta, _, way = moved(t)
        centre = complex(*shaft.eccentricity) * np.exp(1j * theta)
        if shaft.radial is not None:
            centre = centre + shaft.radial(theta, t, way)
        reading = theta + (-centre.real * np.sin(phi) + centre.imag * np.cos(phi)) / shaft.radius
        for order, (cos, sin) in shaft.graduation.items():
            reading += cos * np.cos(order * (phi - theta)) + sin * np.sin(order * (phi - theta))
        reading += shaft.head_noise * coloured(rng, len(t), shaft.head_colour * shaft.head_rate)
        reading = rounded(reading + 2 * np.pi * shaft.turns_off.get(name, 0), shaft.head_step)
        keep = np.abs(motion(t + 1e-2) - motion(t - 1e-2)) < 1e-6 if shaft.standing else np.ones(len(t), bool)
        heads[name] = nanoseconds(t)[keep], reading[keep, None]
    t = sampled(shaft.tilt_rate, duration, 0.4)
    theta, _, way = moved(t - shaft.delay)
    seen = complex(*shaft.tilt) * np.exp(1j * theta)
    if shaft.lean is not None:
        seen = seen + shaft.lean(theta, t, way)
    for order, (x_cos, x_sin, y_cos, y_sin) in shaft.flatness.items():
        cos, sin = np.cos(order * theta), np.sin(order * theta)
        seen = seen + x_cos * cos + x_sin * sin + 1j * (y_cos * cos + y_sin * sin)
    columns = [
        part + shaft.tilt_noise * coloured(rng, len(t), shaft.tilt_colour * shaft.tilt_rate)
        for part in (seen.real, seen.imag)
    ]
    values = rounded(np.clip(np.stack(columns, 1), -shaft.tilt_range, shaft.tilt_range), shaft.tilt_step)
    keep = np.abs(motion(t + 1e-2) - motion(t - 1e-2)) < 1e-6 if shaft.standing else np.ones(len(t), bool)
    return heads, (nanoseconds(t)[keep], values[keep])


def sampled(rate: float, duration: float, offset: float) -> Array:
    return (np.arange(int(duration * rate)) + offset) / rate


def nanoseconds(t: Array) -> NDArray[np.int64]:
    return np.rint(t * 1e9).astype(np.int64) + 1_763_700_000_000_000_000


def rounded(values: Array, step: float) -> Array:
    return step * np.rint(values / step) if step else values


def coloured(rng: np.random.Generator, count: int, correlation: float) -> Array:
    """Noise of standard deviation 1 whose correlation falls to 1/e over `correlation` samples."""
    white = rng.normal(size=count)
    if correlation == 0:
        return white
    keep = np.exp(-1 / correlation)
    white[1:] *= np.sqrt(1 - keep**2)
    return lfilter([1.0], [1.0, -keep], white)
