"""Positioning tests of axes whose means and scatter are known at each target, and how often their bounds hold.

What infinitely many runs would give is written out from ISO 230-2 target by target and shares nothing with the package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.positioning import PositioningRuns
from rotary_error_monitor.metrology.positioning_bounds import PositioningBounds, bound_positioning

Array = NDArray[np.float64]


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
    """

    targets: Array
    there: Array
    back: Array
    scatter: Array
    runs: int = 5
    rotary: bool = False
    instrument: float = 0.0

    def truth(self) -> dict[str, float]:
        """The figures of infinitely many runs."""
        (s, t), n = self.scatter, len(self.targets)
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

    def measured(self, rng: np.random.Generator) -> PositioningRuns:
        """Runs there and back, by an instrument whose error grows along the travel and is alike in all runs."""
        along = (self.targets - self.targets[0]) / np.ptp(self.targets)
        offset = self.instrument * rng.normal() * along
        readings = [
            (mean + offset)[:, None] + scatter[:, None] * rng.normal(size=(len(along), self.runs))
            for mean, scatter in zip((self.there, self.back), self.scatter, strict=True)
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


AXES: Mapping[str, Callable[[np.random.Generator], Axis]] = {
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


def interval(bounds: PositioningBounds, name: str) -> tuple[float, float]:
    """The interval of a figure by its name, such as bidirectional.accuracy."""
    where, figure = name.split(".")
    low, high = getattr(getattr(bounds, where), figure)
    return low, high


def missed(kind: str, count: int, stream: int = 0) -> dict[str, tuple[float, float]]:
    """Parts of so many tests in which the lower bound of a figure was above its truth, and the upper one below it."""
    found: dict[str, list[tuple[bool, bool]]] = {}
    for seed in range(count):
        rng = np.random.default_rng([count, stream, seed])
        axis = AXES[kind](rng)
        bounds = bound_positioning(axis.measured(rng), axis.instrument)
        for name, true in axis.truth().items():
            low, high = interval(bounds, name)
            assert low >= 0 or name.endswith("mean_reversal_error")
            found.setdefault(name, []).append((low > true, high < true))
    return {name: tuple(np.mean(each, axis=0).round(3).tolist()) for name, each in found.items()}
