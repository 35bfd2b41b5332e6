"""Stages with one head, or two that are not opposed, beside probes: what is published is right, whatever goes wrong."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from world import FAULTS, Options, Recording, make_recording, random_stage, with_probes

from faults.judging import TURNING, Judgement, judge
from faults.recordings import MOST_WRONG

STAGES = range(12)
APART = (0.6, 1.6, 2.9, -2.2)
"""Azimuth of a second head less that of the first, rad."""

OF_A_HEAD = ("head_stuck", "head_jumps_100", "head_jumps_line", "head_reversed", "head_noisy", "head_future_10ms")
OF_OTHERS = ("autocollimator_stuck", "autocollimator_stepped", "command_stuck", "blocks_lost")


def described(seed: int, *, probes: bool) -> dict[str, object]:
    """A drawn stage with the first of its heads, every other one with a second beside it."""
    section = deepcopy(random_stage(seed))
    first = next(iter(section["encoder"]["heads"].values()))
    heads = {"a": first}
    if seed % 2:
        heads["b"] = {**first, "azimuth": float(np.mod(first["azimuth"] + APART[seed // 2 % 4], 2.0 * np.pi))}
    section["encoder"]["heads"] = heads
    return with_probes(section, seed) if probes else section


@cache
def recorded(seed: int, *, probes: bool = True) -> Recording:
    options = Options(motion=TURNING[seed % 4], odd_rates=False, peak_speed=4.0, lost_blocks=0.0)
    return make_recording(seed, duration=6.0, stage=described(seed, probes=probes), options=options)


@cache
def healthy(seed: int, *, probes: bool = True) -> Judgement:
    recording = recorded(seed, probes=probes)
    return judge(recording, recording.stage)


def test_sound_instruments_are_believed_and_right():
    for seed in STAGES:
        found = healthy(seed)
        assert not found.doubted, seed
        assert found.worst <= MOST_WRONG, seed
        assert min(found.available.values()) > 0.9, (seed, found.available)


def test_without_probes_there_are_rotation_and_tilt():
    for seed in STAGES:
        found = healthy(seed, probes=False)
        assert not found.doubted and found.worst <= MOST_WRONG, seed
        assert {name for name, part in found.available.items() if part > 0.9} == {"eac", "ebc", "ecc"}, seed


@pytest.mark.parametrize("name", [*OF_A_HEAD, *OF_OTHERS])
def test_a_fault_makes_nothing_wrong(name):
    wrong = []
    for seed in STAGES:
        injected = FAULTS[name](recorded(seed), np.random.default_rng(seed))
        wrong.append(judge(injected.recording, recorded(seed).stage).worst if injected.acts else 0.0)
    assert sum(each > MOST_WRONG for each in wrong) <= len(wrong) // 12, wrong
    assert np.median(wrong) == 0.0
