"""Rows of the heads are free of what the rotor really does, although the heads sample at different moments."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import twin_of


@pytest.fixture
def recorded():
    case = make_stage_case(2, "null", duration=10.0)
    recording = record_stage({samples_topic(s): list(blocks) for s, blocks in case.blocks.items()}, "abcd")
    twin = twin_of(case.twin, recording)
    residual = {name: recording.streams[name].values - values for name, values in twin.predict().items()}
    return recording, StageNoise(case.twin, recording, residual)


def test_a_swing_that_all_heads_see_leaves_nothing_in_their_differences(recorded):
    recording, noise = recorded
    # 2 µrad at 12 Hz; two heads of one row sample up to 0.36 ms apart.
    swing = {
        name: 2e-6 * np.sin(2 * np.pi * 12.0 * recording.streams[name].time)[:, None, None] for name in recording.heads
    }
    rows = noise.whiten(swing)
    apart = max(
        abs(float(np.mean(recording.streams[name].time - recording.streams["head_a"].time))) for name in recording.heads
    )
    assert apart > 3e-4
    seen = 2e-6 * 2 * np.pi * 12.0 * apart / 2 / noise.std["head"]
    assert seen > 0.02, "without account of the moments this much would be left"
    # rows without two whole neighbours do not tell the rate: the first, the last, those beside a turning point
    whole = np.all([noise.expected()[name] > 0.7 for name in recording.heads], axis=0)
    inner = np.flatnonzero(whole[2:] & whole[1:-1] & whole[:-2]) + 1
    assert len(inner) > 0.95 * len(whole)
    for name in recording.heads:
        assert np.abs(rows[name][inner]).max() < 0.05 * seen


def test_what_one_head_alone_does_stays_its_own(recorded):
    recording, noise = recorded
    wave = np.sin(2 * np.pi * 3.0 * recording.streams["head_b"].time)[:, None, None]
    rows = noise.whiten({"head_b": noise.std["head"] * wave})
    assert np.abs(rows["head_b"]).max() == pytest.approx(0.75, abs=0.01)
    for name in ("head_a", "head_c", "head_d"):
        assert np.abs(rows[name]).max() == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_the_rotors_jitter_is_told_from_the_noise_of_four_heads(recorded, seed):
    """Waves of random phases with the jitter's spectrum, and its error by Wiener's closed form."""
    recording, noise = recorded
    rng, time, grid = np.random.default_rng(seed), noise.grid.time, noise.grid
    frequency = np.arange(1, 400) * 0.05
    density = noise.jitter.density(frequency)
    phases, sizes = rng.uniform(0, 2 * np.pi, len(frequency)), np.sqrt(2 * density * 0.05)

    def rotor(at):
        return np.cos(2 * np.pi * np.outer(at, frequency) + phases) @ sizes

    heads = {name: recording.streams[name].time for name in recording.heads}
    seen = {name: (rotor(at) + noise.std["head"] * rng.normal(size=len(at)))[:, None] for name, at in heads.items()}
    off = (noise.jitter_of(seen) - rotor(time))[200:-200]
    left = np.sqrt(np.sum(0.05 * density * noise.command_floor / (density + noise.command_floor)))
    assert np.sqrt(np.mean(off**2)) < 1.3 * left + 1e-9
    assert left < 0.5 * noise.std["head"] / np.sqrt(len(grid.heads)), "readings alone tell it less well"
