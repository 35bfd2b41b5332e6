"""Commanded motion against numerical integration, and forces and temperature against what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.environment import Forces, Push, TemperatureCourse, intermittent_forces
from rotary_error_monitor.plant.motion import Motion, MotionSegment, motion_in_use, random_motion, reversing_motion


@pytest.mark.parametrize("motion", [reversing_motion(), random_motion(3), random_motion(4, duration=60, segments=9)])
def test_angle_is_the_integral_of_velocity_and_acceleration_stays_below_its_limit(motion: Motion) -> None:
    time = np.arange(-5, 2.2 * motion.cycle, 1e-4)
    angle, velocity = motion.at(time)
    steps = np.diff(angle) - 1e-4 * (velocity[1:] + velocity[:-1]) / 2
    assert np.abs(steps).max() < 1e-8
    acceleration = np.diff(velocity) / 1e-4
    assert np.abs(acceleration).max() == pytest.approx(motion.acceleration, rel=1e-3)
    assert np.abs(np.diff(acceleration)).max() < 0.02 * motion.acceleration  # no jumps


def test_angle_of_constant_speeds_is_their_sum() -> None:
    motion = Motion((MotionSegment(10.0, 2.0), MotionSegment(5.0, -1.0)), acceleration=30.0)
    angle, velocity = motion.at(np.array([0.0, 15.0, 30.0, 9.0, 14.0]))
    ramp = 1.875 * 3 / 30
    turn = 10 * 2.0 - 5 * 1.0  # the two ramps lose and gain the same
    np.testing.assert_allclose(angle[:3], [0, turn, 2 * turn], rtol=0, atol=1e-12)
    np.testing.assert_allclose(angle[3], 9 * 2.0 - 3 * ramp / 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(velocity[3:], [2.0, -1.0], rtol=0, atol=1e-12)


@given(st.lists(st.tuples(st.floats(2, 20), st.floats(-10, 10)), min_size=1, max_size=6), st.floats(-1e3, 1e3))
@example([(2.0, 0.0), (2.0, 1.0)], -5e-324)
def test_motion_repeats(rows: list[tuple[float, float]], start: float) -> None:
    motion = Motion(tuple(MotionSegment(*row) for row in rows))
    time = start + np.linspace(0, 30, 50)
    first, then = motion.at(time), motion.at(time + motion.cycle)
    np.testing.assert_allclose(then[1], first[1], rtol=0, atol=1e-6)
    advance = then[0] - first[0]
    np.testing.assert_allclose(advance, advance[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("segments", "acceleration", "message"),
    [
        ((), 60.0, "at least one segment"),
        ((MotionSegment(1.0, 1.0),), 0.0, "acceleration 0.0"),
        ((MotionSegment(0.01, 10.0), MotionSegment(5.0, 0.0)), 60.0, "duration must be at least the 0.312 s"),
        ((MotionSegment(5.0, np.nan),), 60.0, "all numbers finite"),
        ((MotionSegment(0.0, 1.0),), 60.0, "longer than 0 s"),
    ],
)
def test_impossible_motion_is_refused(segments: tuple[MotionSegment, ...], acceleration: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Motion(segments, acceleration)


def test_random_motion_is_seeded_lasts_as_told_and_goes_both_ways() -> None:
    assert random_motion(5) == random_motion(5) != random_motion(6)
    for seed in range(20):
        motion = random_motion(seed, duration=40)
        assert motion.cycle == pytest.approx(40)
        speeds = [segment.speed for segment in motion.segments]
        assert min(speeds) < 0 < max(speeds)
        assert speeds[0] == speeds[-1] == 0


def test_motion_in_use_makes_arcs_and_many_turns_stops_and_small_changes_of_speed() -> None:
    motions = [motion_in_use(seed) for seed in range(60)]
    arcs = [float(np.ptp(motion.at(np.linspace(0.0, 40.0, 4000))[0])) / (2 * np.pi) for motion in motions]
    assert min(arcs) < 1e-3 and max(arcs) > 3
    assert any(segment.speed == 0 for motion in motions for segment in motion.segments)
    changes = [abs(change) for motion in motions for change in np.diff([s.speed for s in motion.segments]) if change]
    assert min(changes) < 0.1 < max(changes)
    assert any(motion.cycle < 20 for motion in motions) and any(motion.cycle > 40 for motion in motions)


def test_push_rises_stays_and_goes() -> None:
    forces = Forces((Push(2.0, 3.0, (100.0, -50.0), rise=0.5),), cycle=10.0)
    force = forces.at(np.array([1.9, 2.25, 2.5, 4.0, 4.75, 5.1, 12.25]))
    np.testing.assert_allclose(force.real, [0, 50, 100, 100, 50, 0, 50], atol=1e-12)
    np.testing.assert_allclose(force.imag, -force.real / 2, atol=1e-12)
    np.testing.assert_array_equal(forces.at(np.array([2.25])), force[1:2])


def test_intermittent_forces_come_and_go() -> None:
    forces = intermittent_forces(11)
    size = np.abs(forces.at(np.linspace(0, 40, 4001)))
    assert 0.1 < (size > 1).mean() < 0.8
    assert intermittent_forces(11) == forces != intermittent_forces(12)
    assert all(np.abs(intermittent_forces(seed).at(np.linspace(0, 40, 400))).max() > 10 for seed in range(30))


@pytest.mark.parametrize(
    ("push", "cycle", "message"),
    [
        ((-1.0, 1.0, (1.0, 1.0)), 10.0, "start must not be negative"),
        ((1.0, 0.1, (1.0, 1.0)), 10.0, "twice the rise"),
        ((9.5, 1.0, (1.0, 1.0)), 10.0, "ends after the cycle of 10.0 s"),
    ],
)
def test_impossible_pushes_are_refused(
    push: tuple[float, float, tuple[float, float]], cycle: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Forces((Push(*push),), cycle)


def test_temperature_settles() -> None:
    temperature = TemperatureCourse(start=20.0, rise=2.0, settling=10.0).at(np.array([-5.0, 0.0, 10.0, 1e4]))
    np.testing.assert_allclose(temperature, [20, 20, 22 - 2 / np.e, 22], rtol=0, atol=1e-12)
    swinging = TemperatureCourse(rise=0.0, swing=0.5, period=100.0).at(np.array([25.0, 75.0]))
    np.testing.assert_allclose(swinging, [20.5, 19.5], rtol=0, atol=1e-12)
