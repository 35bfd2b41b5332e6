"""The grinder of Zhou et al. 2023 with its mirrors and sensor, simulated: what the paper states is as stated.

Guideways, mirrors, readings and grinding are closed forms of their own, which share no formula with what calibrates,
splices, rotates and predicts. Lengths are in m, also of heights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.reproduction.units import MM, UM

Form = Callable[[Array], Array]


SENSOR = 0.06e-6
"""Accuracy ± of the displacement sensor, m (paper, Section 2.2)."""

SENSOR_NOISE = SENSOR / 3**0.5
"""Standard deviation of a reading, m, if the accuracy are the bounds of a rectangular distribution (GUM 4.3.7). As a
standard deviation 60 nm would show deviations of 0.2 µm among so many readings, where the paper saw 0.15 µm at most."""

SPEED, PERIOD = 600 * MM / 60, 0.1
"""Speed of a run, m/s, and sampling period, s (paper, Section 2.2)."""

RUNS = 5
"""Each way (paper, Section 2.2)."""

WORKPIECE = ((-1.4, 0.0), (-0.65, -0.15))
"""Of 1400 mm x 500 mm (paper, Section 3.2), over X and Z, m; where in Z the paper does not say."""

STEP = 10 * MM
"""Distance of the passes and of the points at which a surface is measured, m; the paper does not say."""

POSITIONING = 1.2e-6
"""Positioning error of Y, peak to valley, m (paper, Section 3.2)."""

REVERSAL = 3e-6
"""Reversal error of Y, m; the paper prints no number. From some 2 µm on it costs more here than the rotation of the
curves, by which Y moves further and shows more of its positioning error."""

SCALE_PERIOD = 20e-6
"""Wave of the positioning error over the few µm that Y moves, m: the signal period of a usual scale."""

PROCESS = 2.15e-6
"""What wear of the wheel and warming leave on the workpiece, peak to valley, m: chosen so that the workpiece has about
the paper's 2.98 µm after compensation."""

_BOWS = 1.352
"""Range of the bows of `process` about their plane."""

_FINE = 4001
"""Positions over which a form is scaled: a millimetre of the longest axis has three."""


def _of_size(shape: Form, size: float, ends: tuple[float, float], at: Array) -> Array:
    """(n,) a shape at places, about its line of least squares from end to end, with that range there."""
    fine = np.linspace(*ends, _FINE)
    values = shape(fine)
    slope, height = np.polyfit(fine, values, 1)
    scale = size / float(np.ptp(values - slope * fine - height))
    return np.asarray(scale * (shape(at) - slope * at - height))


@dataclass(frozen=True)
class Guideway:
    """Straightness of a feed axis in Y.

    Attributes:
        letter: of the axis.
        travel: low and high end, m.
        shape: of any size.
        straightness: range about the line of least squares, m.
    """

    letter: str
    travel: tuple[float, float]
    shape: Form
    straightness: float

    def true(self, positions: Array) -> Array:
        """(n,) deviations from the line of least squares, m."""
        return _of_size(self.shape, self.straightness, self.travel, positions)


@dataclass(frozen=True)
class FlatMirror:
    """A mirror.

    Attributes:
        number: that of the paper.
        length: m.
        flatness: peak to valley, m.
        shape: of any size, over -1 to 1.
    """

    number: int
    length: float
    flatness: float
    shape: Form

    def true(self, distance: Array) -> Array:
        """(n,) heights over the distance from the mirror's start, about their line, m."""
        return _of_size(self.shape, self.flatness, (-1.0, 1.0), 2 * distance / self.length - 1)


X = Guideway(
    "X",
    (-1.4, 0.0),
    lambda x: np.cos(2 * np.pi * x / 1.05 + 0.4) + 0.35 * np.sin(2 * np.pi * x / 0.42 + 1.0),
    5.5e-6,
)
"""X with the paper's 5.5 µm (Figure 12); of the shape the paper prints a picture only."""

