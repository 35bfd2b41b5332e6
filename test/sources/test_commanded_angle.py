"""The command of a controller that publishes joint states: whole turns, and speeds that it does not tell."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.joint_state import CommandedAngle, joint_velocity

FIELDS = ("angle", "velocity")
BEGIN = 1_000_000_000_000_000_000
END = BEGIN + 10**15


def command():
    return CommandedAngle(FIELDS, "joint_states", "sensor_msgs/msg/JointState", lambda message: message)


def given(source):
    block = source.take(BEGIN, END)
    return None if block is None else (block.times_ns, block.rows[:, 1:])


@pytest.mark.parametrize("seed", range(10))
def test_speeds_that_are_not_told_are_exact_under_even_acceleration(seed):
    """Stamps scatter by half of their distance, and the driver wraps: x0 + v t + a t^2 / 2 has the speed v + a t."""
    draw = np.random.default_rng(seed)
    steps = np.rint(1e7 * draw.uniform(0.5, 1.5, 400)).astype(np.int64)
    times = BEGIN + np.cumsum(steps)
    t = (times - BEGIN) * 1e-9
    speed, acceleration = draw.uniform(-6, 6), draw.uniform(-3, 3)
    angle = draw.uniform(-3, 3) + speed * t + 0.5 * acceleration * t**2
    source = command()
    for time, value in zip(times.tolist(), angle.tolist(), strict=True):
        source.add(time, (math.remainder(value, 2 * math.pi), math.nan))
    found_times, found = given(source)
    np.testing.assert_array_equal(found_times, times[2:])  # the first two only make the third one's speed
    np.testing.assert_allclose(found[:, 0] - found[0, 0], angle[2:] - angle[2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], (speed + acceleration * t)[2:], rtol=0, atol=2e-6)


def test_speeds_that_are_told_are_taken_from_the_first_sample_on():
    source = command()
    for k in range(4):
        source.add(BEGIN + 10**7 * k, (math.remainder(3.1 + 0.02 * k, 2 * math.pi), 2.0))
    _, found = given(source)
    np.testing.assert_allclose(found, [[3.1 + 0.02 * k, 2.0] for k in range(4)])


def test_a_driver_that_tells_speeds_now_and_then_has_no_sample_without_one():
    """After a told one two samples are needed again; none goes out with a speed that was made of other samples."""
    source = command()
    for k in range(9):
        source.add(BEGIN + 10**7 * k, (0.01 * k, 1.0 if k == 4 else math.nan))
    times, found = given(source)
    assert ((times - BEGIN) // 10**7).tolist() == [2, 3, 4, 7, 8]
    np.testing.assert_allclose(found[:, 1], 1.0, rtol=1e-6)


@pytest.mark.parametrize("bad", [math.inf, math.nan])
@pytest.mark.parametrize("speed", [math.nan, 1.0])
def test_what_is_refused_leaves_no_trace(bad, speed):
    source, plain = command(), command()
    for k in range(6):
        for each in (source, plain):
            each.add(BEGIN + 10**7 * k, (0.01 * k, speed))
        with pytest.raises(InputError):
            source.add(BEGIN + 10**7 * k + 1, (bad, speed))
        with pytest.raises(InputError, match="future"):  # an hour ahead of its arrival
            source.add(BEGIN + 3600 * 10**9, (0.5, 1.0), BEGIN + 10**7 * k + 2)
    for own, other in zip(given(source), given(plain), strict=True):
        np.testing.assert_array_equal(own, other)


def test_stamps_that_go_back_are_refused_and_make_no_speed():
    source = command()
    for k in range(3):
        source.add(BEGIN + 10**7 * k, (0.01 * k, math.nan))
    source.add(BEGIN + 10**7, (0.5, math.nan))  # by itself it makes none
    source.add(BEGIN + 15 * 10**6, (0.5, math.nan))
    with pytest.raises(InputError, match="not after the one before"):
        source.add(BEGIN + 18 * 10**6, (0.5, math.nan))
    times, _ = given(source)
    assert times.tolist() == [BEGIN + 2 * 10**7]


def test_velocities_of_joint_states():
    def message(velocity, names=("a", "b")):
        return SimpleNamespace(name=list(names), position=[0.0] * len(names), velocity=velocity)

    assert joint_velocity(message([1.0, 2.0]), "b") == 2.0
    assert joint_velocity(message([3.0], ["a"]), "") == 3.0
    assert math.isnan(joint_velocity(message([]), "b"))
    with pytest.raises(InputError, match=r"with 1 velocities; expected one of each or none"):
        joint_velocity(message([1.0]), "b")
