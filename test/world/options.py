"""What a recording is made with: every habit of a real instrument can be switched, sized or left to the seed."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

MOTIONS = ("s_curves", "both_directions", "indexing", "oscillation", "steady", "standstill", "creep")
RAMPS = ("smooth", "linear", "jerky")
ROUNDINGS = ("round", "floor", "fix")


@dataclass(frozen=True)
class Options:
    """How a recording is made. `None` leaves a choice to the seed; a scale or size of 0 switches a habit off.

    Attributes:
        motion: one of `MOTIONS`.
        peak_speed: highest speed of the command in rad/s (not for `creep` and `standstill`).
        ramps: how the speed changes where it does but in an oscillation, one of `RAMPS`: with a continuous
            acceleration, one that jumps at both ends, or one that jumps some times in between as well.
        start_angle: angle of the command in rad at the begin.
        start_ns: timestamp (ns) at which the recording begins.
        jitter: factor of the rotor's jitter about the command, which has a standard deviation near 2e-6 rad.
        brake: whether a brake holds the rotor, where the jitter has it, while the command stands.
        following_error: by how much the rotor stands off its command at rest in rad.
        drive_lag: how long after its command the rotor turns in s.
        drive_give: by how much the rotor stays behind its command per acceleration of that, in s².
        drive_settling: time constant in s with which that follows the acceleration; 0 for at once.
        other_orders: part of the spindle's error motion that comes on top in orders of no description.
        asynchronous: standard deviation of the asynchronous radial motion in m, per axis.
        axial: standard deviation in m of the axial error motion of a spindle whose description has none.
        force, temperature, lvdt: whether the stream is there; without it no force acts and the temperature is the
            reference temperature.
        place_drift: (x, y) in m/K by which the axis moves as the place of a thermometer warms, by its name.
        noise: factor of all noise.
        noise_shape: noise coloured, heavy-tailed and of 0.7 to 1.3 times the stated size; else white and Gaussian.
        turbulence: whether the autocollimator has the turbulence that its description states.
        quantise: whether readings come in steps.
        rounding: one of `ROUNDINGS`, for heads, autocollimator and probes, of which each has its own if it is drawn;
            `fix` is towards zero.
        interpolation_error: amplitude of each head's error within a line, in counts.
        odd_rates: rates drawn and not round; else 500 Hz heads, 100 Hz autocollimator, 250 Hz command, 1000 Hz probes.
        rates: rate in Hz of single streams by topic; overrides the drawn one.
        sampling_drift: departure of the sample clocks from their rate, such as 2e-5; the stamps know it.
        clock_offset: standard deviation in s of each stream's constant error of stamps.
        clock_wander: error of stamps in s that comes and goes slowly with at most 10 ppm (a disciplined clock).
        clock_drift: standard deviation of each stream's relative drift of stamps that nobody corrects, such as 1e-5.
        stamp_jitter: standard deviation in s of the error of single stamps.
        uneven_blocks: whether blocks differ in length.
        block_period: mean time in s from one block to the next, 2 to 200 ms.
        early_stamps: whether a block may be stamped before its first sample.
        lost_blocks: probability that a block is lost.
    """

    motion: str | None = None
    peak_speed: float | None = None
    ramps: str = "smooth"
    start_angle: float | None = None
    start_ns: int | None = None
    jitter: float = 1.0
    brake: bool = False
    following_error: float = 0.0
    drive_lag: float = 0.0
    drive_give: float = 0.0
    drive_settling: float = 0.0
    other_orders: float = 0.05
    asynchronous: float = 3e-8
    axial: float = 2e-7
    force: bool | None = None
    temperature: bool | None = None
    lvdt: bool | None = None
    place_drift: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    noise: float = 1.0
    noise_shape: bool = True
    turbulence: bool = True
    quantise: bool = True
    rounding: str | None = None
    interpolation_error: float = 0.0
    odd_rates: bool = True
    rates: Mapping[str, float] = field(default_factory=dict)
    sampling_drift: float = 2e-5
    clock_offset: float = 1e-6
    clock_wander: float = 1e-6
    clock_drift: float = 0.0
    stamp_jitter: float = 1e-6
    uneven_blocks: bool = True
    block_period: float | None = None
    early_stamps: bool = True
    lost_blocks: float = 5e-4

    def __post_init__(self) -> None:
        if self.motion is not None and self.motion not in MOTIONS:
            raise ValueError(f"motion is {self.motion!r}, but it must be one of {', '.join(MOTIONS)}")
        if self.ramps not in RAMPS:
            raise ValueError(f"ramps is {self.ramps!r}, but it must be one of {', '.join(RAMPS)}")
        if self.rounding is not None and self.rounding not in ROUNDINGS:
            raise ValueError(f"rounding is {self.rounding!r}, but it must be one of {', '.join(ROUNDINGS)}")

    @classmethod
    def textbook(cls, **changes: Any) -> Options:
        """Options of a perfect instrument: no noise, no steps, exact clocks, nothing but what is described."""
        perfect: dict[str, Any] = {
            **dict.fromkeys(("jitter", "other_orders", "asynchronous", "axial", "noise"), 0.0),
            **dict.fromkeys(("sampling_drift", "clock_offset", "clock_wander", "stamp_jitter", "lost_blocks"), 0.0),
            **dict.fromkeys(("force", "temperature", "noise_shape", "turbulence", "quantise"), False),
            **dict.fromkeys(("odd_rates", "uneven_blocks", "early_stamps"), False),
        }
        return cls(**{**perfect, **changes})


@dataclass(frozen=True)
class Seeds:
    """Generators by name, so that one habit switched off leaves the draws of all others as they are."""

    seed: int

    def generator(self, name: str) -> np.random.Generator:
        """Generator of one habit."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])
