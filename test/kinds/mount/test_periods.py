"""Short periods of an axis: told with their length, and no more often by chance than is said."""

from __future__ import annotations

import re

import numpy as np
import pytest
from draws import seeds
from simulated_pointings import pointing_file, simulate_pointings

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.mount.description import MountDescription
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.periods import AxisPeriods
from rotary_error_monitor.kinds.mount.pointings import parse_pointings
from rotary_error_monitor.kinds.mount.problem import ORDERS, MountProblem

EFFECTS = load_effects(MountEffect)
NOISE = 5e-5


@pytest.mark.parametrize("level", [1.0, 1.7])
@pytest.mark.parametrize("both_sides", [False, True])
def test_a_period_is_told_by_chance_as_often_as_is_said(both_sides, level):
    """Beside something that is left and is no wave as well: it may be louder than noise."""
    rng, tries, rate, count = np.random.default_rng(1), 250, 0.1, 200
    alarms = 0
    for _ in range(tries):
        position = rng.uniform(-1.3, 1.3, count) + np.pi * both_sides * rng.integers(0, 2, count)
        periods = AxisPeriods(position, np.cos(rng.uniform(-0.3, 1.3, count)), ORDERS)
        found = periods.finding(level * rng.normal(size=count), np.ones(count, bool), "hour", "hour angle")
        alarms += found.log_p_value < np.log(rate)
    assert 0.2 * rate <= alarms / tries <= rate + 3 * np.sqrt(rate * (1 - rate) / tries)


def test_a_wave_alone_is_explained_whole():
    """Its squares are those of the rows themselves, whatever the weight and the phase."""
    rng = np.random.default_rng(2)
    position, turned = rng.uniform(-1, 2, 80), rng.choice([-1.0, 1.0], 80) * rng.uniform(0.2, 1, 80)
    periods, kept = AxisPeriods(position, turned, ORDERS), rng.random(80) < 0.9
    for seed in range(20):
        draw = np.random.default_rng(seed)
        white = kept * turned * np.cos(draw.uniform(20, 600) * position + draw.uniform(0, 6))
        assert float(periods.spectrum(white, kept).max()) == pytest.approx(float(white @ white), rel=0.05)


@pytest.mark.parametrize("axis", ["polar", "declination"])
def test_the_error_of_a_worm_is_told_with_its_period(axis):
    """Of 1.5 to 3 degrees and four times the noise, which was *no gap*: neighbours on the sky do not share it."""
    column, way = (0, "hour angle") if axis == "polar" else (1, "declination")
    told, drawn = 0, seeds(12)
    for seed in drawn:
        period = np.radians(np.random.default_rng(seed).uniform(1.5, 3.0))

        def worm(pose, period=period):
            return 4 * NOISE * np.sin(2 * np.pi * pose.readings[:, column] / period)[:, None] * getattr(pose, axis)

        recording = parse_pointings(pointing_file(simulate_pointings(seed, turn=worm)), "made")
        diagnosis = diagnose(MountProblem(MountDescription("mount", 5e-6), recording, EFFECTS))
        assert diagnosis.verdict is Verdict.UNKNOWN
        match = re.fullmatch(rf"pose, {way}: period of (\S+)°", diagnosis.remainder[0].pattern)
        told += match is not None and abs(float(match[1]) / np.degrees(period) - 1) < 0.01
    assert told >= 0.9 * len(drawn)
