"""What is known of a machine's temperature, from a sensor that may be anything."""

from __future__ import annotations

import math

import numpy as np
import pytest
from faults.documenting import Row, shows
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.thermometer import BEYOND, FAST, JITTER, MachineThermometer, Warmth
from rotary_error_monitor.signals.admission import NOT_FINITE

MACHINE = load_machine("xyzac_trt")
S = 1_000_000_000
WIDEST = 16.0 / math.sqrt(12.0)


def proven(temperature: float = 20.0, until_ns: int = 0) -> MachineThermometer:
    """One that has said the same for a second."""
    thermometer = MachineThermometer(MACHINE)
    for stamp_ns in (until_ns - S, until_ns):
        assert thermometer.push(stamp_ns, temperature)
    return thermometer


def test_a_machine_that_warms_is_believed():
    thermometer = proven()
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
    thermometer = proven()
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
    thermometer = proven(21.0)
    assert thermometer.at(4 * S).deviation == 0.0
    assert thermometer.trouble(4 * S) == ""
    assert thermometer.trouble(6 * S) == "temperature is 6 s old"
    assert thermometer.at(9 * S).deviation == pytest.approx(1.0)
    assert thermometer.at(3600 * S).deviation == pytest.approx(WIDEST)
    assert thermometer.at(3600 * S).temperature == 21.0


@pytest.mark.parametrize("first", [23.0, math.nan, 45.0])
def test_what_a_machine_may_have_warmed_by_in_a_silence_is_believed_after_it(first):
    thermometer = proven()
    assert thermometer.push(60 * S, first) == (first == 23.0)
    assert thermometer.push(61 * S, 23.0), "3 K within a minute is no more than the limit of 0.25 K/s"
    assert thermometer.at(61 * S).deviation == 0.0
    assert not thermometer.push(62 * S, 26.0)


def test_a_jump_does_not_become_true_by_lasting_before_or_after_a_silence():
    thermometer = proven()
    for second in range(1, 100):
        assert not thermometer.push(second * S, 24.0)
    assert not thermometer.push(110 * S, 24.0), "the machine was unseen for 11 s of the 110"
    for second in range(111, 200):
        assert not thermometer.push(second * S, 24.0)


RATE = MACHINE.limits.temperature_rate


def stamps_of(hertz, seconds, generator):
    """Messages at a rate, each up to a tenth of their distance early or late."""
    count = max(3, int(seconds * hertz))
    return np.round((np.arange(count) + generator.uniform(-0.1, 0.1, count)) / hertz * 1e9).astype(np.int64) + S


@settings(deadline=None, max_examples=150)
@given(
    st.integers(0, 2**31),
    st.floats(-1.0, 2.0).map(lambda power: 10.0**power),
    st.floats(0.0, JITTER),
    st.sampled_from(["uniform", "extremes", "alternating", "resolution"]),
)
def test_a_sound_thermometer_is_believed_at_any_rate_with_any_noise_and_resolution_up_to_the_jitter(
    seed, hertz, size, kind
):
    """The machine warms and cools as fast as it can; noise and rounding together change it by no more than `size`."""
    generator = np.random.default_rng(seed)
    times = stamps_of(hertz, min(60.0, 2000 / hertz) if hertz > 1 else 40 / hertz, generator)
    passed = np.diff(times, prepend=times[0]) * 1e-9
    speed = RATE * np.where(generator.random(len(times)) < 0.1, generator.uniform(-1, 1, len(times)), 1.0)
    turns = np.sign(np.sin(2 * np.pi * generator.uniform(0.02, 0.5) * times * 1e-9 + 1.0))
    true = 20.0 + np.cumsum(np.clip(speed * turns, -RATE, RATE) * passed)
    true = 20.0 + np.clip(true - 20.0, -6.0, 6.0)
    if kind == "resolution":
        shown = np.round(true / max(size, 1e-3)) * max(size, 1e-3)
    else:
        extremes = {
            "uniform": generator.uniform(-1, 1, len(times)),
            "extremes": generator.choice([-1.0, 1.0], len(times)),
            "alternating": np.resize([-1.0, 1.0], len(times)),
        }
        shown = true + 0.5 * size * extremes[kind]
    thermometer = MachineThermometer(MACHINE)
    assert all(thermometer.push(int(time), float(value)) for time, value in zip(times, shown, strict=True))
    assert not thermometer.refused


