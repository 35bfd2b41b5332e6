"""Rows of the heads are free of what the rotor really does, although the heads sample at different moments."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.noise.head_grid import align_heads
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.twin.recording import SignalStream, StageRecording, record_stage
from rotary_error_monitor.twin.stage import twin_of


@pytest.fixture
def recorded():
    case = make_stage_case(2, "null", duration=10.0)
    recording = record_stage({s: list(blocks) for s, blocks in case.blocks.items()}, "abcd")
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


@pytest.mark.parametrize("lost", [(), (5,), (0, 1, 40, 41, 90), (99,)])
def test_samples_of_a_head_stand_in_the_rows_of_their_times(lost):
    rng = np.random.default_rng(len(lost))
    time = np.arange(100) * 0.002
    kept = np.setdiff1d(np.arange(100), lost)
    streams = {
        "head_a": SignalStream(time, np.zeros((100, 1))),
        "head_b": SignalStream(time[kept], np.zeros((len(kept), 1))),
    }
    grid = align_heads(StageRecording(0, streams))
    assert isinstance(grid.rows["head_b"], slice) == (not lost or lost == (99,))
    np.testing.assert_array_equal(grid.present, np.stack([np.ones(100, bool), np.isin(np.arange(100), kept)], axis=1))
    left_out = rng.random(len(kept)) < 0.1
    np.testing.assert_array_equal(grid.rows_of("head_b", left_out), kept[left_out])
    values = rng.normal(size=(len(kept), 1, 3))
    table = np.full((2, 2, 100), np.nan)
    taking_part = {"head_a": np.ones(100, bool), "head_b": ~left_out}
    grid.lay_out(table, {"head_b": values}, taking_part, slice(1, 3))
    expected = np.zeros((2, 2, 100))
    for sample, row in enumerate(kept):
        if not left_out[sample]:
            expected[1, :, row] = values[sample, 0, 1:3]
    np.testing.assert_array_equal(table, expected)
