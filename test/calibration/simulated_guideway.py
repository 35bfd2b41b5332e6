"""Guideways and mirrors of known form, measured as Zhou et al. 2023 did, by plain numpy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from rotary_error_monitor.calibration.measurements import Placement
from rotary_error_monitor.calibration.straightness_doubts import find_doubts
from rotary_error_monitor.calibration.straightness_report import repeatability_bounds
from rotary_error_monitor.calibration.straightness_runs import Placed, ReadingSettings, place_runs
from rotary_error_monitor.metrology.profile_comparison import compare_profiles
from rotary_error_monitor.metrology.reference_mirror import ReferenceMirror
from rotary_error_monitor.metrology.repeated_runs import Run
from rotary_error_monitor.metrology.splicing import SplicedProfile, splice_segments

Array = NDArray[np.float64]


def level(x: Array, y: Array) -> Array:
    """Values less their line of least squares."""
    return np.asarray(y - np.polyval(np.polyfit(x, y, 1), x))


@dataclass
class Plant:
    """A guideway of a few long waves, 5.8 µm about its line, and mirrors whose forms are drawn.

    A mirror of stated flatness f has polynomials of orders 2 to 6 (each orthogonal to those below it), which on average
    have f from peak to valley: of so many equal ones the range is 3.8 times the standard deviation of one.
    """

    rng: np.random.Generator
    length: float = 0.8
    noise: float = 60e-9
    step: float = 4e-3
    waves: list[tuple[float, float, int]] = field(init=False)
    size: float = field(init=False, default=1.0)

    def __post_init__(self) -> None:
        self.waves = [(self.rng.normal() / k, self.rng.uniform(0, 2 * np.pi), k) for k in range(1, 7)]
        x = np.linspace(0, self.length, 4001)
        self.size = 5.8e-6 / float(np.ptp(level(x, self.truth(x))))

    def truth(self, x: Array) -> Array:
        """Height of the guideway, m."""
        shape = sum(a * np.cos(np.pi * k * x / self.length + phase) for a, phase, k in self.waves)
        return np.asarray(self.size * shape)

    def mirror(self, flatness: float, curvature: float) -> Array:
        """Coefficients of a mirror's form, orders 2 to 6, m; `curvature` is that of order 2, drawn beforehand."""
        return np.asarray(flatness / 3.8 * np.array([curvature, *self.rng.normal(size=4)]))

    def placement(self, start: float, length: float, form: Array, *, runs: int = 10, turned: bool = False) -> Placement:
        """Runs there and back along a mirror put down at any height and slope, each run at a height of its own."""
        slope = 20e-6 * self.rng.normal()
        taken = []
        for number in range(runs):
            way = -1 if number % 2 else 1
            x = np.linspace(start, start + length, round(length / self.step) + 1)[::way]
            y = self.truth(x) + slope * x + (-1 if turned else 1) * shape(form, x - start, length)
            y = y + 5e-6 * self.rng.normal() + self.noise * self.rng.normal(size=x.size)
            taken.append(Run(x, y, way))
        return Placement(tuple(taken), turned)


def shape(form: Array, distance: Array, length: float) -> Array:
    """Form of a mirror at distances from its start, m: polynomials of Rodrigues' formula, written out."""
    u = 2 * distance / length - 1
    rows = [
        (3 * u**2 - 1) / 2,
        (5 * u**3 - 3 * u) / 2,
        (35 * u**4 - 30 * u**2 + 3) / 8,
        (63 * u**5 - 70 * u**3 + 15 * u) / 8,
        (231 * u**6 - 315 * u**4 + 105 * u**2 - 5) / 16,
    ]
    return np.asarray(sum(a * row for a, row in zip(form, rows, strict=True)))


WAYS = ("spliced", "spliced, one placement both ways up", "along one mirror", "interferometer")
"""How a guideway is measured: mirrors of 440 mm and 0.08 µm, and of 840 mm and 0.12 µm, overlaps as the paper's."""

READING = ReadingSettings(60e-9)


def stratified(count: int, stream: int) -> Array:
    """(n,) normal values in random order, one from each of n equally probable intervals.

    A mirror's curvature is most of what is uncertain of a spliced curve: drawn so, the rate of n calibrations tells of
    the bounds, not of how curved the n mirrors happen to be.
    """
    rng = np.random.default_rng([count, stream])
    return np.asarray(norm.ppf((rng.permutation(count) + rng.uniform(size=count)) / count))


def measure(placements: list[Placement], mirror: ReferenceMirror | None) -> tuple[list[Placed], SplicedProfile]:
    """What the package makes of placements."""
    parts = [place_runs(placement, READING) for placement in placements]
    return parts, splice_segments([part.segment for part in parts], mirror)


def rates(way: str, count: int) -> dict[str, float]:
    """How often the 95 % bound of each result holds the truth in so many calibrations."""
    curvatures = zip(stratified(count, 0), stratified(count, 1), strict=True)
    found = [_held(way, [count, seed], *curved) for seed, curved in enumerate(curvatures)]
    return {name: round(float(np.mean([each[name] for each in found])), 3) for name in found[0]}


def _held(way: str, seed: list[int], first: float, second: float) -> dict[str, float]:
    """Whether the 95 % bound of each result holds the truth in a calibration; of curves, at which part of them."""
    plant = Plant(np.random.default_rng([*seed, WAYS.index(way)]))
    short, long = plant.mirror(0.08e-6, first), plant.mirror(0.12e-6, second)
    if way.startswith("spliced"):
        placements = [plant.placement(0.0, 0.44, short), plant.placement(0.36, 0.44, short)]
        mirror: ReferenceMirror | None = ReferenceMirror(0.44, 0.08e-6)
        if way != "spliced":
            placements.append(plant.placement(0.0, 0.44, short, turned=True))
            mirror = ReferenceMirror(0.44, None)
    else:
        one = way == "along one mirror"
        placements = [plant.placement(0.0, plant.length, long if one else np.zeros(5))]
        mirror = ReferenceMirror(plant.length, 0.12e-6) if one else None
    parts, spliced = measure(placements, mirror)
    straightness = spliced.straightness()
    low, high = find_doubts(parts, spliced, straightness, plant.noise).error_bounds
    fine = np.linspace(0.0, plant.length, 4001)
    line = level(fine, plant.truth(fine))
    error = straightness.deviations - np.interp(spliced.positions, fine, line)
    spread = np.sqrt(np.diag(spliced.deviation_covariance()))
    result = {
        "points of the curve": float(np.mean(np.abs(error) < 1.96 * spread)),
        "straightness": float(low < np.ptp(line) < high),
        "repeatability": float(np.mean([first < plant.noise < last for first, last in _repeatabilities(parts)])),
    }
    if spliced.mirror is not None:
        form = spliced.mirror
        true_form = shape(short, form.distances, 0.44)
        off = np.abs(form.heights - level(form.distances, true_form))
        result["form of the mirror"] = float(np.mean(off < 1.96 * np.sqrt(np.diag(form.covariance))))
        direct = measure([plant.placement(0.0, plant.length, long)], ReferenceMirror(plant.length, 0.12e-6))[1]
        found = compare_profiles(spliced, direct)
        result["largest difference from a direct measurement"] = float(found.largest < found.bound)
    return result


def _repeatabilities(parts: list[Placed]) -> list[tuple[float, float]]:
    return [bounds for bounds in map(repeatability_bounds, parts) if bounds is not None]
