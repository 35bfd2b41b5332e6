"""What goes with the speed, against closed forms and against chance."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.pipeline.speed_slope import SpeedSlope


def filled(slope: SpeedSlope, theta: np.ndarray, speed: np.ndarray, *values: np.ndarray) -> SpeedSlope:
    for row in zip(theta, speed, *values, strict=True):
        slope.add(*map(float, row))
    slope.measure()
    return slope


def swing(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle and speed of a rotor that swings through a radian, 1 rad/s at most."""
    time = 0.01 * np.arange(count)
    return np.sin(time), np.cos(time)


def test_a_delay_is_found_beside_orders_of_the_rotation():
    theta, speed = swing(1000)
    for delay in (-3e-4, 2e-5):
        value = 1e-6 + 5e-6 * np.cos(theta) - 2e-6 * np.sin(2 * theta) + delay * speed
        slope = filled(SpeedSlope(1000, 2, orders=3), theta, speed, value, np.zeros(1000))
        np.testing.assert_allclose(slope.value, [delay, 0.0], rtol=1e-6)
        np.testing.assert_allclose(slope.length, abs(delay), rtol=1e-6)


def test_noise_shows_none():
    """White or of the jitter's kind, slow over ten windows: of a thousand series none."""
    generator = np.random.default_rng(5)
    theta, speed = swing(600)
    kernel = np.ones(10) / 10
    found = 0
    for number in range(1000):
        noise = generator.normal(size=609)
        noise = np.convolve(noise, kernel, "valid") if number % 2 else noise[:600]
        found += filled(SpeedSlope(1000), theta, speed, noise).length > 0.0
    assert found == 0


def test_what_was_seen_holds_at_constant_speed_and_goes_when_it_is_contradicted():
    generator = np.random.default_rng(7)
    theta, speed = swing(600)
    noise = 1e-6 * generator.normal(size=600)
    slope = filled(SpeedSlope(600), theta, speed, 1e-4 * speed + noise)
    np.testing.assert_allclose(slope.value, [1e-4], rtol=0.02)
    seen = slope.value.copy()
    slope.forget()
    np.testing.assert_array_equal(filled(slope, theta, np.ones(600), 1e-4 + noise).value, seen)
    jittering = np.ones(600) + 1e-4 * generator.normal(size=600)
    np.testing.assert_array_equal(filled(slope, theta, jittering, 1e-4 + noise).value, seen)
    np.testing.assert_array_equal(filled(slope, theta, speed, noise).value, [0.0])
