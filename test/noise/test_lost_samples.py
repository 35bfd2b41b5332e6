"""Where a command that is interpolated between its samples cannot be believed, against commands in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from rotary_error_monitor.noise.lost_samples import between_samples
from rotary_error_monitor.plant.motion import Motion, Segment
from rotary_error_monitor.twin.recording import Stream

PERIOD, LEAST = 0.004, 3e-7


def sampled(course):
    time = PERIOD * np.arange(2000)
    return Stream(time, np.stack(course(time), axis=1))


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
    brisk = Motion(tuple(Segment(0.8, float(speed)) for speed in draw.uniform(-2, 2, 10)), 10 ** draw.uniform(1, 2.5))
    for course in (*kinks, brisk.at):
        command = sampled(course)
        left_out = between_samples(command, time, LEAST)
        assert off(course, command, time)[~left_out].max() < 1.5 * LEAST


def test_a_smooth_ramp_of_many_samples_is_believed():
    course = Motion((Segment(1.0, 6.0), Segment(1.0, -6.0)), 60.0).at
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
