"""Zero, eccentricity and height of a reference, against what was put into differences by closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rotary_error_monitor.metrology.reference_fit import fit_reference

TURNS, PER_TURN = 6, 300


def drawn(seed, directions, colour=0.9):
    """Angles, both ways; what was put in; the difference with coloured noise; lever, group and turn of each sample."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 2 * np.pi * TURNS, TURNS * PER_TURN, endpoint=False)
    theta = np.concatenate([angle, angle[::-1]])
    group, turn = np.repeat([0, 1], len(angle)), np.repeat(np.arange(2 * TURNS), PER_TURN)
    eccentricity, higher, zeros = 1e-5 * rng.normal(size=2), 0.01 * rng.normal(), 1e-6 * rng.normal(size=(2, 2))
    waves = 1e-5 * rng.normal(size=(3, 2, 2))
    lever = sum(np.cos(k * theta)[:, None] * w[0] + np.sin(k * theta)[:, None] * w[1] for k, w in enumerate(waves, 1))
    cos, sin = np.cos(theta), np.sin(theta)
    turned = np.stack([cos * eccentricity[0] - sin * eccentricity[1], sin * eccentricity[0] + cos * eccentricity[1]], 1)
    noise = lfilter(
        [np.sqrt(1 - colour**2)], [1, -colour], 5e-8 * rng.normal(size=(len(theta), len(directions))), axis=0
    )
    zero = zeros[group] @ directions.T
    return theta, (eccentricity, higher, zeros), zero, turned, lever, group, turn, noise


@pytest.mark.parametrize("directions", [np.eye(2), np.array([[0.6, 0.8]])], ids=["two axes", "one"])
def test_what_was_put_in_is_inside_the_uncertainty_that_the_turns_show(directions):
    inside, higher = [], []
    for seed in range(100):
        theta, (eccentricity, raised, _), zero, turned, lever, group, turn, noise = drawn(seed, directions)
        seen = zero + (turned + raised * lever) @ directions.T + noise
        fit = fit_reference(theta, seen, lever, directions, group, turn)
        higher.append(abs(fit.higher - raised) <= 2 * fit.higher_std)
        fit = fit_reference(theta, zero + turned @ directions.T + noise, lever, directions, group, turn)
        inside += (np.abs(fit.eccentricity - eccentricity) <= 2 * np.sqrt(np.diag(fit.covariance))).tolist()
        assert fit.left.std() == pytest.approx(noise.std(), rel=0.1)
    assert np.mean(inside) >= 0.92 and np.mean(higher) >= 0.91


def test_without_noise_all_is_exact():
    directions = np.eye(2)
    theta, (eccentricity, raised, zeros), zero, turned, lever, group, turn, _ = drawn(0, directions)
    fit = fit_reference(theta, zero + turned, lever, directions, group, turn)
    assert fit.eccentricity == pytest.approx(eccentricity, abs=1e-15)
    assert fit.zeros == pytest.approx(zeros, abs=1e-15) and np.abs(fit.left).max() < 1e-15
    both = fit_reference(theta, zero + turned + raised * lever, lever, directions, group, turn)
    assert both.higher == pytest.approx(raised, abs=1e-9) and both.joint == pytest.approx(eccentricity, abs=1e-13)


def test_where_nothing_leans_no_height_is_told():
    directions = np.eye(2)
    theta, (eccentricity, *_), zero, turned, lever, group, turn, noise = drawn(1, directions)
    fit = fit_reference(theta, zero + turned + noise, 0.0 * lever, directions, group, turn)
    assert fit.higher == 0.0 and np.isinf(fit.higher_std) and fit.leaning == 0.0
    assert fit.eccentricity == pytest.approx(eccentricity, abs=2e-8)
