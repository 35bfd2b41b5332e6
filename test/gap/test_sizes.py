"""How large a departure is beside its cause where noise is slow: a ratio of what they do, not of what noise leaves."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.departures import Departures, Modulation, amplitude_sizes, modulated, spread_out, wanders
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.posterior import departures_of
from rotary_error_monitor.noise.slow_noise import SlowNoise, cells_of
from test.gap.conftest import LinearProblem

COUNT = 2000
PASSED = (np.arange(COUNT)[:, None] + 0.5) / COUNT
TREMBLE = np.sqrt(2.0) * np.cos(60 * np.pi * PASSED)
"""Much faster than the noise, so that this hardly weighs it down."""

SLOW = np.sqrt(2.0) * np.cos(np.pi * PASSED * np.arange(1, 8))
"""Courses of the noise: seven half periods over the recording at most."""


class DriftBesideSlowNoise(LinearProblem):
    """A drift in white rows that are weighed down where the noise is slow; it may tremble."""

    noise = SlowNoise(cells_of(np.ones(COUNT), COUNT), 2.0 * SLOW)

    def without_slow_noise(self, columns):
        return {channel: self.noise.plain(rows) for channel, rows in columns.items()} if self.slow else None

    def departures(self, causes):
        (cause,) = causes
        amplitudes, sizes = cause.values[:1], amplitude_sizes(cause)
        modulations = [Modulation("course", TREMBLE, wanders)]
        plain = self.noise.plain(cause.effect.column["x"]) if self.slow else cause.effect.column["x"]
        rows = modulated(plain[:, None, :], amplitudes, sizes, modulations)[:, 0]
        columns = {"x": self.noise.whiten(rows) if self.slow else rows}
        return (Departures(0, *spread_out(modulations, amplitudes, sizes), columns),)


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_a_departure_has_the_size_that_it_has_of_its_cause(rng, slow, share):
    drift = PASSED - PASSED.mean()
    drift /= np.sqrt(np.mean(drift**2))
    whiten = DriftBesideSlowNoise.noise.whiten if slow else np.asarray
    for _ in range(10):
        data = rng.normal(size=(COUNT, 1)) + whiten(20 * drift * (1 + share * TREMBLE))
        problem = DriftBesideSlowNoise({"x": data}, {})
        problem.slow = slow
        problem.offer({"drift": {"x": whiten(drift)}})
        cause = Cause(problem.effects["drift"], "", np.array([20.0]))
        fit = fit_causes(problem, fit_causes(problem, (cause,)).causes, departures=problem.departures((cause,)))
        (found,) = departures_of(fit)
        assert found.share() == pytest.approx(share, rel=0.2)