Z = Guideway(
    "Z",
    (-0.8, 0.0),
    lambda z: (z / 0.4 + 1) ** 2 + 0.8 * (z / 0.4 + 1) ** 4 + 0.1 * np.sin(2 * np.pi * z / 0.31 + 0.3),
    5.8e-6,
)
"""Z with the paper's 5.8 µm (Figure 9), flat enough over the workpiece that this has 7.54 µm before compensation."""

MIRROR_1 = FlatMirror(1, 0.44, 0.08e-6, lambda u: 0.45 * u**2 + 0.7 * u**3 - 0.2 * np.cos(4 * u))
MIRROR_2 = FlatMirror(2, 0.84, 0.12e-6, lambda u: -0.35 * u**2 + 0.9 * u**3 + 0.25 * np.cos(5 * u))
"""The paper's mirrors (Figure 4, Section 2.2); of the first it prints a picture, of the second none."""


@dataclass(frozen=True)
class ZhouGrinder:
    """What is true, and what instruments write of it.

    Attributes:
        seed: of noise, drift, and how the mirrors are put down.
    """

    seed: int

    def write_machine(self, path: Path) -> None:
        """Write the machine file as its builder knows it before calibration: three axes and no error."""
        write_whole(path, MACHINE.encode())

    def write_mirror(self, path: Path, mirror: FlatMirror) -> None:
        """Write a mirror's form as a flatness interferometer measures it: each 2 mm, noise of 1 nm (both chosen)."""
        distance = np.arange(0.0, mirror.length + MM, 2 * MM)
        noise = 1e-9 * self._draw(f"interferometer {mirror.number}").normal(size=distance.size)
        height = (mirror.true(distance) + noise) / UM
        rows = (f"{d:g},{h:.4f}\n" for d, h in zip(distance / MM, height, strict=True))
        write_whole(path, ("distance_mm,height_um\n" + "".join(rows)).encode())

    def write_runs(self, path: Path, guideway: Guideway, mirror: FlatMirror, starts: Sequence[float]) -> None:
        """Write what sensor and scale read along a mirror put down at each of `starts`, m, within the travel."""
        draw = self._draw(path.stem)
        lines = ["segment,run,direction,position_mm,reading_um\n"]
        for segment, start in enumerate(starts, 1):
            # put down to some µm over its length, at some µm of the sensor's range
            slope, height = draw.normal(0.0, 10e-6), draw.normal(0.0, 5 * UM)
            for number in range(2 * RUNS):
                way = -1 if number % 2 else 1
                low, high = max(start, guideway.travel[0]), min(start + mirror.length, guideway.travel[1])
                at, along = _positions(low, high, way, float(draw.uniform(0.0, 0.99)))
                read = guideway.true(at) + mirror.true(at - start) + slope * (at - start) + height
                read += self._run_to_run(draw, along, way) + SENSOR_NOISE * draw.normal(size=at.size)
                lines += [
                    f"{segment},{number + 1},{way},{p:.4f},{r:.4f}\n" for p, r in zip(at / MM, read / UM, strict=True)
                ]
        write_whole(path, "".join(lines).encode())

    @staticmethod
    def _run_to_run(draw: np.random.Generator, along: Array, way: int) -> Array:
        """What a run adds: its height, a drift as of warming, and a difference of the directions; m, all chosen.

        They are small beside the sensor's accuracy: the paper saw the runs of a direction agree.
        """
        drift = 0.02 * UM * draw.normal() * np.sin(np.pi * along / 2)
        return np.asarray(0.1 * UM * draw.normal() + drift + way * 0.02 * UM * np.cos(2 * np.pi * along))

    def write_surface(self, path: Path, corrections: Array | None) -> None:
        """Write the surface of a workpiece as it is measured after grinding.

        Args:
            path: of the table.
            corrections: (n, m) what the program adds to Y over `grid`, m; None where Y stays.
        """
        x, z = self.grid
        heights = self.ground(corrections) + SENSOR_NOISE * self._draw(path.stem).normal(size=(x.size, z.size))
        # it lies before the interferometer or the sensor at some slope
        heights += 12e-6 * x[:, None] - 7e-6 * z[None, :]
        rows = (
            f"{p:g},{q:g},{heights[i, k] / UM:.4f}\n"
            for i, p in enumerate(np.round(x / MM, 6))
            for k, q in enumerate(np.round(z / MM, 6))
        )
        write_whole(path, ("X_mm,Z_mm,height_um\n" + "".join(rows)).encode())

    @cached_property
    def grid(self) -> tuple[Array, Array]:
        """Positions of X and Z over the workpiece, m."""
        x, z = (np.linspace(low, high, round((high - low) / STEP) + 1) for low, high in WORKPIECE)
        return x, z

    def ground(self, corrections: Array | None) -> Array:
        """(n, m) true heights of a ground workpiece over `grid`, m."""
        x, z = self.grid
        heights = X.true(x)[:, None] + Z.true(z)[None, :] + process(x, z)
        if corrections is not None:
            reached = np.stack([follow(each) for each in corrections.T], axis=1)
            heights = heights + reached + POSITIONING / 2 * np.sin(2 * np.pi * reached / SCALE_PERIOD)
        return np.asarray(heights)

    def _draw(self, name: str) -> np.random.Generator:
        return Noise(self.seed, name).generator()


