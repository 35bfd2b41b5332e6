"""Assembly errors, heights and variances against the contract's formulas written out."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator, Turbulence
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology import error_motion as motion
from rotary_error_monitor.metrology.tilt import check_saturation, tilt_from_quadrants

THETA = np.linspace(-7.0, 9.0, 200)


def test_graduation_is_removed_from_each_head():
    rows = (AngularHarmonic(2, 3e-6, -1e-6), AngularHarmonic(5, 0.0, 2e-6))
    phi = 1.1
    psi = phi - THETA
    reading = THETA + 3e-6 * np.cos(2 * psi) - 1e-6 * np.sin(2 * psi) + 2e-6 * np.sin(5 * psi)
    encoder = Encoder(0.1, 100, 1, 0.0, {"a": phi, "b": 3.0}, graduation=rows)
    found = motion.remove_graduation(reading[:, None], np.array([phi]), encoder)[:, 0]
    np.testing.assert_allclose(found, THETA, atol=1e-10)


def test_eccentricity_and_mirror_turn_with_the_rotor():
    encoder = Encoder(0.1, 100, 1, 0.0, {"a": 0.0, "b": 3.0}, eccentricity=(3e-5, -1e-5))
    turned = [
        3e-5 * np.cos(THETA) + 1e-5 * np.sin(THETA),
        3e-5 * np.sin(THETA) - 1e-5 * np.cos(THETA),
    ]
    left = motion.remove_eccentricity(np.stack(turned, 1) + [2e-6, 5e-6], THETA, encoder)
    np.testing.assert_allclose(left, np.broadcast_to([2e-6, 5e-6], (200, 2)), atol=1e-18)
    mirror = Mirror((7e-5, 2e-5), (PlanarHarmonic(2, (6e-6, 1e-6), (-2e-6, 4e-6)),))
    seen = np.stack(
        [
            7e-5 * np.cos(THETA) - 2e-5 * np.sin(THETA) + 6e-6 * np.cos(2 * THETA) + 1e-6 * np.sin(2 * THETA),
            7e-5 * np.sin(THETA) + 2e-5 * np.cos(THETA) - 2e-6 * np.cos(2 * THETA) + 4e-6 * np.sin(2 * THETA),
        ],
        1,
    )
    np.testing.assert_allclose(motion.remove_mirror(seen, THETA, mirror), 0.0, atol=1e-18)


def test_radial_error_motion_at_a_height_follows_equation_7():
    components = np.array([[1e-6, -2e-6, 0.0, 1e-5, 2e-5, 0.0]])
    at = motion.radial_error_motion_at(components, 0.06)
    np.testing.assert_allclose(at, [[1e-6 + 0.06 * 2e-5, -2e-6 - 0.06 * 1e-5]], rtol=1e-9)
    covariance = np.diag([1.0, 4.0, 0.0, 9.0, 16.0, 0.0])[None]
    np.testing.assert_allclose(motion.radial_covariance_at(covariance, 0.5)[0], [[1 + 0.25 * 16, 0], [0, 4 + 0.25 * 9]])


@pytest.mark.parametrize("speed", [0.0, 1e-7, 1.137e-4], ids=["at rest", "creeping", "turning"])
def test_variance_of_a_rounded_reading(speed):
    """Mean square error of an average of 45 rounded samples over many starting points within a step."""
    generator = np.random.default_rng(2)
    resolution, noise, count = 2e-6, 3e-7, 45
    start = generator.uniform(0, resolution, (4000, 1))
    true = start + speed * np.arange(count)
    read = np.rint((true + generator.normal(size=true.shape) * noise) / resolution) * resolution
    error = (read - true).mean(axis=1)
    gain = np.array([1 / count])
    predicted = motion.reading_variance(noise, resolution, gain, np.array([speed * count]))
    assert 0.5 < np.mean(error**2) / predicted[0] < 1.6


def test_turbulence_is_not_averaged():
    still = Autocollimator(5e-4, 5e-7, 5e-7)
    restless = Autocollimator(5e-4, 5e-7, 5e-7, Turbulence(4e-7, 0.3))
    shape = np.array([0.05]), np.array([1e-6]), np.array([1e-6])
    extra = motion.tilt_variance(restless, *shape) - motion.tilt_variance(still, *shape)
    np.testing.assert_allclose(extra, (4e-7) ** 2)


@pytest.mark.parametrize("resolution", [0.0, 1e-12, 1e-7])
def test_each_component_has_its_variance_with_and_without_steps(resolution):
    gain, travel = np.array([[0.1], [0.2], [0.3]]), np.zeros((3, 2))
    found = motion.reading_variance(1e-6, resolution, gain, travel)
    assert found.shape == (3, 2)
    np.testing.assert_allclose(found[:, 0], found[:, 1])
    assert np.all(found >= gain * 1e-12)


def test_quadrants_give_the_tilt_whatever_the_light():
    dark = np.array([0.01, 0.02, 0.0, 0.01])
    tilt = np.array([[1e-4, -2e-4], [0.0, 3e-4]])
    sensitivity = 2e-3
    x, y = tilt[:, 1] / sensitivity, -tilt[:, 0] / sensitivity
    power = np.array([[1.0], [0.3]])
    quadrants = power / 4 * np.stack([1 + x + y, 1 - x + y, 1 - x - y, 1 + x - y], 1) + dark
    np.testing.assert_allclose(tilt_from_quadrants(quadrants, sensitivity, dark), tilt, atol=1e-18)


def test_no_light_is_refused():
    with pytest.raises(InputError, match="sample 1 hold no light"):
        tilt_from_quadrants(np.array([[1.0, 1, 1, 1], [0.1, 0.1, 0.1, 0.1]]), 1e-3, np.full(4, 0.1))


def test_the_end_of_the_range_is_saturated():
    instrument = Autocollimator(5e-4, 1e-6, 1e-6)
    tilt = np.array([[0.0, 0.0], [5e-4, 0.0], [0.0, -4.999e-4], [4.9e-4, 4.9e-4]])
    np.testing.assert_array_equal(check_saturation(tilt, instrument), [False, True, True, False])
