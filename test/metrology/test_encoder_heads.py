"""Heads on a ring against the paper's closed forms and the contract's formula written out."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, estimate_ring_pose

RADIUS = 0.1
FOUR = (0.0, np.pi, np.pi / 2, 3 * np.pi / 2)


def readings(theta, x, y, azimuths):
    return np.stack([theta + (-x * np.sin(phi) + y * np.cos(phi)) / RADIUS for phi in azimuths], axis=1)


@pytest.mark.parametrize(
    "azimuths",
    [FOUR, FOUR[:3], (0.0, 2.0, 4.0), (0.1, 1.3, 2.9, 3.6, 5.5, 6.0)],
    ids=["four", "three", "even three", "six"],
)
def test_three_or_more_heads_give_all_components(azimuths):
    generator = np.random.default_rng(1)
    theta, x, y = generator.uniform(-50, 50, 300), *generator.uniform(-2e-5, 2e-5, (2, 300))
    layout = HeadLayout(azimuths)
    pose = estimate_ring_pose(layout, RADIUS, readings(theta, x, y, azimuths), np.full((300, len(azimuths)), 1e-12))
    assert layout.observable == ("theta", "x", "y")
    np.testing.assert_allclose(pose.theta, theta, atol=1e-12)
    np.testing.assert_allclose(pose.centre, np.stack([x, y], 1), atol=2e-12)  # tan against the linear formula


def test_opposed_pairs_follow_equation_3():
    a, b, c, d = (np.array([value]) for value in (1.0002, 0.9999, 1.0001, 0.9997))
    pose = estimate_ring_pose(HeadLayout(FOUR), RADIUS, np.stack([a, b, c, d], 1), np.ones((1, 4)))
    assert pose.centre[0, 1] == pytest.approx(RADIUS * np.tan((a[0] - b[0]) / 2), abs=1e-18)
    assert pose.centre[0, 0] == pytest.approx(RADIUS * np.tan((d[0] - c[0]) / 2), abs=1e-18)
    assert pose.theta[0] == pytest.approx(np.mean([a, b, c, d]), abs=1e-15)


@pytest.mark.parametrize(("pair", "component"), [((0.0, np.pi), "y"), ((np.pi / 2, 3 * np.pi / 2), "x")])
def test_two_opposed_heads_give_one_component(pair, component):
    layout = HeadLayout(pair)
    assert layout.observable == ("theta", component)
    assert layout.redundancy == 0
    theta, x, y = np.array([0.7]), np.array([4e-6]), np.array([-7e-6])
    pose = estimate_ring_pose(layout, RADIUS, readings(theta, x, y, pair), np.full((1, 2), 1e-12))
    np.testing.assert_allclose(pose.theta, theta, atol=1e-13)
    expected = [4e-6, 0.0] if component == "x" else [0.0, -7e-6]
    np.testing.assert_allclose(pose.centre[0], expected, atol=1e-13)


def test_two_heads_at_a_right_angle_tell_nothing_apart():
    assert HeadLayout((0.0, np.pi / 2)).observable == ()


def test_no_head_is_refused():
    with pytest.raises(InputError, match="no read head; at least 1"):
        HeadLayout(())


def test_one_head_tells_rotation_and_displacement_as_one_number():
    layout = HeadLayout((0.4,))
    assert (layout.observable, layout.redundancy, layout.tells_rotation) == ((), 0, False)
    theta, x, y = np.array([0.7]), np.array([4e-6]), np.array([-7e-6])
    pose = estimate_ring_pose(layout, RADIUS, readings(theta, x, y, (0.4,)), np.full((1, 1), 1e-12))
    mixed = layout.mixed @ np.array([4e-6, -7e-6]) / RADIUS
    np.testing.assert_allclose(pose.theta, theta + mixed, atol=1e-12)
    assert not pose.centre.any() and not pose.seen.any()
    np.testing.assert_allclose(pose.covariance[0], np.diag([1e-12, 0.0, 0.0]))


def test_graduation_orders_that_four_heads_cannot_see():
    layout = HeadLayout(FOUR)
    hidden = layout.hidden_orders(12)
    assert hidden == (1, 3, 4, 5, 7, 8, 9, 11, 12)  # odd ones pass for radial motion, 4k for rotation
    views = {view.order: view for view in layout.graduation_view(range(1, 9))}
    assert views[4].as_rotation == pytest.approx(1.0)
    assert views[4].as_radial == pytest.approx(0.0, abs=1e-12)
    assert views[3].as_rotation == pytest.approx(0.0, abs=1e-12)
    assert views[3].as_radial == pytest.approx(1.0)
    assert (views[2].seen, views[2].as_rotation) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-12))


def test_covariance_is_that_of_many_trials():
    generator = np.random.default_rng(3)
    azimuths, std, trials = (0.0, 2.0, 4.4), np.array([3e-7, 6e-7, 4e-7]), 40_000
    noisy = (
        readings(np.zeros(trials), np.zeros(trials), np.zeros(trials), azimuths)
        + generator.normal(size=(trials, 3)) * std
    )
    pose = estimate_ring_pose(HeadLayout(azimuths), RADIUS, noisy, np.tile(std**2, (trials, 1)))
    found = np.cov(np.column_stack([pose.theta, pose.centre]).T)
    scale = np.sqrt(np.diag(pose.covariance[0]))
    np.testing.assert_allclose(found / np.outer(scale, scale), pose.covariance[0] / np.outer(scale, scale), atol=0.03)


def test_heads_that_count_different_turns_agree():
    theta = np.linspace(0, 20, 50)
    shifted = readings(theta, theta * 0, theta * 0 + 1e-5, FOUR) + 2 * np.pi * np.array([0, 3, -7, 1])
    pose = estimate_ring_pose(HeadLayout(FOUR), RADIUS, shifted, np.full((50, 4), 1e-12))
    np.testing.assert_allclose(pose.theta, theta, atol=1e-12)
    np.testing.assert_allclose(pose.centre[:, 1], 1e-5, atol=1e-11)


def test_a_head_that_slips_shows_as_disagreement():
    theta = np.linspace(0, 20, 50)
    clean = readings(theta, theta * 0, theta * 0, FOUR)
    slipped = clean + np.array([0, 0, 0, 2e-5])
    variances = np.full((50, 4), (1e-6) ** 2)
    assert estimate_ring_pose(HeadLayout(FOUR), RADIUS, clean, variances).disagreement.max() < 1e-6
    # A + B - C - D changes by the slip, a quarter of it is each head's residual: chi-square (slip / 2 sigma)²
    np.testing.assert_allclose(
        estimate_ring_pose(HeadLayout(FOUR), RADIUS, slipped, variances).disagreement, 2e-5 / 2e-6, rtol=1e-9
    )


def test_disagreement_of_noise_is_one():
    generator = np.random.default_rng(8)
    azimuths = (0.0, 1.0, 2.1, 3.2, 4.4, 5.3)
    noise = generator.normal(size=(20_000, 6)) * 1e-6
    layout = HeadLayout(azimuths)
    pose = estimate_ring_pose(layout, RADIUS, noise, np.full((20_000, 6), 1e-12))
    assert layout.redundancy == 3
    assert np.mean(pose.disagreement**2) == pytest.approx(1.0, abs=0.02)
