"""Heads fall silent until those that are left do not tell rotation and displacement apart: the estimate goes on."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import FAULTS, Options, Recording, make_recording, random_stage, with_probes
from world.recording import COMMAND

from faults.judging import TURNING, Judgement, estimated, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.mixed_rotation import mixed_in
from rotary_error_monitor.signals.blocks import SampleBlock

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


@pytest.mark.parametrize("part", [6e-5, 1e-3])
def test_a_displacement_that_nobody_described_is_no_fault_of_the_command(part: float) -> None:
    """One head takes it for rotation, from the moment on at which the others fall silent, far beyond the drive's error.

    It is as large as a part of the ring's radius, and within the limits that the stage states.
    """
    for seed in STAGES[::2]:
        stated = described(seed, probes=False)
        size = part * stated["encoder"]["disc_radius"]
        stated["limits"] = {"radial": 2.0 * size, "radial_rate": 1.0, "following_error": 5e-5, "latency": 1e-4}
        known = {**stated, "spindle": {**stated.get("spindle", {}), "radial": []}}
        oval = {"order": 2, "x": [size, 0.0], "y": [0.0, size]}
        true = {**stated, "spindle": {**stated.get("spindle", {}), "radial": [oval]}}
        options = Options(motion=TURNING[seed % 4], odd_rates=False, peak_speed=4.0, lost_blocks=0.0)
        whole = make_recording(seed, duration=DURATION, stage=true, options=options)
        found = judge(without(whole, kept(stated, seed), SILENT, BACK), known)
        assert found.worst <= MOST_WRONG and "command" not in found.doubted, (seed, found.doubted)
        assert found.available["ecc"] > 0.9, seed


def test_a_command_that_is_right_again_is_believed_while_one_head_is_left() -> None:
    """Beyond what the ring's place explains it is not, and nothing goes out; within a second of its return all does."""
    begin, end, settled = SILENT + 0.5, SILENT + 1.0, SILENT + 2.0
    for seed in STAGES:
        recording = recorded(seed)
        off = 2.0 * (mixed_in(stage_of(recording.stage)) + stage_of(recording.stage).limits.following_error) + 0.01
        estimator, blocks = Estimator(stage_of(recording.stage)), []
        for block in recording.blocks[COMMAND]:
            rows, since = block.rows.copy(), (block.times_ns - recording.start_ns) * 1e-9
            rows[(since >= begin) & (since < end), 1] += off
            blocks.append(SampleBlock(block.stamp_ns, block.names, rows))
        changed = recording.with_topics({COMMAND: (blocks, recording.arrivals[COMMAND])})
        parts = estimated(changed, estimator, lambda _: None)
        told = (np.concatenate([part.times_ns for part in parts]) - recording.start_ns) * 1e-9
        per_second = len(told) / DURATION
        assert not ((told > begin + 0.1) & (told < end)).any(), seed
        assert ((told > settled) & (told < BACK)).sum() > 0.9 * (BACK - settled) * per_second, seed


@pytest.mark.long
@pytest.mark.parametrize("name", ["head_jumps_100", "head_jumps_line", "head_reversed", "command_stuck", "head_stuck"])
def test_a_further_fault_makes_nothing_wrong(name: str) -> None:
    """Of the head that is left as well: without another beside it, nothing but the command contradicts it."""
    wrong = []
    for seed in STAGES:
        injected = FAULTS[name](recorded(seed), np.random.default_rng(seed))
        wrong.append(judge(injected.recording, recorded(seed).stage).worst if injected.acts else 0.0)
    assert max(wrong) <= MOST_WRONG, wrong
