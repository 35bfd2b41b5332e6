"""A slow drift of the probe is learnt as noise; what a fault could be is not."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.machine.drift import learn_drift

POSES = 100


def learnt(seed, drifting):
    draw = np.random.default_rng(seed)
    others = draw.normal(size=(3 * POSES, 30))
    white = draw.normal(size=(3, POSES)) + drifting(draw)
    return learn_drift(white.ravel(), np.ones(POSES, bool), np.zeros((3 * POSES, 0)), others), others


def walk(draw):
    steps = draw.normal(size=(3, POSES))
    return 3.0 * np.cumsum(steps, axis=1) / np.sqrt(POSES)


def step(draw):
    return np.where(np.arange(POSES) >= draw.integers(20, 80), 3.0, 0.0) * draw.choice([-1.0, 1.0], (3, 1))


def test_white_noise_does_not_drift():
    assert sum(learnt(seed, lambda draw: 0.0)[0].shape[1] > 0 for seed in range(100)) <= 2


def test_a_random_walk_is_learnt_with_its_size():
    sizes = []
    for seed in range(40):
        drift, _ = learnt(seed, walk)
        sizes.append(float(np.sqrt(np.mean(np.sum(np.square(drift), axis=1)))))
    assert np.mean(np.array(sizes) > 0) >= 0.9
    assert 0.5 < np.median(sizes) / (3.0 / np.sqrt(2)) < 2.0


def test_a_step_is_a_fault_and_no_drift():
    assert sum(learnt(seed, step)[0].shape[1] > 0 for seed in range(40)) <= 2


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_what_a_machine_may_do_is_no_drift(size):
    found = 0
    for seed in range(40):
        draw = np.random.default_rng(seed)
        slow = np.tile(np.linspace(-1.0, 1.0, POSES), 3)[:, None]
        white = draw.normal(size=3 * POSES) + size * slow[:, 0]
        found += learn_drift(white, np.ones(POSES, bool), np.zeros((3 * POSES, 0)), slow).shape[1] > 0
    assert found <= 2
