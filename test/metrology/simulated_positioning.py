"""Positioning tests of axes whose means and scatter are known at each target, and how often their bounds hold.

What infinitely many runs would give is written out from ISO 230-2 target by target and shares nothing with the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student_t

from rotary_error_monitor.metrology.positioning import PositioningRuns
from rotary_error_monitor.metrology.positioning_bounds import PositioningBounds, bound_positioning

Array = NDArray[np.float64]
Noise = Callable[[np.random.Generator, tuple[int, int]], Array]


@dataclass(frozen=True)
class Axis:
    """What is true of an axis.

    Attributes:
        targets: (m,) m or rad.
        there, back: (m,) means of infinitely many runs, m or rad.
        scatter: (2, m) standard deviation of a reading there and back, m or rad.
        runs: how often it is measured.
        rotary: whether it turns.
        instrument: standard deviation of the instrument's error over the travel, m.
        noise: what draws the scatter of a shape, of standard deviation 1.
        drift: standard deviation of what a cycle has in common at all targets both ways, m or rad.
        apart: standard deviation of what a run there has in common, and one back, each by itself, m or rad.
        growth: standard deviation of what a cycle adds at either end of the travel, against the middle, m or rad.
    """

    targets: Array
    there: Array
    back: Array
    scatter: Array
    runs: int = 5
    rotary: bool = False
    instrument: float = 0.0
    noise: Noise = field(default=np.random.Generator.standard_normal)
    drift: float = 0.0
    apart: float = 0.0
    growth: float = 0.0

    def truth(self) -> dict[str, float]:
        """The figures of infinitely many runs."""
        n = len(self.targets)
        s, t = np.sqrt(np.square(self.scatter) + self.drift**2 + self.apart**2 + np.square(self.growth * self.middle()))
        rows = [(self.there[k], self.back[k], s[k], t[k]) for k in range(n)]
        tops = [max(f + 2 * a, b + 2 * c) for f, b, a, c in rows]
        feet = [min(f - 2 * a, b - 2 * c) for f, b, a, c in rows]
        return {
            "forward.repeatability": max(4 * a for _, _, a, _ in rows),
            "backward.repeatability": max(4 * c for _, _, _, c in rows),
            "forward.systematic_deviation": max(self.there) - min(self.there),
            "forward.accuracy": max(f + 2 * a for f, _, a, _ in rows) - min(f - 2 * a for f, _, a, _ in rows),
            "bidirectional.reversal_error": max(abs(f - b) for f, b, _, _ in rows),
            "bidirectional.mean_reversal_error": sum(f - b for f, b, _, _ in rows) / n,
            "bidirectional.repeatability": max(max(2 * a + 2 * c + abs(f - b), 4 * a, 4 * c) for f, b, a, c in rows),
            "bidirectional.mean_deviation_range": max(f + b for f, b, _, _ in rows) / 2
            - min(f + b for f, b, _, _ in rows) / 2,
            "bidirectional.systematic_deviation": max(max(f, b) for f, b, _, _ in rows)
            - min(min(f, b) for f, b, _, _ in rows),
            "bidirectional.accuracy": max(tops) - min(feet),
        }

    def middle(self) -> Array:
        """(m,) places along the travel, from -1 to 1."""
        return np.asarray(2 * (self.targets - self.targets[0]) / np.ptp(self.targets) - 1)

    def measured(self, rng: np.random.Generator) -> PositioningRuns:
        """Runs there and back, by an instrument whose error grows along the travel and is alike in all runs."""
        along = (self.targets - self.targets[0]) / np.ptp(self.targets)
        offset = self.instrument * rng.normal() * along
        shape = len(along), self.runs
        common = self.drift * rng.normal(size=self.runs) if self.drift else 0.0
        if self.growth:
            common = common + self.growth * rng.normal(size=self.runs) * self.middle()[:, None]
        ways = self.apart * rng.normal(size=(2, self.runs)) if self.apart else (0.0, 0.0)
        readings = [
            (mean + offset)[:, None] + common + own + scatter[:, None] * self.noise(rng, shape)
            for mean, scatter, own in zip((self.there, self.back), self.scatter, ways, strict=True)
        ]
        return PositioningRuns(self.targets, readings[0], readings[1], self.rotary)


def linear(
    rng: np.random.Generator,
    *,
    span: float = 6.0,
    reversal: float = 0.3,
    varies: float = 0.0,
    wear: float = 0.0,
    drawn: float = 0.0,
    runs: int = 5,
    instrument: float = 0.0,
) -> Axis:
    """An axis of 1 m, its scatter 1 µm: pitch and a wave, a reversal error that grows along it, and scatter that does.

    `wear` is by how much the scatter grows to the end, `drawn` the standard deviation of its logarithm at a target.
    """
    u = np.linspace(0, 1, 11)
    u[1:-1] += 0.02 * rng.uniform(-1, 1, 9)
    mean = span * (u + 0.5 * np.sin(2 * np.pi * u))
    play = reversal + varies * u
    scatter = (1 + wear * u) * np.exp(drawn * rng.normal(size=(2, 11)))
    return Axis(u, 1e-6 * (mean + play / 2), 1e-6 * (mean - play / 2), 1e-6 * scatter, runs, False, 1e-6 * instrument)


def rotary(rng: np.random.Generator, *, runs: int = 5, play: float = 0.8) -> Axis:
    """A rotary axis all round, scatter 1 µrad: eccentricity and ellipticity of its scale, play that changes with it."""
    angles = np.deg2rad(np.arange(12) * 30.0)
    first, second = rng.uniform(0, 2 * np.pi, 2)
    mean = 4 * np.cos(angles + first) + 1.5 * np.cos(2 * angles + second)
    gap = 1 + play * np.cos(angles)
    return Axis(angles, 1e-6 * (mean + gap / 2), 1e-6 * (mean - gap / 2), 1e-6 * np.ones((2, 12)), runs, True)


def uniform(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Scatter as of play that is passed through evenly."""
    return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)


