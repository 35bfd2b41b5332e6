"""The temperature behind a thermometer's samples, against courses that are known."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.thermometer_course import ThermometerCourse, class_b_uncertainty


def swinging(time):
    """0.2 K up and down in 8 s."""
    return 21.0 + 0.2 * np.sin(2 * np.pi * time / 8.0)


@pytest.mark.parametrize("period", [0.01, 0.2, 1.0])
def test_between_samples_it_is_what_was_there(period):
    """A straight line between samples of each second would miss 15 mK."""
    for seed in range(10):
        draw, time = np.random.default_rng(seed), np.arange(0.0, 30.0, period)
        sampled = np.sort(time + 0.2 * period * draw.uniform(-1, 1, len(time)))
        kept = draw.uniform(size=len(time)) > 0.05 * (period < 1.0)  # stamps are uneven, and some samples are lost
        read = swinging(sampled) + 1e-3 * draw.normal(size=len(time))
        found = ThermometerCourse.of(sampled[kept], read[kept])
        asked = np.linspace(sampled[kept][0] + period, sampled[kept][-1] - period, 1000)
        assert np.abs(found.at(asked) - swinging(asked)).max() < 6e-3


def test_of_one_or_two_samples_it_is_what_was_read():
    one = ThermometerCourse.of(np.array([3.0]), np.array([21.0]))
    np.testing.assert_array_equal(one.at(np.array([0.0, 9.0])), [21.0, 21.0])
    two = ThermometerCourse.of(np.array([0.0, 10.0]), np.array([21.0, 22.0]))
    np.testing.assert_allclose(two.at(np.array([-1.0, 5.0, 11.0])), [21.0, 21.5, 22.0])
    assert one.course.ways().shape == (1, 0) and two.course.ways(0.2).shape[0] == 2


def test_the_zero_of_a_thermometer_is_as_uncertain_as_its_class_allows():
    """IEC 60751, class B: 0.3 K at 0 °C, 0.8 K at 100 °C, anything within as likely."""
    assert class_b_uncertainty(0.0) * np.sqrt(3) == pytest.approx(0.3)
    assert class_b_uncertainty(100.0) * np.sqrt(3) == pytest.approx(0.8)