@settings(deadline=None, max_examples=150)
@given(
    st.integers(0, 2**31),
    st.floats(-1.0, 2.0).map(lambda power: 10.0**power),
    st.floats(1.3, 100.0),
    st.sampled_from(["ramp", "steps"]),
    st.floats(0.0, 0.2),
    st.sampled_from([-1.0, 1.0]),
)
def test_what_drifts_faster_than_a_machine_warms_is_told_at_any_rate_of_messages(
    seed, hertz, times_limit, kind, noise, sign
):
    """What it shows is never believed farther from what the machine can have than by the jitter, counted once."""
    generator = np.random.default_rng(seed)
    drift = RATE * times_limit
    most = 7.0 / drift
    times = stamps_of(hertz, max(most, 4 / hertz), generator)
    since = (times - times[0]) * 1e-9
    way = drift * since if kind == "ramp" else drift * np.floor(since / 2.0) * 2.0
    shown = 20.0 + sign * np.minimum(way, 7.0) + generator.uniform(-0.5, 0.5, len(times)) * noise
    thermometer = proven(shown[0], int(times[0]) - 1)
    for time, passed, value in zip(times, since, shown, strict=True):
        believed = thermometer.push(int(time), float(value))
        beyond = abs(value - shown[0]) - RATE * passed
        assert not (believed and beyond > JITTER + 1e-6)
        if beyond > JITTER + noise + 1e-6:
            assert not believed and FAST in thermometer.trouble(int(time))
            assert abs(thermometer.at(int(time)).temperature - shown[0]) <= RATE * passed + JITTER + 1e-6


@pytest.mark.parametrize("back", [0, 10 * S], ids=["equal stamps", "stamps that go back"])
def test_stamps_that_do_not_go_on_give_no_time_to_warm(back):
    thermometer = proven(until_ns=20 * S)
    for number in range(40):
        thermometer.push(20 * S - back * (number % 2), 20.0 + 0.1 * number)
    assert thermometer.refused == {FAST: 34}
    assert thermometer.at(20 * S).temperature == pytest.approx(20.5)


def test_without_a_sensor_the_reference_stands_in():
    thermometer = MachineThermometer(MACHINE)
    assert not thermometer.has_spoken
    assert thermometer.at(S).temperature == 20.0
    assert thermometer.at(S).deviation == pytest.approx(WIDEST)
    assert "no temperature" in thermometer.trouble(S)


def test_a_machine_that_does_not_expand_needs_none():
    thermometer = MachineThermometer(load_machine("pan2013"))
    assert not thermometer.needed
    assert thermometer.at(S).deviation == 0.0
    assert thermometer.trouble(S) == ""


def test_reset_believes_the_next_one():
    thermometer = MachineThermometer(MACHINE)
    thermometer.push(0, 20.0)
    assert not thermometer.push(S, 25.0)
    thermometer.reset()
    assert thermometer.push(2 * S, 25.0)


def test_after_the_clock_was_set_back_the_next_temperature_counts():
    """How much time passed is unknown; without forgetting, another temperature would never be believed again."""
    compensator = Compensator(MACHINE)
    thermometer = compensator.thermometer
    compensator.push_temperature(20.0, 99_999 * S)
    compensator.push_temperature(20.0, 100_000 * S)
    assert thermometer.last_ns == 100_000 * S
    compensator.forget_time()
    assert thermometer.last_ns is None and not thermometer.has_spoken
    compensator.push_temperature(23.0, 49 * S)
    compensator.push_temperature(23.0, 50 * S)
    assert thermometer.last_ns == 50 * S and thermometer.trouble(51 * S) == ""
    compensator.push_temperature(31.0, 51 * S)
    assert thermometer.last_ns == 50 * S and "not believed" in thermometer.trouble(51 * S)


@shows(
    Row(
        "joints",
        "The first temperature is wrong, or those of the first 0.5 s, as of a driver that is not connected yet",
        "`compensation: correction`: no other has confirmed it yet; then that the next is faster than a machine warms",
        "until temperatures have agreed for 0.5 s each is as uncertain as its range, and one that contradicts it takes "
        "its place",
        "corrections with that uncertainty; held where it is larger than `uncertainty_limit`",
        "0.5 s after the first sound temperature, with the second of a slow sensor; where they are wrong "
        "for longer, on a reset",
    )
)
@pytest.mark.parametrize("rate", [1, 100])
@pytest.mark.parametrize("first", [12.5, 14.0, 24.0, 27.9])
def test_a_first_temperature_that_is_wrong_is_not_certain_and_gives_way(first, rate):
    """A driver that is not connected yet says what it likes, for less than half a second."""
    thermometer = MachineThermometer(MACHINE)
    wrong = max(1, int(0.4 * rate))
    for number in range(wrong + 2 * rate):
        stamp_ns = number * S // rate
        thermometer.push(stamp_ns, first if number < wrong else 21.0)
        known = thermometer.at(stamp_ns)
        assert abs(known.temperature - 21.0) <= 6.0 * known.deviation
    assert thermometer.at(stamp_ns) == Warmth(21.0, 0.0)
    assert thermometer.trouble(stamp_ns) == ""
    assert thermometer.refused == {FAST: 1}


def test_what_contradicts_itself_from_the_start_stays_uncertain():
    thermometer = MachineThermometer(MACHINE)
    for second in range(60):
        thermometer.push(second * S, (14.0, 21.0)[second % 2])
        assert thermometer.at(second * S).deviation == pytest.approx(WIDEST)
        assert thermometer.trouble(second * S)
