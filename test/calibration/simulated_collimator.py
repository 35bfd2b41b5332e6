"""Steps of a reference before an autocollimator, simulated from closed forms that the package does not have.

Each axis of the detector has a direction, a sensitivity and a bend of its own; truth as the package states it follows
by a polar decomposition of scipy. Or a Gaussian spot moves over four quadrants, whose light is that of error functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import polar
from scipy.special import erf

Array = NDArray[np.float64]
ARCSEC = math.pi / 648000
LEVELS = np.arange(-100.0, 101.0, 20.0)


def cross(levels: Array = LEVELS, *, both_ways: bool = True) -> Array:
    """(k, 2) settings, arcsec: along x up and back down, then along y."""
    way = np.concatenate([levels, levels[::-1]]) if both_ways else levels
    zero = np.zeros_like(way)
    return np.concatenate([np.stack([way, zero], axis=1), np.stack([zero, way], axis=1)])


@dataclass(frozen=True)
class Detector:
    """An instrument that reads `zero + s p (1 + bend (s p)^2)` of the tilt p along the direction of either axis.

    Attributes:
        zero: of either axis, rad.
        sensitivity: s.
        direction: of either axis from that of the reference, rad; the roll is about their mean.
        bend: 1/rad^2.
        end: reading at which it stops, rad.
    """

    zero: tuple[float, float] = (0.0, 0.0)
    sensitivity: tuple[float, float] = (1.0, 1.0)
    direction: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float] = (0.0, 0.0)
    end: float = math.inf

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Detector:
        """One of a make: gains within percents, mounted turned, bent by some percent at 100 arcsec."""
        roll = rng.uniform(-0.5, 0.5)
        gain = rng.uniform(0.9, 1.1)
        return cls(
            tuple(rng.normal(0, 10 * ARCSEC, 2)),
            tuple(gain * (1 + rng.normal(0, 0.01, 2))),
            tuple(roll + rng.normal(0, 0.005, 2)),
            tuple(rng.normal(0, 0.02, 2) / (100 * ARCSEC) ** 2),
        )

    @property
    def linear(self) -> Array:
        """(2, 2) reading per tilt at the zero."""
        (x, y), (s, t) = self.direction, self.sensitivity
        return np.array([[s * math.cos(x), -s * math.sin(x)], [t * math.sin(y), t * math.cos(y)]])

    @property
    def truth(self) -> dict[str, float]:
        """Numbers of the package by their names."""
        turn, stretch = polar(self.linear, side="left")
        gain = float(np.trace(stretch)) / 2
        found = {f"zero[{k}]": self.zero[k] for k in range(2)}
        found |= {"gain": gain, "roll": math.atan2(turn[1, 0], turn[0, 0])}
        found |= {"gain_difference": (stretch[0, 0] - stretch[1, 1]) / gain, "cross_coupling": stretch[0, 1] / gain}
        return found | {f"cubic[{k}]": self.bend[k] * gain**2 for k in range(2)}

    def read(self, tilt: Array) -> Array:
        """(n, 2) of tilts (n, 2), rad."""
        along = tilt @ self.linear.T
        read = np.array(self.zero) + along * (1 + np.array(self.bend) * along**2)
        return np.clip(read, -self.end, self.end)


@dataclass(frozen=True)
class Run:
    """How steps are taken.

    Attributes:
        settings: (k, 2) of the reference, arcsec.
        repeats: readings a step.
        noise: standard deviation of a reading, rad.
        resolution: step of a reading, rad.
        reference: standard deviation of what the reference is off by at a setting, rad.
        lost: lost motion of the reference along x, rad.
        drift: of the zero, rad/s.
        period: from one reading to the next, s.
        moved: what is shown beside the reference at some steps, rad, by their number.
    """

    settings: Array = field(default_factory=cross)
    repeats: int = 5
    noise: float = 0.1 * ARCSEC
    resolution: float = 0.0
    reference: float = 0.115 * ARCSEC
    lost: float = 0.0
    drift: tuple[float, float] = (0.0, 0.0)
    period: float = 0.5
    moved: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Taken:
    """What was taken: (n,) step and time of each reading, (n, 2) setting (arcsec) and reading (rad)."""

    step: NDArray[np.int64]
    time: Array
    setting: Array
    readings: Array


def shown_by(run: Run, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64], Array]:
    """(k, 2) true tilts at the steps, rad; (n,) step and time of each reading."""
    settings = run.settings
    places: dict[tuple[float, float], Array] = {}
    tilt = []
    last = settings[0]
    way = 0.0
    for number, setting in enumerate(settings):
        off = places.setdefault((float(setting[0]), float(setting[1])), rng.normal(0, run.reference, 2))
        way = float(np.sign(setting[0] - last[0])) or way
        last = setting
        shift = np.array([way * run.lost / 2 + run.moved.get(number, 0.0), 0.0])
        tilt.append(setting * ARCSEC + off + shift)
    step = np.repeat(np.arange(len(settings)), run.repeats)
    return np.array(tilt), step, run.period * np.arange(len(step))


def take(detector: Detector, run: Run, rng: np.random.Generator) -> Taken:
    """Readings of a detector."""
    tilt, step, time = shown_by(run, rng)
    middle = time - time.mean()
    read = detector.read(tilt[step]) + np.array(run.drift) * middle[:, None]
    read = read + rng.normal(0, run.noise, read.shape)
    if run.resolution:
        read = np.round(read / run.resolution) * run.resolution
    return Taken(step, time, run.settings[step], np.clip(read, -detector.end, detector.end))


def quadrant_voltages(
    run: Run, rng: np.random.Generator, *, radius: float = 500 * ARCSEC, oval: float = 1.0, dark: float = 0.0
) -> tuple[Taken, Array]:
    """Voltages (n, 4) of the quadrants under a Gaussian spot of radius (1/e^2, as a tilt), longer along y by `oval`.

    The noise of the run is that of a tilt; light and with it all voltages go up and down by 10 %.
    """
    tilt, step, time = shown_by(run, rng)
    seen = tilt[step] + rng.normal(0, run.noise, (len(step), 2))
    right = erf(math.sqrt(2) * seen[:, 1] / radius)
    up = erf(-math.sqrt(2) * seen[:, 0] / (radius * oval))
    light = 2.0 + 0.2 * np.sin(time)
    voltages = (
        light[:, None]
        / 4
        * np.stack(
            [(1 + right) * (1 + up), (1 - right) * (1 + up), (1 - right) * (1 - up), (1 + right) * (1 - up)], axis=1
        )
    )
    return Taken(step, time, run.settings[step], seen), voltages + dark


def table(taken: Taken, *, unit: str = "arcsec", timed: bool = True, voltages: Array | None = None) -> str:
    """The file of what was taken."""
    scale = {"arcsec": ARCSEC, "urad": 1e-6}[unit]
    columns = ["step", f"reference_x_{unit}", f"reference_y_{unit}"] + (["time_s"] if timed else [])
    columns += [f"tilt_x_{unit}", f"tilt_y_{unit}"] if voltages is None else ["q1_V", "q2_V", "q3_V", "q4_V"]
    lines = [",".join(columns)]
    for row, step in enumerate(taken.step):
        values = [f"{value * ARCSEC / scale:.10g}" for value in taken.setting[row]]
        values += [f"{taken.time[row]:g}"] if timed else []
        own = (
            [f"{v / scale:.4f}" for v in taken.readings[row]]
            if voltages is None
            else [f"{v:.6f}" for v in voltages[row]]
        )
        lines.append(",".join([f"s{step + 1}", *values, *own]))
    return "\n".join(lines) + "\n"


def write_table(path: Path, text: str) -> Path:
    """The file at that path."""
    path.write_text(text, encoding="utf-8")
    return path
