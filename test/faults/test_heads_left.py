"""Heads fall silent until those that are left do not tell rotation and displacement apart: the estimate goes on."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from draws import seeds
from world import FAULTS, Options, Recording, make_recording, random_stage, with_probes

from faults.judging import TURNING, Judgement, judge
from faults.recordings import MOST_WRONG

STAGES = seeds(16)
DURATION, SILENT, BACK = 9.0, 4.0, 7.0
"""Length of a recording, and when all heads but some fall silent and are back, s: a turn of all is seen before."""

OPPOSED = 0.2
"""Two heads that are left are this far from opposed ones at least, rad."""


def described(seed: int, *, probes: bool) -> dict[str, object]:
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = deepcopy(next(each for each in drawn if len(each["encoder"]["heads"]) >= 4))
    return with_probes(section, seed) if probes else section


def kept(section: dict[str, object], seed: int) -> set[str]:
    """Letters of one head, or every other time of two that are not opposed."""
    azimuths = {letter: head["azimuth"] for letter, head in section["encoder"]["heads"].items()}
    first, *others = sorted(azimuths, key=lambda letter: (ord(letter) + seed) % len(azimuths))
    apart = (each for each in others if np.cos(azimuths[each] - azimuths[first]) > -np.cos(OPPOSED))
    return {first, next(apart)} if seed % 2 else {first}


def without(recording: Recording, letters: set[str], begin: float, end: float) -> Recording:
    """A recording without the blocks of other heads from one time to another, s."""
    changed = {}
    for topic in recording.head_topics:
        if topic.split("/")[2].removeprefix("head_") in letters:
            continue
        since = (recording.arrivals[topic] - recording.start_ns) * 1e-9
        there = (since < begin) | (since > end)
        blocks = [block for block, is_there in zip(recording.blocks[topic], there, strict=True) if is_there]
        changed[topic] = blocks, recording.arrivals[topic][there]
    return recording.with_topics(changed)


@cache
def recorded(seed: int, *, probes: bool = True) -> Recording:
    options = Options(motion=TURNING[seed % 4], odd_rates=False, peak_speed=4.0, lost_blocks=0.0)
    section = described(seed, probes=probes)
    whole = make_recording(seed, duration=DURATION, stage=section, options=options)
    return without(whole, kept(section, seed), SILENT, BACK)


@cache
def judged(seed: int, *, probes: bool = True) -> Judgement:
    recording = recorded(seed, probes=probes)
    return judge(recording, recording.stage)


def test_beside_probes_all_goes_on_and_is_right() -> None:
    for seed in STAGES:
        found = judged(seed)
        assert found.worst <= MOST_WRONG, (seed, found.wrong)
        assert not {"heads", "command", "autocollimator"} & set(found.doubted), (seed, found.doubted)
        assert min(found.available[name] for name in ("exc", "eyc", "ecc")) > 0.9, (seed, found.available)


def test_without_probes_rotation_and_tilt_go_on() -> None:
    part = 1.0 - (BACK - SILENT) / DURATION
    for seed in STAGES:
        found = judged(seed, probes=False)
        assert found.worst <= MOST_WRONG, (seed, found.wrong)
        assert min(found.available[name] for name in ("eac", "ebc", "ecc")) > 0.9, (seed, found.available)
        assert found.available["exc"] < part + 0.05, seed


@pytest.mark.long
@pytest.mark.parametrize("name", ["head_jumps_100", "head_jumps_line", "head_reversed", "command_stuck", "head_stuck"])
def test_a_further_fault_makes_nothing_wrong(name: str) -> None:
    """Of the head that is left as well: without another beside it, nothing but the command contradicts it."""
    wrong = []
    for seed in STAGES:
        injected = FAULTS[name](recorded(seed), np.random.default_rng(seed))
        wrong.append(judge(injected.recording, recorded(seed).stage).worst if injected.acts else 0.0)
    assert sum(each > MOST_WRONG for each in wrong) <= len(wrong) // 12 + 1, wrong
    assert np.median(wrong) == 0.0
