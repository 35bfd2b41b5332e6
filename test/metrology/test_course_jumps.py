"""Jumps of thermometers against courses without and with one, whose size and moment are known."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.thermometer_course import ThermometerCourse, thermometer_jumps

TIME = np.arange(0.0, 40.0, 0.2)


def drawn(seed, steps, noises):
    """Function that reads a temperature, and a stage that warms by 1 to 3.5 K and swings."""
    draw = np.random.default_rng(seed)
    step, noise = draw.choice(steps), draw.choice(noises) * draw.normal(size=len(TIME))
    warm = 20.0 + draw.uniform(1.0, 3.5) * (1 - np.exp(-TIME / draw.uniform(8.0, 40.0)))
    warm += draw.uniform(0.0, 0.2) * np.sin(2 * np.pi * TIME / draw.uniform(6.0, 40.0))

    def read(temperature):
        shown = temperature + noise
        return np.rint(shown / step) * step if step else shown

    return warm, read, draw


def test_a_stage_that_warms_has_none():
    """Also by steps of half a degree, or with noise of a tenth."""
    found = [drawn(seed, (0.0, 0.01, 0.1, 0.25, 0.5), (0.0, 0.002, 0.015, 0.1)) for seed in range(200)]
    assert not any(thermometer_jumps(TIME, read(warm)) for warm, read, _ in found)


def test_a_jump_is_found_with_its_size_and_moment():
    """Within four standard uncertainties of the size, and between the samples on either side; from ten steps on."""
    for seed in range(40):
        step = (0.0, 0.01, 0.1)[seed % 3]
        warm, read, draw = drawn(seed, (step,), (0.005, 0.02))
        size, moment = draw.choice([-1, 1]) * draw.uniform(max(0.5, 10 * step), 2.0), draw.uniform(3.0, 37.0)
        (jump,) = thermometer_jumps(TIME, read(warm + size * (moment < TIME)))
        assert abs(jump.size - size) < 4 * jump.std < 0.8
        assert abs(jump.moment - moment) <= 0.1 + 1e-9


@pytest.mark.parametrize("size", [1.0, -262.0])
def test_one_that_comes_back_leaves_the_course_where_it_was(size):
    """A plug that is open for 2 s: -242 °C."""
    for seed in range(10):
        warm, read, draw = drawn(seed, (0.0, 0.01), (0.015,))
        begin = draw.uniform(5.0, 30.0)
        course = ThermometerCourse.of(TIME, read(warm + size * ((begin < TIME) & (begin + 2.0 > TIME))))
        assert len(course.jumps) == 2
        assert np.abs(course.at(TIME) - warm).max() < 0.1


def test_which_side_of_a_jump_is_right_is_not_known():
    """Its half either way joins the zero of the thermometer; a further way is its size."""
    warm, read, _ = drawn(3, (0.0,), (0.015,))
    plain, jumping = (ThermometerCourse.of(TIME, read(warm + each)) for each in (0.0 * TIME, 1.0 * (TIME > 15.0)))
    (jump,) = jumping.jumps
    assert np.abs(jumping.at(TIME) - jump.size / 2 - plain.at(TIME)).max() < 0.05
    (_, zero), *_, (at, size) = jumping.ways(0.2, 8)
    np.testing.assert_allclose(zero, np.hypot(0.2, jump.size / 2))
    assert np.interp(35.0, at, size) - np.interp(5.0, at, size) == pytest.approx(jump.std)
    assert len(list(plain.ways(0.2, 8))) == 9 == len(list(jumping.ways(0.2, 8))) - 1


def test_of_what_noise_leaves_open_all_counts_that_is_as_large_as_asked_for():
    warm, read, _ = drawn(5, (0.0,), (0.015,))
    course = ThermometerCourse.of(TIME, read(warm))
    sizes = [float(np.sqrt(np.mean(way**2))) for _, way in course.ways(0.2, 2, 0.0)]
    assert sizes[0] == pytest.approx(0.2, rel=0.05) and sizes[1:] == sorted(sizes[1:], reverse=True)
    for many in (1, 5, 12):
        found = [float(np.sqrt(np.mean(way**2))) for _, way in course.ways(0.2, 2, (1 - 1e-9) * sizes[many])]
        assert found == sizes[: max(many, 2) + 1]


def test_what_was_not_read_may_have_changed():
    """Of one read every 2 s, or not at all for 8 s, a change by 1 K is none."""
    warm, read, _ = drawn(4, (0.0,), (0.015,))
    shown = read(warm + 1.0 * (TIME > 20.0))
    assert not thermometer_jumps(TIME[::10], shown[::10])
    kept = (TIME < 16.0) | (TIME > 24.0)
    assert not thermometer_jumps(TIME[kept], shown[kept])
