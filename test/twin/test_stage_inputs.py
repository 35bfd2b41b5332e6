"""What drives the twin of a stage: forces of a noisy load cell."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import stage_inputs

TIME = np.arange(0.0, 40.0, 0.01)


def inputs(force):
    command = SignalStream(TIME, np.zeros((len(TIME), 2)))
    return stage_inputs(StageRecording(0, {"command": command, "force": SignalStream(TIME, force)}), 20.0)


@pytest.mark.parametrize("seed", range(20))
def test_the_noise_of_a_load_cell_is_no_force(seed):
    noise = 0.2 * np.random.default_rng(seed).normal(size=(len(TIME), 2))
    assert not inputs(noise).force(TIME).any()


def test_a_push_stays_as_it_was_measured():
    noise = 0.2 * np.random.default_rng(1).normal(size=(len(TIME), 2))
    push = 80.0 * np.exp(-0.5 * ((TIME - 20) / 0.5) ** 2)[:, None] * np.array([1.0, -0.3])
    measured = push + noise
    found = inputs(measured).force(TIME)
    pushed = np.abs(push).max(axis=1) > 0.5
    np.testing.assert_allclose(found[pushed], measured[pushed], atol=1e-12)
    assert not found[np.abs(TIME - 20) > 5].any()
    between = np.linspace(0.0, 39.99, 12_345)
    assert not inputs(measured).force(between)[np.abs(between - 20) > 5].any(), "a spline would ring for ever"


def test_without_a_load_cell_no_force_acts():
    command = SignalStream(TIME, np.zeros((len(TIME), 2)))
    assert not stage_inputs(StageRecording(0, {"command": command}), 20.0).force(TIME).any()