def heavy_tailed(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Student's t of 6 degrees of freedom: kurtosis 6, twice that of normal scatter."""
    return np.asarray(rng.standard_t(6, shape) / np.sqrt(6 / 4))


def screw(rng: np.random.Generator, *, targets: int = 11, high: float = 4.0) -> Axis:
    """A ball screw: an error that repeats along the travel, sampled at any phase, and one target that lies high."""
    u = np.linspace(0, 1, targets)
    mean = 3 * np.sin(2 * np.pi * (3.3 * u + rng.uniform()))
    mean[rng.integers(1, targets - 1)] += high
    play = 1.5 + 0.5 * u
    scatter = np.ones((2, targets))
    return Axis(u, 1e-6 * (mean + play / 2), 1e-6 * (mean - play / 2), 1e-6 * scatter)


def long_travel(rng: np.random.Generator, *, targets: int = 40, drawn: float = 0.2) -> Axis:
    """Many targets: pitch, errors of ground rails as a random walk, scatter that differs a little."""
    u = np.linspace(0, 1, targets)
    mean = 8 * u + 0.7 * np.cumsum(rng.normal(size=targets))
    play = 1 + 0.5 * np.sin(2 * np.pi * u)
    scatter = np.exp(drawn * rng.normal(size=(2, targets)))
    return Axis(u, 1e-6 * (mean + play / 2), 1e-6 * (mean - play / 2), 1e-6 * scatter)


def short_travel(rng: np.random.Generator) -> Axis:
    """Five targets, the fewest of ISO 230-2; errors and play about as large as the scatter, which is larger back."""
    u = np.linspace(0, 1, 5)
    mean, play = 2 * rng.normal(size=5), 1.5 + 0.7 * rng.normal(size=5)
    scatter = np.stack([np.ones(5), 1.6 * np.ones(5)])
    return Axis(u, 1e-6 * (mean + play / 2), 1e-6 * (mean - play / 2), 1e-6 * scatter)


def twins(rng: np.random.Generator) -> Axis:
    """Two targets at each end of the errors that come within the scatter, others far: extremes of two or three."""
    u = np.linspace(0, 1, 11)
    mean = np.array([0, 0.4, 0.8, 5, 6, 7, 8, 9, 13, 13.3, 13.6]) + 0.1 * rng.normal(size=11)
    play = np.array([0.5, 0.5, 0.5, 1, 1, 1, 1, 3, 3.2, 3.4, 1])
    return Axis(u, 1e-6 * (mean + play / 2), 1e-6 * (mean - play / 2), 1e-6 * np.ones((2, 11)))


AXES: dict[str, Callable[[np.random.Generator], Axis]] = {
    "small reversal": linear,
    "large reversal": lambda rng: linear(rng, reversal=8.0),
    "reversal that varies": lambda rng: linear(rng, reversal=3.0, varies=2.0),
    "hardly any error": lambda rng: linear(rng, span=0.9),
    "scatter grows along the travel": lambda rng: linear(rng, wear=1.5),
    "scatter unequal": lambda rng: linear(rng, drawn=0.4),
    "ten runs": lambda rng: linear(rng, runs=10),
    "ten runs, scatter grows, reversal varies": lambda rng: linear(rng, runs=10, wear=1.5, reversal=3.0, varies=2.0),
    "instrument": lambda rng: linear(rng, instrument=1.0, span=12.0),
    "rotary": rotary,
    "rotary, ten runs": lambda rng: rotary(rng, runs=10, play=0.0),
}

OTHER_AXES: dict[str, Callable[[np.random.Generator], Axis]] = {
    "drift from run to run": lambda rng: replace(linear(rng, reversal=2.0), drift=0.5e-6),
    "drift five times the scatter": lambda rng: replace(linear(rng, reversal=2.0), drift=5e-6),
    "drift as large as the scatter": lambda rng: replace(linear(rng, reversal=2.0), drift=1e-6),
    "each run drifts by itself": lambda rng: replace(linear(rng, reversal=4.0), apart=2e-6),
    "each run drifts a little": lambda rng: replace(linear(rng, reversal=4.0), apart=0.5e-6),
    "scale that grows": lambda rng: replace(linear(rng, span=12.0, reversal=2.0), growth=3e-6),
    "uniform scatter": lambda rng: replace(linear(rng, reversal=2.0), noise=uniform),
    "heavy tails": lambda rng: replace(linear(rng, reversal=2.0), noise=heavy_tailed),
    "screw, one target high": screw,
    "40 targets": long_travel,
    "5 targets": short_travel,
    "targets alike at the extremes": twins,
}
"""Axes that nothing of the method was chosen on."""


def interval(bounds: PositioningBounds, name: str) -> tuple[float, float]:
    """The interval of a figure by its name, such as bidirectional.accuracy."""
    where, figure = name.split(".")
    low, high = getattr(getattr(bounds, where), figure)
    return low, high


def widths_of_one_target(axis: Axis) -> dict[str, float]:
    """Widths of the 95 % intervals that the one target which scatters most would give by itself, or two such."""
    runs, most = axis.runs, float(np.hypot(axis.scatter, axis.drift).max())
    low, high = np.sqrt((runs - 1) / chi2.ppf([0.975, 0.025], runs - 1))
    of_scatter = 4 * most * (high - low)
    of_two = 2 * student_t.ppf(0.975, 2 * (runs - 1)) * most * np.sqrt(2 / runs)
    instrument = 2 * 1.96 * axis.instrument
    of_range = float(np.hypot(of_two, instrument))
    return {
        "forward.repeatability": of_scatter,
        "forward.systematic_deviation": of_range,
        "forward.accuracy": of_range + of_scatter,
        "bidirectional.reversal_error": of_two,
        "bidirectional.repeatability": of_two + of_scatter,
        "bidirectional.mean_deviation_range": float(np.hypot(of_two / np.sqrt(2), instrument)),
        "bidirectional.systematic_deviation": of_range,
        "bidirectional.accuracy": of_range + of_scatter,
    }


def missed(kind: str, count: int, stream: int = 0) -> dict[str, tuple[float, float]]:
    """Parts of so many tests in which the lower bound of a figure was above its truth, and the upper one below it."""
    found: dict[str, list[tuple[bool, bool]]] = {}
    for seed in range(count):
        rng = np.random.default_rng([count, stream, seed])
        axis = (AXES | OTHER_AXES)[kind](rng)
        bounds = bound_positioning(axis.measured(rng), axis.instrument)
        for name, true in axis.truth().items():
            low, high = interval(bounds, name)
            assert low >= 0 or name.endswith("mean_reversal_error")
            found.setdefault(name, []).append((low > true, high < true))
    return {name: tuple(np.mean(each, axis=0).round(3).tolist()) for name, each in found.items()}
