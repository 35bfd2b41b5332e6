"""A listed sensor of uncertain latency: what it shows is as uncertain as it changes meanwhile."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from described_stages import stage_of
from hypothesis import given
from hypothesis import strategies as st
from pipeline.test_estimation import SPEED, STAGE, true_motion
from pipeline.test_listed_sensors import AXIAL, described, off, recorded, run, truth

from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription, stage_mapping
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.evidence import COLUMNS
from rotary_error_monitor.pipeline.listed_readings import ListedReadings, ListedTicks
from rotary_error_monitor.signals.resampling import Resampled, resample, tick_times
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

NAME = "axial_probe_top"
KEY = "sensors.top.timing"
WAVE = 4e-5  # m, that the face is higher on one side
NOISE, ZERO = 2e-8, 1e-8  # m, of a reading, and of zero and form as stated


def stage(timing: float | None, gain: float = 1.0) -> StageDescription:
    """An axial probe before a face that leans, as late as its file says, give or take `timing`, s."""
    probe = ListedSensor(
        "axial_probe", NOISE, 0.0, 1e-4, ZERO, gain=gain, place={"radius": 0.0}, form=(AngularHarmonic(1, WAVE, 0.0),)
    )
    made = described({NAME: probe})
    return made if timing is None else dataclasses.replace(made, uncertainty={**made.uncertainty, KEY: timing})


def shown(timing: float, late: float, rate: float, speed: float, gain: float, seed: int) -> tuple[ListedTicks, Any]:
    """What a probe shows that is late, at ticks of 1 ms, and the rotation there: (ticks, theta)."""
    draw, ticks = np.random.default_rng(seed), tick_times(20, 200, 1_000_000)
    times = np.arange(0, 300_000_000, round(1e9 / rate), np.int64)
    readings = gain * (WAVE * np.cos(speed * (times * 1e-9 - late)) + NOISE * draw.normal(size=len(times)))
    theta = speed * ticks * 1e-9
    seen: Resampled = resample(times, readings[:, None], ticks, 1_000_000, 25_000_000)
    motion = ErrorMotion.of(theta, np.zeros((200, 6)), np.zeros((200, 6), np.bool_), np.zeros((200, 6, 6)))
    made = ListedReadings(stage(timing, gain), 1e-3)
    there, evidence = np.ones((200, 1), np.bool_), np.zeros((200, len(COLUMNS)))
    return made.make(motion, evidence, there, {NAME: seen}, {NAME: rate}), theta


@pytest.mark.parametrize("rate", [300.0, 1000.0, 20000.0])
@given(timing=st.floats(1e-5, 1e-3), speed=st.floats(1.0, 30.0), gain=st.sampled_from([1.0, -1.5, 0.2]))
def test_it_is_its_rate_of_change_times_the_uncertainty(rate: float, timing: float, speed: float, gain: float) -> None:
    """The closed form: a leaning face passes a probe at `WAVE * speed * |sin|`, whatever it reads per displacement."""
    ticks, theta = shown(timing, 0.0, rate, speed, gain, 1)
    expected = timing * WAVE * speed * np.abs(np.sin(theta))
    # speed between samples is known to their noise, and over some of them it is a mean
    noise = timing * 5 * NOISE * min(rate, 20000.0) / 3 + timing * WAVE * speed * (3 * speed / min(rate, 1000.0)) ** 2
    fitted = 0.15 * expected if rate > 9000.0 else 0.0
    assert (np.abs(ticks.late[:, 0] - expected) <= noise + fitted).all()
    np.testing.assert_allclose(ticks.common[:, 0], ticks.late[:, 0] ** 2, rtol=1e-12)
    without, _ = shown(0.0, 0.0, rate, speed, gain, 1)
    assert not without.late.any() and not without.common.any()


def test_over_random_lateness_it_is_as_large_as_stated() -> None:
    """The error of many sensors, each late by an amount of its own, in stated standard deviations: of variance 1."""
    timing, errors = 3e-4, []
    for seed in range(300):
        late = timing * np.random.default_rng([seed, 5]).normal()
        ticks, _ = shown(timing, late, 1000.0, SPEED, 1.0, seed)
        errors.append(ticks.reading[77, 0] / np.sqrt(ticks.noise[77, 0] + ticks.common[77, 0]))
    assert 0.75 < np.var(errors) < 1.25 and np.abs(errors).max() < 5.0


@pytest.mark.parametrize(("seed", "gain"), [(0, 1.0), (1, -2.0)])
def test_an_estimate_holds_what_a_late_sensor_has_wrong(seed: int, gain: float) -> None:
    """Late by three standard uncertainties: within six standard deviations, and far outside where none is stated."""
    timing = 2e-3

    def late(name: str, t: np.ndarray, readings: np.ndarray, draw: np.random.Generator) -> np.ndarray:
        if name != NAME:
            return readings
        then = t - 3 * timing
        height = truth(then)[:, 2] + WAVE * np.cos(true_motion(then)[0])
        return gain * (height + NOISE * draw.normal(size=len(t)))[:, None]

    pairs = recorded(AXIAL, seed, duration=3.0, fault=late)
    worst = []
    for known in (timing, None):
        _, motion, doubted = run(pairs, stage(known, gain))
        found, t = off(motion)
        assert not doubted
        worst.append(float(np.nanmax(np.abs(found[t > 2.5, 2]))))
        assert motion.observable[t > 2.5, 2].mean() > 0.99
    assert worst[0] < 6.0 < worst[1]


def test_the_file_states_it_and_the_twin_leaves_it_to_effects() -> None:
    made = stage(2e-4)
    assert stage_of(stage_mapping(made)) == made
    assert (made.timing("sensors.top"), made.timing("sensors.other"), STAGE.timing("command")) == (2e-4, 0.0, 2e-6)
    assert not any(parameter.name == KEY for parameter in uncertain_parameters(made))
