"""A course behind noisy readings in steps, against courses that are known."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.smooth_course import smooth_course

COUNT, LOUDEST = 240, 0.5
PASSED = np.arange(COUNT) / COUNT
UNREAD = np.abs(PASSED - 0.4) < 0.05


def course_of(draw):
    """A temperature of a shop over some hours."""
    turns = draw.uniform(0.3, 1.5) * PASSED + draw.uniform()
    return 20 + draw.uniform(-3, 3) + draw.uniform(1, 5) * np.sin(2 * np.pi * turns)


READ = {
    "little noise": (lambda true, draw: true + 0.02 * draw.normal(size=COUNT), 0.4, 0.0),
    "much noise": (lambda true, draw: true + 0.3 * draw.normal(size=COUNT), 0.4, 0.0),
    "steps": (lambda true, draw: np.rint(2 * true) / 2, 0.5, 0.25),
    "steps, cut off": (lambda true, draw: np.floor(true), 1.1, 0.5),
    "steps and noise": (lambda true, draw: np.rint(true + 0.3 * draw.normal(size=COUNT)), 0.6, 0.5),
    "not all": (lambda true, draw: np.where(UNREAD, np.nan, true + 0.1 * draw.normal(size=COUNT)), 0.5, 0.0),
}
"""How a course is read, which part of the error of readings may be left in the mean, and half a step."""


@pytest.mark.parametrize("way", READ)
def test_a_course_is_nearer_than_its_readings_and_as_wrong_as_it_is_said_to_be(way):
    read, part, half = READ[way]
    errors, raw, stated = [], [], []
    for seed in range(20):
        draw = np.random.default_rng(seed)
        true = course_of(draw)
        readings = read(true, draw)
        found = smooth_course(readings, LOUDEST)
        errors.append(found.values - true)
        raw.append(readings - true)
        stated.append(np.sum(np.square(found.ways()), axis=1))
    assert np.sqrt(np.mean(np.square(errors))) < part * np.sqrt(np.nanmean(np.square(raw)))
    assert np.mean(np.square(errors) / stated) < 1.5
    assert np.sqrt(np.mean(stated)) < 1.5 * np.hypot(np.sqrt(np.nanmean(np.square(raw))), half)


def test_readings_that_are_elsewhere_each_time_are_no_noise_of_an_instrument():
    """Of a machine that is measured once a day."""
    for seed in range(10):
        readings = 20 + 4 * np.random.default_rng(seed).normal(size=COUNT)
        found = smooth_course(readings, LOUDEST)
        assert np.sqrt(np.mean(np.square(found.values - readings))) < LOUDEST


@pytest.mark.parametrize(
    "readings", [np.full(50, 20.0), 20 + 0.1 * np.arange(50.0), np.array([20.0, np.nan, 21.0, 21.5])]
)
def test_readings_on_a_line_are_the_course(readings):
    found = smooth_course(readings, LOUDEST)
    seen = np.isfinite(readings)
    np.testing.assert_allclose(found.values[seen], readings[seen], atol=1e-6)
    assert np.all(np.isfinite(found.ways()))


def test_of_many_readings_the_ways_are_those_of_few():
    """By the Lanczos method: the variance of the course, against all eigenvectors at once."""
    draw = np.random.default_rng(4)
    true = 20 + 3 * np.sin(np.linspace(0, 7, 1200))
    found = smooth_course(true + 0.1 * draw.normal(size=1200), LOUDEST)
    expected = np.zeros(1200)
    for spline in found.splines:
        covariance = np.zeros((1200, 1200))
        for below, diagonal in enumerate(spline.precision):
            covariance += np.diag(diagonal[: 1200 - below], -below)
            covariance += np.diag(diagonal[: 1200 - below], below) if below else 0.0
        own = spline.variance * np.diag(np.linalg.inv(covariance))
        expected += spline.weight * (own + np.square(spline.values - found.values))
    np.testing.assert_allclose(np.sum(np.square(found.ways()), axis=1), expected, rtol=0.02)


@pytest.mark.parametrize("step", [0.1, 0.25, 0.5, 1.0])
def test_a_course_that_a_few_steps_fit_as_a_line_may_be_a_curve(step):
    """A stage that warms up over 20 s: each way in which it is said to be open is at least as open as it is."""
    squares = np.zeros(8)
    for seed in range(100):
        draw, passed = np.random.default_rng(seed), np.arange(100) / 100
        true = 20 + draw.uniform(-0.5, 0.5) + draw.uniform(1, 4) * -np.expm1(-passed / draw.uniform(0.2, 0.75))
        found = smooth_course(np.rint((true + 0.02 * draw.normal(size=100)) / step) * step, LOUDEST)
        ways = found.ways()[:, 1 : 1 + len(squares)]
        sizes = np.linalg.norm(ways, axis=0)
        squares += np.square((ways / sizes**2).T @ (found.values - true)) / 100
    assert np.all(squares < 1.5)
