"""Small problems whose truth is known: cases of the plant, and linear ones made of plain numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Effect, Parameter
from rotary_error_monitor.gap.problem import Candidate, Conditions


class Shape(Effect):
    """A made-up effect: a known column of numbers times one amplitude."""

    parameters = (Parameter("size", "1", 10.0),)

    def __init__(self, name, column):
        self.name = name
        self.column = column


@dataclass
class LinearProblem:
    """White data of two channels, columns as effects, nuisances as plain columns."""

    data: dict
    effects: dict
    nuisances: dict = field(default_factory=dict)
    blocks: int = 8
    m_open = False

    def offer(self, columns):
        """Make columns the effects that are known, whatever was known before; "name@place" is an effect at a place."""
        self.effects = {key: Shape(key.partition("@")[0], column) for key, column in columns.items()}

    @property
    def channels(self):
        return tuple(self.data)

    @property
    def conditions(self):
        count = len(next(iter(self.data.values())))
        labels = np.arange(self.blocks) % 4
        return Conditions(np.linspace(0, count, self.blocks + 1) - 0.5, labels, ("a", "b", "c", "d"))

    def times(self, channel):
        return np.arange(len(self.data[channel]), dtype=float)

    def expected(self, channel):
        return np.ones(len(self.data[channel]))

    def residual(self, causes):
        left = {channel: rows.copy() for channel, rows in self.data.items()}
        for cause in causes:
            for channel, rows in cause.effect.column.items():
                left[channel] -= rows @ cause.values[:, None]
        return left

    def signature(self, cause, indices, others=()):
        return dict(cause.effect.column)

    def distortions(self, candidates, causes):
        return [0.0] * len(candidates)

    def nuisance(self, causes):
        return self.nuisances

    def candidates(self, rest, causes):
        return tuple(Candidate(effect, key.partition("@")[2], effect.start("")) for key, effect in self.effects.items())

    def structure(self, rest):
        return []

    def learn_noise(self, causes):
        return False


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture
def linear(rng):
    """Three effects, the third nearly the first; the data hold the first at size 0.5 beside noise."""
    count = 800
    first, second = rng.normal(size=(2, count, 1))
    third = 0.995 * first + 0.1 * rng.normal(size=(count, 1))
    other = rng.normal(size=(count, 1))
    effects = {
        "first": Shape("first", {"x": first}),
        "second": Shape("second", {"x": second, "y": other}),
        "third": Shape("third", {"x": third}),
    }
    data = {"x": 0.5 * first + rng.normal(size=(count, 1)), "y": rng.normal(size=(count, 1))}
    return LinearProblem(data, effects)
