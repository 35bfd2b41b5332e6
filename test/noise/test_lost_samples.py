"""Where a command that is interpolated between its samples cannot be believed, against commands in closed form."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from rotary_error_monitor.effects.rotor import AT_REST
from rotary_error_monitor.noise.head_grid import align_heads
from rotary_error_monitor.noise.lost_samples import apart_between_samples, between_samples, inside, turning_points
from rotary_error_monitor.plant.motion import Motion, MotionSegment
from rotary_error_monitor.twin.commanded import CommandCurve
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

PERIOD, LEAST = 0.004, 3e-7


def sampled(course):
    time = PERIOD * np.arange(2000)
    return SignalStream(time, np.stack(course(time), axis=1))


def off(course, command, time):
    spline = CubicHermiteSpline(command.time, command.values[:, 0], command.values[:, 1])
    return np.abs(spline(time) - course(time)[0])


def kinked(moment, change, acceleration):
    """Speed that changes at once at a moment, or begins to change with an acceleration that it has at once."""

    def course(time):
        after = np.maximum(time - moment, 0.0)
        angle = 0.5 * time + change * after + 0.5 * acceleration * np.square(after)
        return angle, 0.5 + (change + acceleration * after) * (time >= moment)

    return course


@pytest.mark.parametrize("seed", range(8))
def test_no_interval_is_missed_in_which_the_command_is_off(seed):
    draw = np.random.default_rng(seed)
    time = np.sort(draw.uniform(0.0, 7.9, 200_000))
    kinks = [kinked(draw.uniform(2, 6), draw.uniform(-1, 1), 0.0), kinked(draw.uniform(2, 6), 0.0, draw.uniform(5, 60))]
    brisk = Motion(
        tuple(MotionSegment(0.8, float(speed)) for speed in draw.uniform(-2, 2, 10)), 10 ** draw.uniform(1, 2.5)
    )
    for course in (*kinks, brisk.at):
        command = sampled(course)
        left_out = between_samples(command, time, LEAST)
        assert off(course, command, time)[~left_out].max() < 1.5 * LEAST


@pytest.mark.parametrize("seed", range(8))
def test_heads_that_sample_one_after_the_other_are_apart_where_the_command_is_off_at_some(seed):
    """What is not known of the command between its samples was a spike of one head, and then another's."""
    draw = np.random.default_rng([9, seed])
    courses = [kinked(draw.uniform(2, 6), 0.0, draw.uniform(5, 60)), kinked(draw.uniform(2, 6), draw.uniform(-1, 1), 0)]
    for course, spread in itertools.product(courses, (0.0, 1e-5, 1e-3, PERIOD)):
        command, late = sampled(course), spread * draw.uniform(-0.5, 0.5, 4)
        heads = {f"head_{letter}": np.arange(0.3, 7.7, PERIOD) + late[i] for i, letter in enumerate("abcd")}
        streams = {name: SignalStream(time, np.zeros((len(time), 1))) for name, time in heads.items()}
        grid = align_heads(StageRecording(0, {"command": command, **streams}, ()))
        spline = CubicHermiteSpline(command.time, command.values[:, 0], command.values[:, 1])
        missed = np.zeros(grid.present.shape)
        for i, (name, time) in enumerate(heads.items()):
            missed[grid.rows[name], i] = spline(time) - course(time)[0]
        apart = apart_between_samples(command, grid, heads, LEAST)
        assert np.ptp(missed[~apart & grid.present.all(axis=1)], axis=1).max() < 2 * LEAST
        assert apart.sum() <= (8 if spread else 0)


def test_a_smooth_ramp_of_many_samples_is_believed():
    course = Motion((MotionSegment(1.0, 6.0), MotionSegment(1.0, -6.0)), 60.0).at
    command = sampled(course)
    time = np.linspace(0.5, 7.5, 100_000)
    assert off(course, command, time).max() < LEAST
    assert not between_samples(command, time, LEAST).any()


@pytest.mark.parametrize("seed", range(4))
def test_speeds_that_are_noisy_throughout_are_no_jumps_but_a_jump_among_them_is(seed):
    """A driver may take its speed from differences of counts: what that does everywhere is noise, seen as such."""
    draw = np.random.default_rng(seed)
    command = sampled(kinked(3.0017, 0.3, 0.0))
    command.values[:, 1] += 3e-3 * draw.normal(size=len(command.time))
    middle = command.time[:-1] + PERIOD / 2
    lost = np.flatnonzero(between_samples(command, middle, LEAST))
    assert 750 in lost and len(lost) < 12


def test_a_jump_costs_the_intervals_around_it_alone():
    command = sampled(kinked(3.0017, 0.1, 0.0))
    lost = np.flatnonzero(between_samples(command, command.time + PERIOD / 2, LEAST))
    assert 750 in lost and np.ptp(lost) <= 7


@pytest.mark.parametrize("seed", range(6))
def test_where_the_direction_of_travel_is_not_known_is_left_out_and_nothing_else(seed):
    """Between the samples around a start, a stop or a reversal; elsewhere the cubic has the direction of the truth."""
    draw = np.random.default_rng(seed)
    speeds = draw.choice([-1.0, 1.0], 10) * draw.uniform(0.2, 2.0, 10)
    speeds[draw.integers(0, 10, 3)] = 0.0
    course = Motion(tuple(MotionSegment(draw.uniform(0.5, 0.8), float(speed)) for speed in speeds), 20.0)
    command, time = sampled(course.at), np.sort(draw.uniform(0.0, 7.9, 100_000))
    spans = turning_points(command)
    assert 0 < np.ptp(spans, axis=1).sum() < 0.02 * 7.9
    true = np.sign(np.where(np.abs(course.at(time)[1]) > AT_REST, course.at(time)[1], 0.0))
    rotation = CommandCurve(command.time, command.values[:, 0], command.values[:, 1])
    found = np.sign(np.where(np.abs(rotation.speed(time)) > AT_REST, rotation.speed(time), 0.0))
    wrong = (true != found) & ~inside(time, spans)
    assert not wrong.any(), time[wrong]


def test_a_command_that_dithers_at_rest_is_not_left_out():
    draw = np.random.default_rng(3)
    command = sampled(Motion((MotionSegment(1.0, 0.0), MotionSegment(1.0, 1.0)), 20.0).at)
    command.values[:, 1] += 1e-6 * draw.normal(size=len(command.time))
    assert len(turning_points(command)) == 0


@pytest.mark.parametrize("seed", range(5))
def test_spans_are_open_and_may_overlap(seed):
    draw = np.random.default_rng(seed)
    starts, time = draw.integers(0, 50, 12), np.arange(60.0)
    spans = np.stack([starts, starts + draw.integers(1, 9, 12)], axis=1).astype(float)
    expected = [any(a < at < b for a, b in spans) for at in time]
    np.testing.assert_array_equal(inside(time, spans), expected)
