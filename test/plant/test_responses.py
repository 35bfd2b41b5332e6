"""True readings of instruments with a response of their own, by closed forms; without one the bits are as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.plant import StagePlant, stage_clocks

STAGE = load_stage()
TIME = np.linspace(2.0, 4.0, 50)


def shown(stream, time=TIME, **responses):
    return StagePlant(replace(STAGE, responses=responses), seed=2).signal(stream, time)


def test_zero_and_sign_of_a_head():
    ideal = shown("head_a")
    np.testing.assert_allclose(shown("head_a", head_a=Response((2.7,), -1.0)), 2.7 - ideal, rtol=0, atol=1e-15)
    assert np.array_equal(shown("head_b", head_a=Response((2.7,), -1.0)), shown("head_b"))


def test_zero_and_sign_of_the_command():
    """The speed has the sign, but no zero."""
    angle, speed = shown("command").T
    found = shown("command", command=Response((1.3, 0.0), -1.0))
    np.testing.assert_allclose(found, np.stack([1.3 - angle, -speed], axis=1), rtol=0, atol=1e-15)


def test_zero_gain_and_roll_of_two_axes():
    x, y = shown("lvdt").T
    found = shown("lvdt", lvdt=Response((1e-5, 3e-5), -2.0, np.pi / 2))
    np.testing.assert_allclose(found, np.stack([1e-5 + 2 * y, 3e-5 - 2 * x], axis=1), rtol=0, atol=1e-19)


@pytest.mark.parametrize("stream", ["head_c", "autocollimator", "lvdt", "command"])
def test_latency_stamps_later(stream):
    late = shown(stream, **{stream: Response(latency=2e-3)})
    np.testing.assert_allclose(late, shown(stream, TIME - 2e-3), rtol=0, atol=1e-15)


def test_latency_of_a_listed_sensor():
    probe = ListedSensor(
        "axial_probe", 1e-8, 1e-9, 1e-3, 1e-8, place={"radius": 0.05}, form=(AngularHarmonic(2, 1e-6, 0.0),)
    )
    stage, top = replace(STAGE, sensors={"axial_probe_top": probe}), ("axial_probe_top",)
    plain = StagePlant(stage, seed=2, clocks=stage_clocks(sensors=top))
    late = replace(plain, description=replace(stage, responses={top[0]: Response(latency=5e-4)}))
    np.testing.assert_allclose(late.signal(top[0], TIME), plain.signal(top[0], TIME - 5e-4), rtol=0, atol=1e-18)
    assert np.ptp(plain.signal(top[0], TIME)) > 1e-6


def test_noise_range_and_resolution_are_of_what_is_shown():
    """With a gain of 2 the same samples are twice as large: their noise, their steps, their end."""
    tilted = replace(STAGE, mirror=replace(STAGE.mirror, tilt=(6e-4, 0.0)))
    plain = StagePlant(tilted, seed=2).samples("autocollimator", 400, 1500)
    twice = replace(tilted, responses={"autocollimator": Response(gain=2.0)})
    found = StagePlant(twice, seed=2).samples("autocollimator", 400, 1500)
    np.testing.assert_allclose(found.rows[:, 1:], 2 * plain.rows[:, 1:], rtol=1e-12)
    assert np.abs(plain.rows[:, 1]).max() == pytest.approx(STAGE.autocollimator.range, rel=1e-3)


def test_an_ideal_response_changes_no_bit():
    for stream in ("head_a", "autocollimator", "lvdt"):
        plain = StagePlant(STAGE, seed=2).samples(stream, 400, 500)
        ideal = replace(STAGE, responses={stream: Response((0.0, 0.0)[: plain.rows.shape[1] - 1])})
        assert np.array_equal(StagePlant(ideal, seed=2).samples(stream, 400, 500).rows, plain.rows)


def test_a_distortion_bends_what_is_shown():
    """Along the axes of the instrument, which stand 0.3 rad from those of the stage."""
    x, y = shown("autocollimator").T
    found = shown("autocollimator", autocollimator=Response((1e-5, 0.0), 1.1, 0.3, 0.0, 0.04, -0.02, (2e6, -3e6)))
    u, v = np.cos(0.3) * x - np.sin(0.3) * y, np.sin(0.3) * x + np.cos(0.3) * y
    u, v = 1.02 * u - 0.02 * v, 0.98 * v - 0.02 * u
    expected = np.stack([1e-5 + 1.1 * u * (1 + 2e6 * u**2), 1.1 * v * (1 - 3e6 * v**2)], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-18)
    assert np.abs(found - np.stack([1e-5 + 1.1 * u, 1.1 * v], axis=1)).max() > 1e-6