def _positions(low: float, high: float, way: int, phase: float) -> tuple[Array, Array]:
    """Positions of the samples of a run, which begins anywhere within a sampling period, and the part of it gone."""
    step = SPEED * PERIOD
    gone = np.arange(phase * step, high - low, step)
    return (low + gone if way > 0 else high - gone), gone / (high - low)


def process(x: Array, z: Array) -> Array:
    """(n, m) what grinding itself leaves, m: wear from pass to pass, and warming over the length, bows both."""
    (low, high), (first, last) = WORKPIECE
    u, w = (2 * x - low - high) / (high - low), (2 * z - first - last) / (last - first)
    bows = 0.36 * np.cos(np.pi * u)[:, None] + 0.6 * (w**2)[None, :] + 0.24 * u[:, None] * w[None, :]
    return np.asarray(PROCESS / _BOWS * bows)


def follow(command: Array) -> Array:
    """(n,) where Y comes to along a pass, m: it lags by half its play, and stands while that is taken up.

    A pass begins with the play taken up in the way in which it goes on the whole.
    """
    half = REVERSAL / 2
    return np.fromiter(_lagging(command, half, bool(command[-1] >= command[0])), np.float64, len(command))


def _lagging(command: Array, half: float, rising: bool) -> Iterator[float]:
    here = float(command[0]) + (-half if rising else half)
    for each in map(float, command):
        if here < each - half:  # pushed up
            here = each - half
        elif here > each + half:
            here = each + half
        yield here


MACHINE = """\
# Surface grinder with hydrostatic guideways before calibration; travels of Zhou et al. 2023, Section 2.2. SI units.
machine:
  name: grinder
  tool: wheel
  workpiece: workpiece
  monitored: null
  reference_temperature: 20.0
  axes:
    X: {kind: linear, direction: [1, 0, 0], travel: [-1.4, 0.0]}
    Z: {kind: linear, direction: [0, 0, 1], travel: [-0.8, 0.0]}
    Y: {kind: linear, direction: [0, 1, 0], travel: [0.0, 0.55]}
  bodies:
    - {name: workpiece, parent: base}
    - {name: x_slide, parent: base, axis: X}
    - {name: z_slide, parent: x_slide, axis: Z}
    - {name: y_slide, parent: z_slide, axis: Y}
    - {name: wheel, parent: y_slide}
"""
