"""What is known of a machine's temperature, from a sensor that may be anything."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.thermometer import BEYOND, FAST, NOT_FINITE, Thermometer

MACHINE = load_machine("xyzac_trt")
S = 1_000_000_000
WIDEST = 16.0 / math.sqrt(12.0)


def test_a_machine_that_warms_is_believed():
    thermometer = Thermometer(MACHINE)
    generator = np.random.default_rng(1)
    for second in range(600):
        temperature = 20.0 + 4.0 * (1 - math.exp(-second / 60)) + generator.normal(0.0, 0.05)
        assert thermometer.push(second * S, temperature)
        assert thermometer.at(second * S).temperature == temperature
        assert thermometer.at(second * S).deviation == 0.0
        assert thermometer.trouble(second * S) == ""
    assert not thermometer.refused


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [(30.0, BEYOND), (100.0, BEYOND), (-300.0, BEYOND), (math.nan, NOT_FINITE), (math.inf, NOT_FINITE), (24.0, FAST)],
)
def test_what_is_not_believed_changes_nothing_and_is_told(wrong, reason):
    thermometer = Thermometer(MACHINE)
    thermometer.push(0, 20.0)
    for second in range(1, 20):
        assert not thermometer.push(second * S, wrong)
        assert thermometer.at(second * S).temperature == 20.0
        assert "temperature not believed" in thermometer.trouble(second * S)
    assert thermometer.refused == {reason: 19}
    assert thermometer.at(19 * S).deviation == pytest.approx(0.25 * 14), "5 s old, then 0.25 K/s"
    assert thermometer.push(20 * S, 20.1)
    assert thermometer.trouble(20 * S) == ""
    assert thermometer.at(20 * S).deviation == 0.0


def test_a_sensor_that_falls_silent_leaves_more_and_more_doubt():
    thermometer = Thermometer(MACHINE)
    thermometer.push(0, 21.0)
    assert thermometer.at(4 * S).deviation == 0.0
    assert thermometer.trouble(4 * S) == ""
    assert thermometer.trouble(6 * S) == "temperature is 6 s old"
    assert thermometer.at(9 * S).deviation == pytest.approx(1.0)
    assert thermometer.at(3600 * S).deviation == pytest.approx(WIDEST)
    assert thermometer.at(3600 * S).temperature == 21.0


@pytest.mark.parametrize("first", [23.0, math.nan, 45.0])
def test_what_a_machine_may_have_warmed_by_in_a_silence_is_believed_after_it(first):
    thermometer = Thermometer(MACHINE)
    thermometer.push(0, 20.0)
    assert thermometer.push(60 * S, first) == (first == 23.0)
    assert thermometer.push(61 * S, 23.0), "3 K within a minute is no more than the limit of 0.25 K/s"
    assert thermometer.at(61 * S).deviation == 0.0
    assert not thermometer.push(62 * S, 26.0)


def test_a_jump_does_not_become_true_by_lasting_before_or_after_a_silence():
    thermometer = Thermometer(MACHINE)
    thermometer.push(0, 20.0)
    for second in range(1, 100):
        assert not thermometer.push(second * S, 24.0)
    assert not thermometer.push(110 * S, 24.0), "the machine was unseen for 11 s of the 110"
    for second in range(111, 200):
        assert not thermometer.push(second * S, 24.0)


def test_without_a_sensor_the_reference_stands_in():
    thermometer = Thermometer(MACHINE)
    assert not thermometer.has_spoken
    assert thermometer.at(S).temperature == 20.0
    assert thermometer.at(S).deviation == pytest.approx(WIDEST)
    assert "no temperature" in thermometer.trouble(S)


def test_a_machine_that_does_not_expand_needs_none():
    thermometer = Thermometer(load_machine("pan2013"))
    assert not thermometer.needed
    assert thermometer.at(S).deviation == 0.0
    assert thermometer.trouble(S) == ""


def test_reset_believes_the_next_one():
    thermometer = Thermometer(MACHINE)
    thermometer.push(0, 20.0)
    assert not thermometer.push(S, 25.0)
    thermometer.reset()
    assert thermometer.push(2 * S, 25.0)


def test_after_the_clock_was_set_back_the_next_temperature_counts():
    """How much time passed is unknown; without forgetting, another temperature would never be believed again."""
    compensator = Compensator(MACHINE)
    thermometer = compensator.thermometer
    compensator.push_temperature(20.0, 100_000 * S)
    assert thermometer.last_ns == 100_000 * S
    compensator.forget_time()
    assert thermometer.last_ns is None and not thermometer.has_spoken
    compensator.push_temperature(23.0, 50 * S)
    assert thermometer.last_ns == 50 * S and thermometer.trouble(51 * S) == ""
    compensator.push_temperature(31.0, 51 * S)
    assert thermometer.last_ns == 50 * S and "not believed" in thermometer.trouble(51 * S)
